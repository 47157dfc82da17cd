"""How the kernels of this package are compiled: see `ridlink.compiled`."""

from __future__ import annotations

from pathlib import Path

from ridlink.compiled import kernel_decorator

_MODULES = ("graded", "halfplane", "headings", "programme", "rotation", "route", "rows", "worlds")

kernel = kernel_decorator(Path(__file__).with_name(f"{name}.py") for name in _MODULES)
