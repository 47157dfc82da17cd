"""How the kernels of this package are compiled: see `ridlink.compiled`."""

from __future__ import annotations

import math
from pathlib import Path

from ridlink.compiled import kernel_decorator

_MODULES = ("graded", "halfplane", "headings", "programme", "rotation", "route", "rows", "worlds")

kernel = kernel_decorator(Path(__file__).with_name(f"{name}.py") for name in _MODULES)


@kernel(forceinline=True)
def norm(a, b):  # type: ignore[no-untyped-def]
    """Length of a vector. `math.hypot` also copes with 1e200 metres, and takes several times as long."""
    return math.sqrt(a * a + b * b)
