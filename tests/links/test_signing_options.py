"""Which keys are taken, and what is said of the others."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from ridlink.errors import ConfigError
from ridlink.links.signing_options import read_key
from tests.links.conftest import KEY


def test_f34_a_key_is_taken_from_its_owners_file_alone(key_file: Path) -> None:
    assert read_key(key_file) == KEY
    key_file.write_text(KEY.hex() + "\n")
    assert read_key(key_file) == KEY
    for mode in (0o644, 0o640, 0o660, 0o604):
        key_file.chmod(mode)
        with pytest.raises(ConfigError, match=r"mode 0600; chmod 600"):
            read_key(key_file)
    key_file.chmod(0o600)
    for content in (b"", b"short", KEY + b"x", b"zz" * 32):
        key_file.write_bytes(content)
        with pytest.raises(ConfigError, match="64 hexadecimal digits"):
            read_key(key_file)


@pytest.mark.parametrize(
    ("arguments", "mode", "code", "says"),
    [
        (["--signing-key", "{key}"], 0o644, 2, "chmod 600"),
        (
            ["--signing-key", "{key}.gone"],
            0o600,
            3,
            "key.gone: no such signing key; make one with (umask",
        ),
        (["--require-signature"], 0o600, 2, "give signing-key"),
    ],
)
@pytest.mark.parametrize("command", [["avoid", "--standby"], ["broadcast"]])
def test_a_key_that_cannot_be_used_is_one_line(
    key_file: Path, command: list[str], arguments: list[str], mode: int, code: int, says: str
) -> None:
    key_file.chmod(mode)
    options = [argument.format(key=key_file) for argument in arguments]
    done = subprocess.run(
        [sys.executable, "-m", "ridlink", *command, "--vehicle", "udpin:127.0.0.1:0", *options],
        capture_output=True, text=True, timeout=60,
    )  # fmt: skip
    assert (done.returncode, done.stdout) == (code, "")
    assert says in done.stderr and done.stderr.count("\n") == 1
