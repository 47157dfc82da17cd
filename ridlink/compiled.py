"""Kernels are compiled strictly, once, and kept on disk.

numba keeps compiled code beside the source and checks only whether the *file of that function* has changed. A kernel
contains the code of those it calls, so an edit in one module would leave old code alive in another. Here the stamp of a
kernel covers every module of its package that holds kernels.
"""

from __future__ import annotations

import fcntl
import os
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any

import numpy.ma  # noqa: F401 - numba asks for it at the first array; in two threads at once that recurses for ever
from numba import config, njit, types
from numba.core.caching import CacheImpl, CompileResultCacheImpl, FunctionCache
from numba.core.registry import CPUDispatcher
from numba.core.runtime import rtsys

from ridlink.compiler import InnerCompiler, KernelCompiler

Decorator = Callable[..., Any]

MOST_WAITED_S = 60.0
"""Several times what the compiler takes for the kernels of a solver."""


def kernel_decorator(sources: Iterable[Path], *, counted: bool = True) -> Decorator:
    """A decorator for the kernels of one package.

    Args:
        sources: Files that hold kernels which call each other, and the constants in them.
        counted: False for kernels that make no arrays and return none. The caller holds the arrays that they work on,
            so they need not count references, which costs 10 ns for every view of an array.

    Returns:
        ``kernel(function, *, nogil=False, forceinline=False, fused=False, inner=False)``: compiles with exact
        floating-point rules and keeps the result on disk, if there is a place for it. With `fused` a product and a sum
        may be rounded only once, where the machine can: for answers that do not depend on the last bit. With `nogil`
        other threads of Python go on meanwhile. That is for kernels that take a while: a thread that releases the lock
        may have to wait for it. The caller spreads loops over worlds over threads or processes; numba's own way takes
        seconds more to compile. An `inner` kernel is called by other kernels only: it has no entry from Python, which
        takes as long to compile as many a kernel, and no machine code of its own. With NUMBA_DISABLE_JIT=1 the function
        stays plain Python.
    """
    files = tuple(sources)

    def kernel(
        function: Callable[..., Any] | None = None,
        /,
        *,
        nogil: bool = False,
        forceinline: bool = False,
        fused: bool = False,
        inner: bool = False,
    ) -> Any:
        def compiled(plain: Callable[..., Any]) -> Any:
            options: dict[str, Any] = {"nogil": nogil, "forceinline": forceinline, "error_model": "numpy"}
            options["no_cfunc_wrapper"], options["no_cpython_wrapper"] = True, inner
            options["pipeline_class"] = InnerCompiler if inner else KernelCompiler
            options["fastmath"] = {"contract"} if fused else False
            if not counted:
                options["_nrt"] = False
            dispatcher = njit(**options)(plain)
            if inner and not config.DISABLE_JIT:
                dispatcher.__class__ = _InnerKernel
            if not config.DISABLE_JIT:
                dispatcher.get_call_template = partial(_call_template, dispatcher)
                # If it can be kept neither beside the source nor at home, it is compiled for this process only.
                with suppress(RuntimeError):
                    dispatcher._cache = _KernelCache(plain, files)
            return dispatcher

        return compiled if function is None else compiled(function)

    return kernel


def _call_template(dispatcher: Any, arguments: Any, named: Any) -> Any:
    """Have a kernel compiled for these types of arguments: once for a constant and a variable of the same type."""
    return type(dispatcher).get_call_template(dispatcher, [types.unliteral(one) for one in arguments], named)


class _InnerKernel(CPUDispatcher):  # type: ignore[misc]
    """A kernel without an entry from Python; a call from there would jump to nowhere."""

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        """Refuse.

        Raises:
            TypeError: Always.
        """
        name = self.py_func.__name__
        raise TypeError(
            f"{name} can be called by other kernels only; for plain Python, {name}.py_func or NUMBA_DISABLE_JIT=1"
        )


_NamedFolder: Any = CacheImpl._locator_classes[0]
"""What keeps code in NUMBA_CACHE_DIR; its name differs between versions of numba."""


class _ReadOnlyFolder(_NamedFolder):  # type: ignore[misc]
    """NUMBA_CACHE_DIR in a container with a read-only disk: nothing is added to what was compiled when it was built."""

    def ensure_cache_path(self) -> None:
        """Check that there is such a folder.

        Raises:
            OSError: If there is none.
        """
        os.stat(self.get_cache_path())


class _Placed(CompileResultCacheImpl):  # type: ignore[misc]
    _locator_classes = property(lambda _: [*CacheImpl._locator_classes, _ReadOnlyFolder])


class _KernelCache(FunctionCache):  # type: ignore[misc]
    """Cache of the compiled code of one kernel."""

    _impl_class = _Placed

    def __init__(self, plain: Callable[..., Any], sources: tuple[Path, ...]) -> None:
        super().__init__(plain)
        self.sources = (*sources, Path(__file__), Path(__file__).with_name("compiler.py"))
        self._cache_file._source_stamp = _stamp(self.sources)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Code for these types of arguments; None if there is none.

        numba would first prepare its compiler, and with it look for the linear algebra of SciPy: 0.15 s, and twice as
        much if SciPy is installed. Code that is compiled needs no compiler, only the runtime that counts its
        references.

        A file left half written or empty by a power failure counts as none.
        """
        rtsys.initialize(target_context)
        try:
            with self._guard_against_spurious_io_errors():
                return self._load_overload(sig, target_context)
        except Exception:  # a damaged pickle may raise anything
            with suppress(OSError):
                Path(self._cache_file._index_path).unlink()
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep the code, but not the annotated source of the kernel: 0.1 s in all for the kernels of half-planes.

        If the disk is full, the code lasts as long as this process.
        """
        with suppress(OSError):
            super().save_overload(sig, data._replace(type_annotation=""))


def can_be_kept() -> bool:
    """Whether there is a place on disk for compiled code."""
    try:
        place = _KernelCache(can_be_kept, ())._impl.locator
    except RuntimeError:
        return False
    return not isinstance(place, _ReadOnlyFolder)


@contextmanager
def compiling_alone(kernel: Any) -> Iterator[None]:
    """Wait until no other process compiles into a kernel's folder: what it has compiled need then only be loaded.

    Daemons of several vehicles start together, and each would compile the same. After MOST_WAITED_S the wait ends: the
    other process may have been stopped.
    """
    folder = getattr(getattr(kernel, "_cache", None), "cache_path", None)
    if folder is None or not can_be_kept():  # each process compiles for itself
        yield
        return
    with ExitStack() as until:
        with suppress(OSError):  # folders may have no locks
            Path(folder).mkdir(parents=True, exist_ok=True)
            descriptor = os.open(folder, os.O_RDONLY)
            until.callback(os.close, descriptor)
            latest = time.monotonic() + MOST_WAITED_S
            while not _is_locked(descriptor) and time.monotonic() < latest:
                time.sleep(0.1)
        yield


def _is_locked(descriptor: int) -> bool:
    """Lock a file for us until it is closed; whether that worked."""
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def how_often_compiled() -> str:
    """Text for a user who has to wait: that kernels are compiled once, or why it is at every start."""
    if can_be_kept():
        return "once"
    return "at every start, for it can be kept nowhere: NUMBA_CACHE_DIR may name a folder"


def _stamp(files: tuple[Path, ...]) -> tuple[tuple[int, int], ...]:
    return tuple((status.st_mtime_ns, status.st_size) for status in (file.stat() for file in files if file.exists()))


def is_compiled(dispatcher: Any) -> bool:
    """Whether a call of a kernel needs no compiler: it is in memory, kept on disk for this machine, or plain Python."""
    if not hasattr(dispatcher, "signatures") or dispatcher.signatures:
        return True
    index: Any = getattr(getattr(dispatcher, "_cache", None), "_cache_file", None)
    try:
        machine = dispatcher.targetctx.codegen().magic_tuple()
        return any(key[1] == machine for key in index._load_index())  # a container may have come from another one
    except Exception:  # there is none, or it is damaged, which may raise anything
        return False
