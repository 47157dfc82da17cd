"""``ridlink doctor`` as a user runs it."""

from __future__ import annotations

import json
import os
import pty
import subprocess
import sys

import pytest

from ridlink.avoidance.solver import warm_up
from ridlink.avoidance.types import SolverKind
from ridlink.cli.doctor import _show
from ridlink.doctor.finding import Finding, Verdict


@pytest.fixture(scope="module", autouse=True)
def _compiled() -> None:
    """Kernels that are compiled take longer than a doctor may."""
    warm_up(SolverKind.HALFPLANE)


def doctor(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "ridlink", "doctor", *arguments], capture_output=True, text=True, timeout=60
    )


def test_this_machine_is_examined_and_stdout_is_one_object() -> None:
    done = doctor("--json")
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout)
    assert report["fit"] is True
    assert {"interpreter", "receive buffer", "solver"} <= {finding["name"] for finding in report["findings"]}


def test_a_vehicle_that_is_not_there_is_exit_code_1() -> None:
    done = doctor("--vehicle", "udpin:127.0.0.1:0")
    assert done.returncode == 1
    assert done.stdout.splitlines()[-1].startswith("not fit to fly")


@pytest.mark.parametrize("option", ["--vehicle", "--rid"])
def test_a_wrong_link_is_one_line(option: str) -> None:
    done = doctor(option, "udp:127.0.0.1:14540")
    assert done.returncode == 2
    assert "udpin:127.0.0.1:14540" in done.stderr and done.stderr.count("\n") == 1
    assert not done.stdout


@pytest.mark.parametrize(("said", "coloured"), [({}, True), ({"NO_COLOR": ""}, True), ({"NO_COLOR": "1"}, False)])
def test_who_wants_no_colour_on_a_terminal_gets_none(said: dict[str, str], coloured: bool) -> None:
    ours, theirs = pty.openpty()
    environment = {name: value for name, value in os.environ.items() if name != "NO_COLOR"} | said
    try:
        command = [sys.executable, "-m", "ridlink", "doctor"]
        subprocess.run(command, stdout=theirs, env=environment, timeout=60)
        assert (b"\x1b" in os.read(ours, 65536)) is coloured
    finally:
        os.close(ours)
        os.close(theirs)


def test_texts_stand_in_one_column_below_each_other(capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("GNSS", "MPC_Z_VEL_MAX_DN", "Remote ID on the bus"):
        _show(Finding(name, Verdict.WARNING, "a text", "a remedy"))
    lines = capsys.readouterr().out.splitlines()
    assert len({line.index("a text") for line in lines[::2]} | {line.index("->") for line in lines[1::2]}) == 1
