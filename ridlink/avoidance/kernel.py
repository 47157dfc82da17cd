"""How the kernels of this package are compiled: once, strictly, and kept on disk.

numba keeps compiled code beside the source and asks only whether the *file of that function* has changed. A kernel
carries the code of those it calls, so an edit in one module would leave old code alive in another. Here a kernel's
stamp covers every module that holds kernels.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from numba import njit

_MODULES = ("halfplane", "programme", "route", "worlds")


def _stamp() -> tuple[tuple[int, int], ...]:
    files = (Path(__file__).with_name(f"{name}.py") for name in _MODULES)
    return tuple((status.st_mtime_ns, status.st_size) for status in (file.stat() for file in files if file.exists()))


def kernel(function: Callable[..., Any] | None = None, *, parallel: bool = False) -> Any:
    """Decorator: compile with exact floating-point rules and keep the result on disk.

    With NUMBA_DISABLE_JIT=1 the function stays plain Python.
    """

    def compiled(plain: Callable[..., Any]) -> Any:
        dispatcher = njit(cache=True, parallel=parallel, fastmath=False, error_model="numpy")(plain)
        index: Any = getattr(getattr(dispatcher, "_cache", None), "_cache_file", None)
        if index is not None and hasattr(index, "_source_stamp"):
            index._source_stamp = _stamp()
        return dispatcher

    return compiled if function is None else compiled(function)
