"""The house keeps its walls: imports are read from the source and held against the layers of ARCHITECTURE.md."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]

LAYERS = {
    "ridlink.errors": 0,
    "ridlink.units": 0,
    "ridlink.geodesy": 0,
    "ridlink.companions": 0,
    "ridlink.compiled": 0,
    "ridlink.compiler": 0,
    "ridlink.files": 0,
    "ridlink.checked_toml": 0,
    "ridlink.scenario": 0,
    "ridlink.technologies": 0,
    "ridlink.periodic": 0,
    "ridlink.ranges": 0,
    "ridlink.words": 0,
    "ridlink.mavlink": 1,
    "ridlink.remote_id": 2,
    "ridlink.traffic": 2,
    "ridlink.separation": 3,
    "ridlink.avoidance": 4,
    "ridlink.setpoint": 5,
    "ridlink.failsafe": 5,
    "ridlink.own_ship": 5,
    "ridlink.engine": 5,
    "ridlink.campaign": 5,
    "ridlink.analysis": 5,
    "ridlink.captures": 5,
    "ridlink.observer": 5,
    "ridlink.links": 6,
    "ridlink.metrics": 6,
    "ridlink.impair": 6,
    "ridlink.doctor": 6,
    "ridlink.conductor": 6,
    "ridlink.mqtt": 6,
    "ridlink.review": 6,
    "ridlink.view": 6,
    "ridlink.daemon": 6,
    "ridlink.campaign_runner": 6,
    "ridlink.cli": 7,
}
"""A module imports its own layer and those below."""

MATHEMATICS = ("ridlink.separation", "ridlink.avoidance")
"""Rooms that know discs and velocities, and nothing of Remote ID or MAVLink."""

SANS_IO = (
    "ridlink.errors",
    "ridlink.units",
    "ridlink.geodesy",
    "ridlink.periodic",
    "ridlink.ranges",
    "ridlink.mavlink",
    "ridlink.remote_id",
    "ridlink.traffic",
    "ridlink.separation",
    "ridlink.avoidance",
    "ridlink.setpoint",
    "ridlink.failsafe",
    "ridlink.own_ship",
    "ridlink.engine",
    "ridlink.campaign",
    "ridlink.impair.model",
    "ridlink.observer",
    "ridlink.review.walk",
    "ridlink.review.approach",
    "ridlink.review.traces",
    "ridlink.review.report",
    "ridlink.review.whatif",
    "ridlink.view.scenery",
    "ridlink.view.instants",
    "ridlink.view.wire",
    "ridlink.view.book",
    "ridlink.view.velocity_space",
    "ridlink.view.show",
    "ridlink.view.conversation",
    "sitl_sim.vehicle",
    "sitl_sim.gnss",
    "sitl_sim.faults",
    "sitl_sim.display",
    "sitl_sim.bus",
    "sitl_sim.clock",
    "sitl_sim.draws",
    "sitl_sim.verdict",
    "sitl_sim.referee",
    "sitl_sim.pair_radius",
    "sitl_sim.world",
    "sitl_sim.routes",
    "sitl_sim.radio",
    "sitl_sim.listeners",
    "sitl_sim.chance",
    "sitl_sim.autopilot",
    "sitl_sim.broadcast",
    "sitl_sim.fleet",
    "sitl_sim.fleet_config",
)
"""Rooms on the line: nobody there opens a socket, reads a clock, starts a thread or draws an unseeded number."""

WALLS_WITHIN = {
    "ridlink.links.signing_clock": ("ridlink.links.link", "ridlink.links.opening"),
    "ridlink.links.signing_options": ("ridlink.links.link", "ridlink.links.opening"),
    "ridlink.separation.distributions": ("ridlink.separation.sums",),
    "sitl_sim.fleet": ("ridlink.links", "sitl_sim.air_socket", "sitl_sim.clock", "sitl_sim.server"),
    "sitl_sim.autopilot.pilot": tuple(
        f"sitl_sim.autopilot.{part}" for part in ("link", "peers", "streams", "answers", "routine")
    ),
    "sitl_sim.autopilot.peers": tuple(f"sitl_sim.autopilot.{part}" for part in ("pilot", "orders", "answers")),
    **dict.fromkeys(
        (*(f"sitl_sim.autopilot.{part}" for part in ("guidance", "orders", "telemetry")), "sitl_sim.broadcast"),
        ("sitl_sim.world",),
    ),
}
"""What a module of a room does not know of it: a clock of signatures no link, a part of a distance no sum, a fleet no
network, who flies none of those whom he is told by, who serves them nothing of the flight, and who steers by what a
vehicle knows, or tells it, not the truth."""

FORBIDDEN_ON_THE_LINE = {"socket", "asyncio", "time", "datetime", "random", "threading", "select", "subprocess"}


def sources(package: str) -> list[Path]:
    return sorted(path for path in (ROOT / package).rglob("*.py") if path.name != "dialect.py")


def module_name(path: Path) -> str:
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


@cache
def imports(path: Path) -> list[tuple[str, bool]]:
    """Names of the modules that a file imports, and whether it does so inside a function."""
    return [(name, inside) for name, _, inside in imported(path)]


@cache
def imported(path: Path) -> list[tuple[str, list[str], bool]]:
    """Modules that a file imports, the names it takes from each, and whether it does so inside a function."""
    found: list[tuple[str, list[str], bool]] = []

    def visit(node: ast.AST, inside: bool) -> None:
        if isinstance(node, ast.expr):
            return
        if isinstance(node, ast.Import):
            found.extend((alias.name, [], inside) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path.name}: relative import"
            assert node.module is not None
            found.append((node.module, [alias.name for alias in node.names], inside))
        inside = inside or isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
        for child in ast.iter_child_nodes(node):
            visit(child, inside)

    visit(ast.parse(path.read_text()), False)
    return found


def room(module: str, rooms: Iterator[str] | tuple[str, ...] | dict[str, int]) -> str | None:
    return next((name for name in rooms if module == name or module.startswith(name + ".")), None)


@pytest.mark.parametrize("path", sources("ridlink"), ids=module_name)
def test_lower_layers_never_import_higher_ones(path: Path) -> None:
    name = module_name(path)
    own = room(name, LAYERS)
    if own is None:
        assert name in ("ridlink", "ridlink.__main__"), f"{name} has no layer: give it one here and in ARCHITECTURE.md"
        return
    for imported, _ in imports(path):
        other = room(imported, LAYERS)
        if other is not None:
            assert LAYERS[other] <= LAYERS[own], (
                f"{name} (layer {LAYERS[own]}) imports {imported} (layer {LAYERS[other]})"
            )


@pytest.mark.parametrize("path", sources("ridlink"), ids=module_name)
def test_the_product_never_imports_the_simulator(path: Path) -> None:
    assert not [imported for imported, _ in imports(path) if imported.split(".")[0] == "sitl_sim"]


@pytest.mark.parametrize("package", MATHEMATICS)
def test_separation_and_avoidance_know_nothing_of_the_wire(package: str) -> None:
    for path in sources(package.replace(".", "/")):
        for imported, _ in imports(path):
            assert room(imported, ("ridlink.mavlink", "ridlink.remote_id", "ridlink.traffic", "pymavlink")) is None, (
                f"{module_name(path)} imports {imported}"
            )


@pytest.mark.parametrize("path", [*sources("ridlink"), *sources("sitl_sim")], ids=module_name)
def test_the_line_is_free_of_clocks_and_sockets(path: Path) -> None:
    name = module_name(path)
    if room(name, SANS_IO) is None:
        return
    found = {imported.split(".")[0] for imported, _ in imports(path)} & FORBIDDEN_ON_THE_LINE
    assert not found, f"{name} imports {sorted(found)}"


@pytest.mark.parametrize("name", WALLS_WITHIN)
def test_stories_that_were_told_apart_stay_apart(name: str) -> None:
    path = ROOT / (name.replace(".", "/") + ".py")
    found = {imported for imported, _ in imports(path)} & set(WALLS_WITHIN[name])
    assert not found, f"{name} imports {sorted(found)}"


@pytest.mark.parametrize("path", [p for p in sources("sitl_sim")], ids=module_name)
def test_simulator_uses_the_core_and_only_the_demo_knows_the_daemon(path: Path) -> None:
    name = module_name(path)
    for imported, _ in imports(path):
        layer = room(imported, LAYERS)
        if layer is None or LAYERS[layer] <= 4 or layer in ("ridlink.links", "ridlink.cli"):
            continue
        assert name.startswith("sitl_sim.demo"), f"{name} imports {imported}: only the demo may compose both sides"


@pytest.mark.parametrize("path", [*sources("ridlink"), *sources("sitl_sim")], ids=module_name)
def test_imports_inside_functions_stay_in_commands(path: Path) -> None:
    """A command imports what it needs when it runs, so that ``--help`` is instant; elsewhere it would hide a cycle."""
    name = module_name(path)
    late = [
        imported for imported, inside in imports(path) if inside and imported.split(".")[0] in ("ridlink", "sitl_sim")
    ]
    in_commands = name.startswith(("ridlink.cli", "sitl_sim.cli", "ridlink.__main__"))
    assert not late or in_commands, f"{name} imports {late} inside a function"


@pytest.mark.parametrize("path", [*sources("ridlink"), *sources("sitl_sim")], ids=module_name)
def test_no_cancellation_is_lost(path: Path) -> None:
    """`asyncio.wait_for` of Python 3.11 loses one that comes in the same turn of the loop as its result, and whoever
    waits goes on. Only who waits for the stop itself ends all the same; others use `asyncio.timeout`."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Call) and ast.unparse(node.func) == "asyncio.wait_for":
            assert re.search(r"\b_?stop\.wait\(\)$", ast.unparse(node.args[0])), f"line {node.lineno}"


def test_no_module_cycles() -> None:
    graph: dict[str, set[str]] = {}
    names = {module_name(path) for package in ("ridlink", "sitl_sim") for path in sources(package)}
    for package in ("ridlink", "sitl_sim"):
        for path in sources(package):
            graph[module_name(path)] = {found for found, inside in imports(path) if found in names and not inside}
    state: dict[str, int] = {}

    def visit(node: str, trail: tuple[str, ...]) -> None:
        if state.get(node) == 1:
            raise AssertionError("cycle: " + " -> ".join((*trail[trail.index(node) :], node)))
        if state.get(node) == 2:
            return
        state[node] = 1
        for following in sorted(graph.get(node, ())):
            visit(following, (*trail, node))
        state[node] = 2

    for name in sorted(graph):
        visit(name, ())


def test_architecture_document_names_every_room() -> None:
    text = (ROOT / "ARCHITECTURE.md").read_text()
    for name in LAYERS:
        assert f"`{name.removeprefix('ridlink.')}`" in text, f"ARCHITECTURE.md does not name {name}"
    for path in sorted((ROOT / "sitl_sim").iterdir()):
        if (
            path.name.startswith(("_", "."))
            or (path.suffix not in ("", ".py"))
            or (path.is_dir() and not any(path.glob("*.py")))
        ):
            continue
        assert f"`{path.stem}`" in text, f"ARCHITECTURE.md does not name sitl_sim/{path.name}"


@pytest.mark.parametrize("path", sources("tests"), ids=module_name)
def test_no_module_of_tests_imports_another_one(path: Path) -> None:
    """What tests share stands beside them in modules of its own, which say what they are and collect nothing twice."""
    found = [each for module, names, _ in imported(path) for each in (module, *(f"{module}.{name}" for name in names))]
    assert not [name for name in found if name.startswith("tests.") and ".test_" in name]


AT_THE_TOP = {
    ".ci", ".gitignore", "ARCHITECTURE.md", "CHANGELOG.md", "LICENSE", "Makefile", "NOTICE", "README.md",
    "SAFETY.md", "SECURITY.md", "docs", "examples", "hatch_build.py", "message_spec", "pyproject.toml", "ridlink",
    "sitl_sim", "tests",
}  # fmt: skip
"""All that stands at the top: what somebody tried out there, a recording or an output, is none of it."""


def tracked() -> list[str]:
    done = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True)
    if done.returncode:
        pytest.skip("not a git checkout")
    return done.stdout.split()


def test_no_generated_code_is_tracked() -> None:
    assert "ridlink/mavlink/dialect.py" not in tracked()


def test_nothing_else_is_tracked_at_the_top() -> None:
    assert {path.split("/")[0] for path in tracked()} <= AT_THE_TOP


def test_type_checkers_of_others_read_every_package() -> None:
    packages = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["hatch"]["build"]["targets"]["wheel"][
        "packages"
    ]
    assert len(packages) == 3
    assert [name for name in packages if f"{name}/py.typed" not in tracked()] == []


def test_core_import_is_light() -> None:
    """``import ridlink`` pulls in neither numba nor pymavlink."""
    code = "import sys, ridlink; print([m for m in ('numba', 'pymavlink', 'numpy') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
