"""Can tests fail? ``python -m tests.soak.mutation [unprotected [FAULT...] | mutants [FILE...]]`` (both unless said).

    unprotected  takes each protection of `docs/faults.md` out, one at a time, and runs the tests that name the fault
    mutants      changes the last line of defence (failsafe, setpoint, watchers of own state and floods) operator by
                 operator, and runs their tests; the score is the share that is noticed

Works on a copy; nothing here is touched. Ends with 1 where nobody notices that a protection is gone, or fewer than 80 %
of the mutants are noticed.
"""

from __future__ import annotations

import ast
import copy
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
LEAST_SCORE = 0.8

MUTATED = {
    "ridlink/failsafe.py": ["tests/test_failsafe.py"],
    "ridlink/setpoint.py": ["tests/test_setpoint.py"],
    "ridlink/own_ship/jump.py": ["tests/test_own_ship.py"],
    "ridlink/own_ship/lateness.py": ["tests/test_own_ship.py"],
    "ridlink/traffic/flood.py": ["tests/traffic/test_doubt.py"],
    "ridlink/traffic/doubt.py": ["tests/traffic/test_doubt.py"],
    "ridlink/engine/recovery.py": ["tests/test_recovery.py"],
    "ridlink/engine/guard.py": ["tests/test_guard.py"],
}

UNPROTECTED: list[tuple[str, str, str, str]] = [
    (
        "f01",
        "ridlink/traffic/picture.py",
        "        if report.latitude_deg is None:\n            self.counters[Update.NO_POSITION]",
        "        if False:\n            self.counters[Update.NO_POSITION]",
    ),
    (
        "f02",
        "ridlink/separation/definitions.py",
        "return np.asarray(np.minimum(known, ERROR_CAP_M))",
        "return np.asarray(known)",
    ),
    ("f03", "ridlink/separation/definitions.py", "np.clip(known, MIN_AIRFRAME_M, AIRFRAME_CAP_M)", "known"),
    ("f04", "ridlink/traffic/snapshot.py", "widening_m=rows[:, 10] * age + coasting", "widening_m=coasting"),
    ("f05", "ridlink/traffic/picture.py", "if not SENDER_AGE_S[0] <= age <= SENDER_AGE_S[1]:", "if False:"),
    ("f06", "ridlink/engine/intake.py", "elif found.version != 2 and not self._allow_v1:", "elif False:"),
    ("f07", "ridlink/traffic/track.py", "if self.metres_to(report) <= reach:", "if True:"),
    ("f08", "ridlink/traffic/picture.py", "VEHICLES_PER_IDENTITY = 4", "VEHICLES_PER_IDENTITY = 1"),
    ("f09", "ridlink/traffic/picture.py", "if not (by_sysid or by_uas_id):", "if True:"),
    ("f10", "ridlink/traffic/snapshot.py", "+ coasting", ""),
    ("f11", "ridlink/engine/recovery.py", "if change <= room or", "if True or"),
    ("f12", "ridlink/traffic/flood.py", "admitted = left >= 1.0", "admitted = True"),
    ("f14", "ridlink/failsafe.py", "if not seen.own_state_age_s <= settings.hold_after_s:", "if False:"),
    ("f15", "ridlink/failsafe.py", "if seen.rebooted:", "if False:"),
    ("f16", "ridlink/failsafe.py", "if seen.own_jumped:", "if False:"),
    ("f17", "ridlink/own_ship/telemetry.py", "measured_at_s = now_s - late_s", "measured_at_s = now_s"),
    ("f18", "ridlink/failsafe.py", "if not abs(seen.latitude_deg) <= settings.max_latitude_deg:", "if False:"),
    (
        "f19",
        "ridlink/traffic/altitude.py",
        "return np.asarray(np.where(sound, bound, np.inf))",
        "return np.asarray(np.where(sound, bound, 0.0))",
    ),
    ("f20", "ridlink/traffic/track.py", "self.interval_s += 0.3 * (gap - self.interval_s)", "pass"),
    ("f21", "ridlink/mavlink/frames.py", "            if frames == limit:\n", "            if False:\n"),
    ("f22", "ridlink/mavlink/frames.py", "            return Cause.BAD_CHECKSUM", "            pass"),
    ("f24", "ridlink/links/udp.py", "if error.errno not in PASSING and self._retry is None:", "if False:"),
    ("f25", "ridlink/engine/steering.py", "            self.fatal = True", "            pass"),
    ("f26", "ridlink/daemon/watchdog.py", "if still_s > DEAD_S:", "if False:"),
    ("f28", "ridlink/engine/core.py", "for k in range(3)]", "for k in range(0)]"),
    ("f29", "ridlink/captures/recorder.py", "            self.error = error\n", "            raise\n"),
    ("f34", "ridlink/daemon/config.py", "if key not in known:", "if False:"),
    ("i3", "ridlink/failsafe.py", "    if not seen.external_mode:\n        return", "    if False:\n        return"),
    ("two_daemons", "ridlink/failsafe.py", "    if seen.other_writer:\n        return OTHER_WRITER\n", ""),
]
TESTS = [
    "tests/daemon",
    "tests/traffic",
    "tests/links",
    "tests/cli/test_avoid.py",
    *(f"tests/test_{name}.py" for name in ("engine", "failsafe", "faults_engine", "own_ship", "recovery")),
]


def fails(where: Path, arguments: list[str]) -> bool:
    """Whether a test fails there."""
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", *arguments]
    environment = {**os.environ, "PYTHONPATH": str(where)}
    try:
        done = subprocess.run(command, cwd=where, env=environment, capture_output=True, text=True, timeout=180.0)
    except subprocess.TimeoutExpired:
        return True
    if done.returncode not in (0, 1, 2):
        print(done.stdout[-2000:], done.stderr[-2000:])
        raise SystemExit(f"pytest ended with {done.returncode}")
    return done.returncode != 0


OPPOSITES = ((ast.Lt, ast.GtE), (ast.LtE, ast.Gt), (ast.Eq, ast.NotEq), (ast.Is, ast.IsNot), (ast.In, ast.NotIn))
COMPARED = {**dict(OPPOSITES), **{other: one for one, other in OPPOSITES}}
COMPUTED = {ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult}


class Mutator(ast.NodeTransformer):
    """Makes the change of one number, and counts how many there are."""

    def __init__(self, wanted: int) -> None:
        self.wanted, self.count, self.line = wanted, 0, 0

    def _mine(self, node: ast.AST) -> bool:
        self.count += 1
        if self.count - 1 != self.wanted:
            return False
        self.line = getattr(node, "lineno", 0)
        return True

    def visit_ClassDef(self, node: ast.ClassDef) -> ast.AST:
        node.body = [self.visit(each) for each in node.body]  # not what decorates it: frozen and slotted change nothing
        return node

    def visit_Compare(self, node: ast.Compare) -> ast.AST:
        self.generic_visit(node)
        if type(node.ops[0]) in COMPARED and self._mine(node):
            node.ops[0] = COMPARED[type(node.ops[0])]()
        return node

    def visit_BinOp(self, node: ast.BinOp) -> ast.AST:
        self.generic_visit(node)
        if type(node.op) in COMPUTED and self._mine(node):
            node.op = COMPUTED[type(node.op)]()
        return node

    def visit_BoolOp(self, node: ast.BoolOp) -> ast.AST:
        self.generic_visit(node)
        if self._mine(node):
            node.op = ast.Or() if isinstance(node.op, ast.And) else ast.And()
        return node

    def visit_UnaryOp(self, node: ast.UnaryOp) -> ast.AST:
        self.generic_visit(node)
        if isinstance(node.op, ast.Not) and self._mine(node):
            return node.operand
        return node

    def visit_Constant(self, node: ast.Constant) -> ast.AST:
        if isinstance(node.value, bool):
            if self._mine(node):
                return ast.copy_location(ast.Constant(not node.value), node)
        elif isinstance(node.value, int | float) and self._mine(node):
            return ast.copy_location(ast.Constant(node.value * 2 + 1), node)
        return node


def mutants(source: str) -> Iterator[tuple[int, str]]:
    """Line and text of every mutant."""
    tree, number = ast.parse(source), 0
    while True:
        mutator = Mutator(number)
        changed = mutator.visit(copy.deepcopy(tree))
        if mutator.count <= number:
            return
        yield mutator.line, ast.unparse(ast.fix_missing_locations(changed))
        number += 1


def run_unprotected(where: Path, only: list[str]) -> bool:
    good = True
    for fault, name, old, new in UNPROTECTED:
        if only and fault not in only:
            continue
        path = where / name
        source = path.read_text()
        if source.count(old) < 1:
            print(f"{fault:12s} {name}: the protection is no longer where it was", flush=True)
            good = False
            continue
        path.write_text(source.replace(old, new, 1))
        noticed = fails(where, ["-k", fault, *TESTS])
        path.write_text(source)
        good &= noticed
        print(f"{fault:12s} {name:36s} {'missed by its tests' if noticed else 'NOBODY NOTICES'}", flush=True)
    return good


def run_mutants(where: Path, only: list[str]) -> bool:
    good = True
    for name, tests in MUTATED.items():
        if only and name not in only:
            continue
        path = where / name
        source, noticed, alive = path.read_text(), 0, []
        for line, text in mutants(source):
            path.write_text(text)
            if fails(where, tests):
                noticed += 1
            else:
                alive.append(line)
        path.write_text(source)
        total = noticed + len(alive)
        good &= noticed >= LEAST_SCORE * total
        print(f"{name:36s} {noticed}/{total} = {noticed / total:.0%}; alive in lines {alive}", flush=True)
    return good


def main() -> int:
    what = sys.argv[1:] or ["unprotected", "mutants"]
    only = [name for name in what if name not in ("unprotected", "mutants")]
    good = True
    with tempfile.TemporaryDirectory() as folder:
        where = Path(folder)
        for package in ("ridlink", "sitl_sim", "message_spec", "tests"):
            shutil.copytree(ROOT / package, where / package)
        shutil.copy(ROOT / "pyproject.toml", where)
        if "unprotected" in what:
            good &= run_unprotected(where, only)
        if "mutants" in what:
            good &= run_mutants(where, only)
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
