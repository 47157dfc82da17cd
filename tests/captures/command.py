"""``ridlink decode`` within this process."""

from __future__ import annotations

from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from ridlink.captures import reader
from ridlink.captures.fast.blocks import BlockReader
from ridlink.cli.decode import decode

Outcome = tuple[bytes, str, object, str]
"""Standard output, standard error, exit code, exception."""

NEVER, ALWAYS = 10**12, 0
"""When a file is large."""


def run(*arguments: str | Path) -> Result:
    """The command within this process; its result is the exit code that `main` gives."""
    return CliRunner().invoke(decode, [str(argument) for argument in arguments], standalone_mode=False)


def outcome(large: int, *arguments: str | Path, block_length: int = 1 << 19) -> Outcome:
    """What the command writes and how it ends, where files from so many bytes on are taken in blocks."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(reader, "LARGE_BYTES", large)
        patch.setattr(BlockReader.__init__, "__kwdefaults__", {"block_length": block_length})
        done = run(*arguments)
    return done.stdout_bytes, done.stderr, done.return_value, repr(done.exception)
