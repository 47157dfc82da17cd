"""What the documents show of other libraries hears an emulated fleet, as it is printed."""

from __future__ import annotations

import asyncio
import importlib.util
import inspect
import re
import sys
import textwrap
from pathlib import Path

import pytest

from ridlink.scenario import EVENTS, built_in
from sitl_sim.cli.sim_command import _verdict
from sitl_sim.demo import flight
from sitl_sim.fleet_config import Start
from sitl_sim.server import FleetServer
from tests.sitl_sim.fleets import fly

ROOT = Path(__file__).resolve().parents[2]


def program(document: str, beginning: str, port: int, instead_of: int) -> str:
    """The indented block of a document that begins so, with another port."""
    text = (ROOT / document).read_text()
    at = text.index("    " + beginning)
    lines = []
    for line in text[at:].splitlines():
        if line and not line.startswith("    "):
            break
        lines.append(line)
    found = textwrap.dedent("\n".join(lines))
    assert f"127.0.0.1:{instead_of}" in found
    return found.replace(f":{instead_of}", f":{port}")


async def printed(text: str, folder: Path) -> str:
    script = folder / "shown.py"
    script.write_text(text)
    process = await asyncio.create_subprocess_exec(
        sys.executable, str(script), cwd=folder, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.PIPE
    )
    output, complaints = await process.communicate()
    assert process.returncode == 0, complaints.decode()
    return output.decode()


def test_mavutil_hears_separation_as_the_specification_shows(tmp_path: Path) -> None:
    from ridlink.mavlink import dialect

    assert dialect.__file__ is not None
    (tmp_path / "ridlink_dialect.py").write_text(Path(dialect.__file__).read_text())

    async def act(server: FleetServer) -> None:
        text = program("message_spec/README.md", "from pymavlink import mavutil", server.ports.air, 14650)
        assert await printed(text, tmp_path) == "1 10.5 m 0.6 m\n"

    fly(built_in("circle8", 1), act, start=Start.AIRBORNE)


def keys_of(facts: object) -> set[str]:
    """Keys of JSON, of all that is within it as well."""
    if isinstance(facts, dict):
        return set(facts).union(*map(keys_of, facts.values()))
    return set().union(*map(keys_of, facts)) if isinstance(facts, list) else set()


def test_the_document_names_every_key_of_the_lines() -> None:
    text = (ROOT / "docs/emulator.md").read_text()
    section = text.partition("## What `--json` says")[2].partition("\n## ")[0]
    named = set(re.findall(r"`(\w+)`", section))

    async def act(server: FleetServer) -> None:
        assert {"ports", *keys_of(server.snapshot()), *keys_of(_verdict(server))} <= named

    fly(built_in("head-on"), act, start=Start.AIRBORNE)
    of_flight = re.findall(r'"(\w+)"', inspect.getsource(flight._result).partition("return {")[2])
    assert set(of_flight) <= named


@pytest.mark.skipif(importlib.util.find_spec("mavsdk") is None, reason="the extra mavsdk is not installed")
def test_mavsdk_reads_telemetry_as_the_document_shows(tmp_path: Path) -> None:
    async def act(server: FleetServer) -> None:
        text = program("docs/emulator.md", "import asyncio\n    from mavsdk", server.ports.vehicles[0], 14580)
        assert "north_m_s" in await printed(text, tmp_path)

    fly(built_in("circle8", 1), act)


def test_the_document_names_every_fault_with_its_figures() -> None:
    rows = ["| `what` | figures |", "| --- | --- |"]
    for what, figures in EVENTS.items():
        told = [f"`{name}`" + ("" if one.default is None else f" ({one.default:g})") for name, one in figures.items()]
        rows.append(f"| `{what}` | {', '.join(told) or 'none'} |")
    assert "\n".join(rows) + "\n\n" in (ROOT / "docs/emulator.md").read_text()
