"""Is every protection of `docs/faults.md` held by a test? ``python -m tests.soak.proof [FAULT...]``

First the tests that are named run on an untouched copy of the project: they must pass, and it is seen which of them
speak over a socket. Then each protection of `protections.toml` is taken out of the copy, alone, and its test must fail:
by an assertion or a wait that ends in vain, not because the broken file cannot be run. A fault that arrives by a socket
must have a test that does.

Prints a line for each protection. Ends with 1 where a protection is gone and nobody notices.
"""

from __future__ import annotations

import contextlib
import json
import os
import sys
import time
from pathlib import Path

from tests.soak.copies import FAILED, PASSED, changed, copy_of_project, run_tests
from tests.soak.protections import FAULTS, NO_SOCKET, Protection, protections
from tests.soak.sockets import VARIABLE

NOT_BY_ACCIDENT = ("NameError", "ImportError", "ModuleNotFoundError", "SyntaxError", "UnboundLocalError", "fixture")
"""Failures that say that the broken file is no program any more, and nothing about the test."""


def untouched(where: Path, tests: list[str]) -> dict[str, bool]:
    """Which tests speak over a socket; ends the program if one fails."""
    seen = where / "sockets.json"
    os.environ[VARIABLE] = str(seen)
    outcome = run_tests(where, "-p", "tests.soak.sockets", *tests)
    del os.environ[VARIABLE]
    if outcome.code != PASSED:
        print(outcome.text[-3000:])
        raise SystemExit("the tests fail already with every protection in place")
    sockets: dict[str, bool] = json.loads(seen.read_text())
    return sockets


def verdict(where: Path, protection: Protection) -> tuple[bool, str]:
    """Whether its test fails without a protection, and how."""
    with contextlib.ExitStack() as broken:
        for name, text in protection.taken_out(where).items():
            broken.enter_context(changed(where / name, text))
        outcome = run_tests(where, "-x", protection.test)
    if outcome.code == PASSED:
        return False, "NOBODY NOTICES"
    how = outcome.first_failure
    if outcome.code != FAILED or any(name in how for name in NOT_BY_ACCIDENT):
        return False, f"CANNOT BE RUN ({outcome.code}): {how or outcome.text[-300:]}"
    return True, f"fails: {how[:60] or 'a worker ends'}"


def main() -> int:
    only = {word.upper() for word in sys.argv[1:]}
    table = [row for row in protections() if not only or row.fault in only]
    if not table:
        raise SystemExit(f"no such fault; there are {', '.join(FAULTS)} and I1, I3")
    bad: list[str] = []
    spoken: set[str] = set()
    began_s = time.monotonic()
    with copy_of_project() as where:
        for row in table:
            row.taken_out(where)  # all of them apply, or nothing begins
        sockets = untouched(where, sorted({row.test for row in table}))
        for row in table:
            noticed, how = verdict(where, row)
            if not noticed:
                bad.append(row.fault)
            if noticed and sockets[row.test]:
                spoken.add(row.fault)
            by = "socket" if sockets[row.test] else "-"
            print(f"{row.fault:4s} {row.gone:76s} {row.test.removeprefix('tests/')}\n     {by:7s} {how}", flush=True)
    silent = [f for f in dict.fromkeys(row.fault for row in table) if f[0] == "F" and f not in spoken | set(NO_SOCKET)]
    faults = len({row.fault for row in table})
    print(
        f"{len(table)} protections against {faults} faults and invariants, each taken out alone: "
        f"{len(table) - len(bad)} noticed by the test that names the fault; {len(spoken)} faults by a socket; "
        f"{time.monotonic() - began_s:.0f} s"
    )
    for fault in silent:
        print(f"{fault}: arrives by a socket, and no test that notices speaks over one")
    return int(bool(bad or silent))


if __name__ == "__main__":
    sys.exit(main())
