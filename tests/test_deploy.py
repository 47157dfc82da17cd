"""The files that run the daemon as a service say what the program understands."""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner

from ridlink.cli import cli
from ridlink.daemon.config import daemon_config
from ridlink.daemon.config_file import read_config_file

PROJECT = Path(__file__).resolve().parents[1]
DEPLOY = PROJECT / "examples" / "deploy"


def test_the_configuration_is_one_that_the_daemon_takes() -> None:
    config = daemon_config(read_config_file(DEPLOY / "alpha.toml"))
    assert config.engine.vehicle_sysid == 1
    assert config.engine.cruise_mps <= config.engine.limits.horizontal_mps


@pytest.mark.parametrize("file", ["ridlink-avoid@.service", "README.md", "Dockerfile"])
def test_every_command_and_option_in_it_exists(file: str) -> None:
    text = (DEPLOY / file).read_text().replace("\n--", " --")
    commands = re.findall(r"(?:bin/)?ridlink ((?:avoid|doctor)[^`\n]*)", text)
    assert commands
    for line in commands:
        name, *words = shlex.split(line.rstrip('",&'))
        shown = CliRunner().invoke(cli, [name, "--help"]).output
        for option in (word for word in words if word.startswith("--")):
            assert re.search(rf"{re.escape(option)}\b", shown), f"{name} has no {option}"


def test_what_the_container_is_given_lies_where_the_image_is_built() -> None:
    """The engine makes an empty folder of a file that is not there, and mounts that."""
    given = re.findall(r" -v \./(\S+?):", (DEPLOY / "Dockerfile").read_text())
    assert given
    for name in given:
        assert (PROJECT / name).is_file(), name


def test_an_image_is_not_built_from_what_git_does_not_keep() -> None:
    """A folder of environments and caches is copied for minutes, and each run of the tests would make another image."""
    wanted = {
        pattern.rstrip("/") if "/" in pattern.rstrip("/") else f"**/{pattern.rstrip('/')}"
        for pattern in (PROJECT / ".gitignore").read_text().split("\n")
        if pattern and not pattern.startswith("#")
    }
    left_out = set((DEPLOY / "Dockerfile.dockerignore").read_text().splitlines())
    assert left_out >= wanted | {".git"}


def test_a_configuration_that_is_refused_is_not_tried_again(tmp_path: Path) -> None:
    wrong = tmp_path / "wrong.toml"
    wrong.write_text('vehicel = "udpin:127.0.0.1:0"\n')
    command = [sys.executable, "-m", "ridlink", "avoid", "--config", str(wrong), "--standby"]
    refused = subprocess.run(command, capture_output=True, timeout=60)
    final = re.search(r"^RestartPreventExitStatus=(.*)$", (DEPLOY / "ridlink-avoid@.service").read_text(), re.MULTILINE)
    assert final is not None and final.group(1).split() == [str(refused.returncode)]


def test_no_instance_takes_the_folders_of_another() -> None:
    """With DynamicUser each is another user, to whom systemd gives them when it starts."""
    unit = dict(re.findall(r"^(\w+)=(.*)$", (DEPLOY / "ridlink-avoid@.service").read_text(), re.MULTILINE))
    assert unit["DynamicUser"] == "yes"
    assert unit["CacheDirectory"].endswith("/%i") and unit["StateDirectory"].endswith("/%i")
    assert unit["Environment"] == f"NUMBA_CACHE_DIR=/var/cache/{unit['CacheDirectory']}"
    assert unit["WorkingDirectory"] == f"/var/lib/{unit['StateDirectory']}"


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd-analyze is not installed")
def test_the_unit_is_one_that_systemd_takes(tmp_path: Path) -> None:
    unit = (DEPLOY / "ridlink-avoid@.service").read_text().replace("/opt/ridlink/bin/ridlink", "/bin/true")
    path = tmp_path / "ridlink-avoid@alpha.service"
    path.write_text(unit)
    done = subprocess.run(["systemd-analyze", "verify", str(path)], capture_output=True, text=True, timeout=60)
    said = [line for line in done.stderr.splitlines() if path.name in line]
    assert done.returncode == 0 and not said, done.stderr
