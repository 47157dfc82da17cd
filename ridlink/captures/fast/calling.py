"""How Python calls the kernels: with plain values if there is no compiler, and with a notice before the compiler
runs."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
from numba import config

from ridlink.compiled import how_often_compiled, is_compiled


def plain(array: np.ndarray) -> Any:
    """What a kernel is given: the array, or without a compiler what gives plain integers."""
    if not config.DISABLE_JIT:
        return array
    return array.data if array.dtype == np.uint8 else array.tolist()


def announce(kernel: Any, what: str = "the decoder") -> None:
    """Say that the compiler runs, before it is waited for."""
    if not is_compiled(kernel):
        sys.stderr.write(f"ridlink: compiling {what} ({how_often_compiled()}; a few seconds) ...\n")
        sys.stderr.flush()
