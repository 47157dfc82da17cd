"""The command in this process; and no campaign of a test that failed flies on beside the tests that follow."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator

import pytest

from ridlink.cli import main
from tests.cli.campaign_process import STARTED

Ridlink = Callable[..., tuple[int, str, str]]


@pytest.fixture
def ridlink(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> Ridlink:
    """``ridlink`` in this process: exit code, standard output, standard error."""

    def run(*arguments: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["ridlink", *map(str, arguments)])
        capfd.readouterr()
        with pytest.raises(SystemExit) as end:
            main()
        out, err = capfd.readouterr()
        return int(end.value.code or 0), out, err

    return run


@pytest.fixture(autouse=True)
def ended() -> Iterator[None]:
    yield
    while STARTED:
        process = STARTED.pop()
        if process.poll() is None:
            process.kill()
            process.communicate()
