"""No campaign of a test that failed flies on beside the tests that follow."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.cli.campaign_process import STARTED


@pytest.fixture(autouse=True)
def ended() -> Iterator[None]:
    yield
    while STARTED:
        process = STARTED.pop()
        if process.poll() is None:
            process.kill()
            process.communicate()
