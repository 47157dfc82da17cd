"""Can tests fail? ``python -m tests.soak.mutation [FILE...]``

Changes the last line of defence operator by operator and number by number (`mutants`), in a copy of the project, and
runs the tests of the module: the share of changes that they notice is its score. A change that nobody notices should
be in `survivors.toml` with the reason why it makes no difference. Ends with 1 where a score is below 80 %.

Each mutant is tested in a fork of this process, which has what tests import from outside already, but no ridlink.
"""

from __future__ import annotations

import contextlib
import importlib
import os
import select
import signal
import sys
import time
import tomllib
from pathlib import Path

from tests.conftest import QUICK
from tests.soak.copies import PASSED, ROOT, changed, copy_of_project
from tests.soak.mutants import Mutant, mutants

LEAST_SCORE = 0.8
PATIENCE_S = 20.0
"""At least; a mutant that takes so much longer than its tests do goes in circles, which is noticed."""

SURVIVORS = Path(__file__).with_name("survivors.toml")
FROM_OUTSIDE = ("numpy", "numba", "hypothesis", "hypothesis.strategies", "pytest", "msgspec", "pymap3d", "fastcrc")

TRAFFIC = ["tests/traffic"]
OWN_SHIP = ["tests/own_ship/test_rules.py", "tests/own_ship/test_telemetry.py"]
REMOTE_ID = ["tests/remote_id/test_convert.py", "tests/remote_id/test_quantities.py"]
BOTH_WIRES = [
    *REMOTE_ID,
    "tests/remote_id/test_astm.py",
    "tests/remote_id/test_astm_core_c.py",
    "tests/remote_id/test_astm_separation.py",
    "tests/remote_id/test_bridge.py",
]
MUTATED = {
    "ridlink/failsafe.py": ["tests/test_failsafe.py"],
    "ridlink/setpoint.py": ["tests/test_setpoint.py"],
    "ridlink/own_ship/jump.py": OWN_SHIP,
    "ridlink/own_ship/lateness.py": OWN_SHIP,
    "ridlink/own_ship/other_writer.py": OWN_SHIP,
    "ridlink/own_ship/requests.py": ["tests/own_ship/test_requests.py"],
    "ridlink/own_ship/rhythm.py": OWN_SHIP,
    "ridlink/own_ship/trust.py": OWN_SHIP,
    "ridlink/traffic/altitude.py": TRAFFIC,
    "ridlink/traffic/doubt.py": TRAFFIC,
    "ridlink/traffic/flood.py": TRAFFIC,
    "ridlink/traffic/track.py": TRAFFIC,
    "ridlink/engine/guard.py": ["tests/engine/test_guard_rules.py"],
    "ridlink/engine/intake.py": ["tests/engine/test_intake.py"],
    "ridlink/engine/recovery.py": ["tests/engine/test_recovery.py"],
    "ridlink/engine/takeoff.py": ["tests/engine/test_takeoff.py"],
    "ridlink/mavlink/frames.py": ["tests/mavlink/test_frames.py"],
    "ridlink/mavlink/signing.py": ["tests/mavlink/test_signing.py"],
    "ridlink/remote_id/convert.py": REMOTE_ID,
    "ridlink/remote_id/identities.py": BOTH_WIRES,
    "ridlink/remote_id/location.py": BOTH_WIRES,
    "ridlink/remote_id/mavlink_fields.py": REMOTE_ID,
    "ridlink/remote_id/quantities.py": REMOTE_ID,
    "ridlink/remote_id/separation.py": BOTH_WIRES,
    "ridlink/remote_id/system.py": BOTH_WIRES,
}


def _in_the_child(where: Path, tests: list[str]) -> int:
    """Run tests of a copy; this process is a fork and ends with it."""
    os.chdir(where)
    os.environ |= {"PYTHONPATH": str(where), QUICK: "1"}
    sys.path[:] = [str(where), *(entry for entry in sys.path if Path(entry or ".").resolve() != ROOT)]
    sys.dont_write_bytecode = True
    for name in [name for name in sys.modules if name.partition(".")[0] in ("tests", "ridlink", "sitl_sim")]:
        del sys.modules[name]
    importlib.invalidate_caches()
    import pytest

    import ridlink

    assert ridlink.__file__ is not None and Path(ridlink.__file__).is_relative_to(where)
    # What was imported before the fork cannot be rewritten, which matters to nobody.
    options = [
        "-q",
        "-x",
        "-p",
        "no:cacheprovider",
        "-p",
        "no:xdist",
        "-W",
        "ignore::pytest.PytestAssertRewriteWarning",
    ]
    return int(pytest.main([*options, *tests]))


def outcome(where: Path, tests: list[str], longest_s: float) -> int | None:
    """Exit code of pytest; None if it did not end in time."""
    child = os.fork()
    if child == 0:
        code = 3
        with contextlib.suppress(BaseException):  # a mutant may fail as it is imported
            os.setsid()
            nothing = os.open(os.devnull, os.O_RDWR)
            for descriptor in (0, 1, 2):
                os.dup2(nothing, descriptor)
            code = _in_the_child(where, tests)
        os._exit(code)
    handle = os.pidfd_open(child)
    ended, _, _ = select.select([handle], [], [], longest_s)
    os.close(handle)
    if not ended:
        os.killpg(child, signal.SIGKILL)
    _, status = os.waitpid(child, 0)
    return os.waitstatus_to_exitcode(status) if ended else None


def reasons() -> dict[tuple[str, str, str], str]:
    """Why a change makes no difference, by file, line of source and change."""
    with SURVIVORS.open("rb") as file:
        return {(row["file"], row["at"], row["change"]): row["why"] for row in tomllib.load(file)["survivor"]}


def judge(where: Path, name: str, tests: list[str]) -> tuple[int, int, list[Mutant]]:
    """How many mutants of a file are noticed, of how many, and the others."""
    began_s = time.monotonic()
    if outcome(where, tests, 120.0) != PASSED:
        raise SystemExit(f"{' '.join(tests)}: fail already without a mutant")
    longest_s = max(PATIENCE_S, 5.0 * (time.monotonic() - began_s))
    total, alive = 0, []
    for mutant in mutants((ROOT / name).read_text()):
        total += 1
        with changed(where / name, mutant.text):
            if outcome(where, tests, longest_s) == PASSED:
                alive.append(mutant)
    return total - len(alive), total, alive


def main() -> int:
    only = sys.argv[1:]
    if unknown := set(only) - set(MUTATED):
        raise SystemExit(f"{', '.join(sorted(unknown))}: not among {', '.join(MUTATED)}")
    for package in FROM_OUTSIDE:
        importlib.import_module(package)
    why, good, all_noticed, all_total = reasons(), True, 0, 0
    with copy_of_project() as where:
        for name, tests in MUTATED.items():
            if only and name not in only:
                continue
            noticed, total, alive = judge(where, name, tests)
            good &= noticed >= LEAST_SCORE * total
            all_noticed, all_total = all_noticed + noticed, all_total + total
            print(f"{name:34s} {noticed:3d} of {total:3d} noticed, {noticed / total:.0%}", flush=True)
            lines = (ROOT / name).read_text().splitlines()
            for mutant in alive:
                reason = why.get((name, lines[mutant.line - 1].strip(), mutant.change), "NOT EXPLAINED")
                print(f"    line {mutant.line:3d}: {mutant.change}: {reason}", flush=True)
    print(f"{all_noticed} of {all_total} noticed, {all_noticed / all_total:.0%}")
    return int(not good)


if __name__ == "__main__":
    sys.exit(main())
