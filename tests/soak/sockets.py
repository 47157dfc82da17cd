"""A plugin of pytest that sees which tests speak over loopback sockets; it leaves its list in RIDLINK_SOCKETS.

It listens to Python's own audit events, so that a test can neither forget to say so nor claim it.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

LOOPBACK = ("127.0.0.1", "::1", "localhost")
VARIABLE = "RIDLINK_SOCKETS"

_opened = [0]
_seen: dict[str, bool] = {}


def _listen(event: str, arguments: tuple[Any, ...]) -> None:
    if event in ("socket.bind", "socket.connect"):
        address = arguments[1]
        _opened[0] += isinstance(address, tuple) and address[0] in LOOPBACK


sys.addaudithook(_listen)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    before = _opened[0]
    result = yield
    name = item.nodeid.partition("[")[0]
    _seen[name] = _seen.get(name, False) or _opened[0] > before
    return result


def pytest_sessionfinish() -> None:
    if VARIABLE in os.environ:
        Path(os.environ[VARIABLE]).write_text(json.dumps(_seen))
