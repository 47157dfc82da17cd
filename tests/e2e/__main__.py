"""Fly the acceptance flights in real time and judge them: ``python -m tests.e2e [quick]``.

Every flight is the command that a user types, with real sockets; the figures are those of its last line of JSON. Ends
with 1 if one of them fails.
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
from typing import Any

DECISION_P99_MS = 20.0
SETPOINT_GAP_MAX_MS = 300.0
SEEDS = range(1, 6)


def flights(quick: bool) -> list[list[str]]:
    seeds = list(SEEDS)[:1] if quick else list(SEEDS)
    chosen = [
        ["--scenario", scenario, "--seed", str(seed)]
        for scenario in ("circle8", "head-on", "crossing")
        for seed in seeds
    ]
    chosen += [
        ["--scenario", scenario, "--seed", "1", "--processes"] for scenario in ("circle8", "head-on", "crossing")
    ]
    chosen += [["--scenario", "circle8", "--seed", "2", "--autopilot", "ardupilot"]]
    chosen += [["--from-ground", "--autopilot", autopilot] for autopilot in ("px4", "ardupilot")]
    chosen += [["--scenario", "overtake", "--seed", "1"], ["--scenario", "square24", "--seed", "1"]]
    return chosen


def fly(arguments: list[str]) -> tuple[int, dict[str, Any]]:
    command = [sys.executable, "-m", "ridlink", "demo", "--headless", "--json", *arguments]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, timeout=600)
    lines = done.stdout.strip().splitlines()
    return done.returncode, json.loads(lines[-1]) if lines else {}


def faults(code: int, result: dict[str, Any]) -> list[str]:
    if not result:
        return [f"no result, exit {code}"]
    found = []
    if code:
        found.append(f"exit {code}")
    if result["arrived"] != result["vehicles"]:
        found.append(f"{result['arrived']} of {result['vehicles']} arrived")
    if result.get("landed", result["vehicles"]) != result["vehicles"]:
        found.append(f"{result['landed']} of {result['vehicles']} landed")
    if result["macs"]:
        found.append(f"{result['macs']} MACs")
    if result["decision_ms"]["p99"] > DECISION_P99_MS:
        found.append(f"decision p99 {result['decision_ms']['p99']} ms")
    if result["setpoint_gap_ms"]["max"] > SETPOINT_GAP_MAX_MS:
        found.append(f"setpoint gap {result['setpoint_gap_ms']['max']} ms")
    return found


def row(arguments: list[str], result: dict[str, Any], found: list[str], took_s: float) -> str:
    if not result:
        return f"{' '.join(arguments):52} {'; '.join(found)}"
    times = result["mission_time_s"]
    figures = (
        f"{result['arrived']:>3}/{result['vehicles']:<3} {result['macs']:>4} {times['median'] or 0:>8.1f} "
        f"{times['max'] or 0:>6.1f} {result['min_separation_m']:>6.1f} {result['decision_ms']['p99']:>6.2f} "
        f"{result['setpoint_gap_ms']['max']:>6.0f}"
    )
    return f"{' '.join(arguments):52} {figures}  {'; '.join(found) or 'ok'} ({took_s:.0f} s)"


def main() -> int:
    failed = 0
    headings = f"{'arrived':>7} {'MACs':>4} {'median s':>8} {'max s':>6} {'min m':>6} {'p99 ms':>6} {'gap ms':>6}"
    print(f"{'flight':52} {headings}  verdict")
    for arguments in flights("quick" in sys.argv[1:]):
        begun = time.monotonic()
        code, result = fly(arguments)
        found = faults(code, result)
        failed += bool(found)
        print(row(arguments, result, found, time.monotonic() - begun), flush=True)
    print(f"{failed} failed" if failed else "all passed")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
