"""Inner kernels, which have no way in from Python, for tests to call."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba import njit


def way_in(inner: Callable[..., Any]) -> Callable[..., Any]:
    """The same function with a way in."""

    @njit
    def outer(*arguments):  # type: ignore[no-untyped-def]
        return inner(*arguments)

    return outer
