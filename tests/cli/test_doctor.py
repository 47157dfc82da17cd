"""``ridlink doctor`` as a user runs it."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest


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
