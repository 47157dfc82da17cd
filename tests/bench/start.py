"""How long a command takes until it says what it can do: CPU time of whole processes, beside an interpreter that only
loads click, the library of the command line."""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
from functools import partial
from typing import Any

from tests.bench.measure import ROUNDS, children_seconds, interleaved

COMMANDS = ("--version", "--help", "avoid --help", "decode --help", "campaign run --help")


def report() -> dict[str, list[dict[str, Any]]]:
    """Print the table."""
    peer = partial(_run, "-c", "import click")
    actions = {"click": peer} | {command: partial(_run, "-m", "ridlink", *command.split()) for command in COMMANDS}
    seconds = interleaved(actions, clock=children_seconds)
    print(f"\nstart of a command, CPU time, median of {ROUNDS} interleaved rounds")
    print(f"{'ridlink':<22}{'':>8}{'import click':>14}{'ratio':>8}  (spread)")
    rows = []
    for command in COMMANDS:
        ratios = [own / other for own, other in zip(seconds[command], seconds["click"], strict=True)]
        own, other = statistics.median(seconds[command]), statistics.median(seconds["click"])
        rows.append({"command": command, "cpu_s": own, "click_cpu_s": other, "ratio": statistics.median(ratios)})
        spread = f"({min(ratios):.2f}-{max(ratios):.2f})"
        print(f"{command:<22}{own:>6.2f} s{other:>12.2f} s{rows[-1]['ratio']:>8.2f}  {spread}")
    return {"start": rows}


def _run(*arguments: str) -> None:
    subprocess.run([sys.executable, *arguments], stdout=subprocess.DEVNULL, env=os.environ, check=True)


if __name__ == "__main__":
    report()
