"""Kernels are compiled strictly, once, and kept on disk.

numba keeps compiled code beside the source and asks only whether the *file of that function* has changed. A kernel
carries the code of those it calls, so an edit in one module would leave old code alive in another. Here a kernel's
stamp covers every module that holds kernels of its package.
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

from numba import config, njit, types
from numba.core.caching import FunctionCache
from numba.core.registry import CPUDispatcher
from numba.core.runtime import rtsys

from ridlink.compiler import InnerCompiler, KernelCompiler

Decorator = Callable[..., Any]

MOST_WAITED_S = 60.0
"""Several times what the compiler takes for the kernels of a solver."""


def kernel_decorator(sources: Iterable[Path], *, counted: bool = True) -> Decorator:
    """A decorator for the kernels of one package.

    Args:
        sources: The files that hold kernels which call each other, and the constants in them.
        counted: False for kernels that make no arrays and give none back: the caller holds what they work on, so they
            need not count references, which costs 10 ns for every view of an array.

    Returns:
        ``kernel(function, *, nogil=False, forceinline=False, fused=False, inner=False)``: compiles with exact
        floating-point rules and keeps the result on disk, where there is a place for it. With `fused` a product and a
        sum may be rounded but once, where the machine can: for answers that do not hang on the last bit. With `nogil`
        other threads of Python go on meanwhile, which is for kernels that take a while: whoever lets go of the lock may
        have to wait for it. Loops over worlds are spread over threads or processes by the caller; numba's own way of it
        takes seconds more to compile. An `inner` kernel is called by other kernels only: it has no way in from Python,
        which takes as long to compile as many a kernel, and no machine code of its own. With NUMBA_DISABLE_JIT=1 the
        function stays plain Python.
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
                # Where it can be kept neither beside the source nor at home, it is compiled for this process.
                with suppress(RuntimeError):
                    dispatcher._cache = _KernelCache(plain, files)
            return dispatcher

        return compiled if function is None else compiled(function)

    return kernel


def _call_template(dispatcher: Any, arguments: Any, named: Any) -> Any:
    """Have a kernel compiled for these types of arguments: once for a constant and a variable of its type."""
    return type(dispatcher).get_call_template(dispatcher, [types.unliteral(one) for one in arguments], named)


class _InnerKernel(CPUDispatcher):  # type: ignore[misc]
    """A kernel without a way in from Python, which would be a jump to nowhere."""

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        """Refuse.

        Raises:
            TypeError: Always.
        """
        name = self.py_func.__name__
        raise TypeError(
            f"{name} can be called by other kernels only; for plain Python, {name}.py_func or NUMBA_DISABLE_JIT=1"
        )


class _KernelCache(FunctionCache):  # type: ignore[misc]
    """Where the compiled code of one kernel is kept."""

    def __init__(self, plain: Callable[..., Any], sources: tuple[Path, ...]) -> None:
        super().__init__(plain)
        self.sources = (*sources, Path(__file__), Path(__file__).with_name("compiler.py"))
        self._cache_file._source_stamp = _stamp(self.sources)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The code for these types of arguments, None if there is none.

        numba would first make its compiler ready, and with it look for the linear algebra of SciPy: 0.15 s, and twice
        as much where SciPy is installed. What has been compiled needs no compiler, only who counts its references.

        What power that failed has left half written, or empty, is as good as nothing.
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

        Where the disk is full, it lasts as long as this process.
        """
        with suppress(OSError):
            super().save_overload(sig, data._replace(type_annotation=""))


def can_be_kept() -> bool:
    """Whether there is a place on disk for what is compiled."""
    try:
        _KernelCache(can_be_kept, ())
    except RuntimeError:
        return False
    return True


@contextmanager
def compiling_alone(kernel: Any) -> Iterator[None]:
    """Wait until no other process compiles into the folder of a kernel: what it has compiled need only be loaded then.

    Daemons of several vehicles start together, and each would compile the same. Whoever has waited for MOST_WAITED_S
    waits no longer: the other one may have been stopped.
    """
    with ExitStack() as until:
        # Where nothing is kept, or folders know no locks, each compiles for itself.
        with suppress(AttributeError, OSError):
            folder = kernel._cache.cache_path
            Path(folder).mkdir(parents=True, exist_ok=True)
            descriptor = os.open(folder, os.O_RDONLY)
            until.callback(os.close, descriptor)
            latest = time.monotonic() + MOST_WAITED_S
            while not _is_locked(descriptor) and time.monotonic() < latest:
                time.sleep(0.1)
        yield


def _is_locked(descriptor: int) -> bool:
    """Whether a file is ours alone now, until it is closed."""
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def how_often_compiled() -> str:
    """For whoever has to wait: that it is for once, or why it is not."""
    if can_be_kept():
        return "once"
    return "at every start, for it can be kept nowhere: NUMBA_CACHE_DIR may name a folder"


def _stamp(files: tuple[Path, ...]) -> tuple[tuple[int, int], ...]:
    return tuple((status.st_mtime_ns, status.st_size) for status in (file.stat() for file in files if file.exists()))


def is_compiled(dispatcher: Any) -> bool:
    """Whether calling a kernel needs no compiler: it is in memory, kept on disk for this machine, or plain Python."""
    if not hasattr(dispatcher, "signatures") or dispatcher.signatures:
        return True
    index: Any = getattr(getattr(dispatcher, "_cache", None), "_cache_file", None)
    try:
        machine = dispatcher.targetctx.codegen().magic_tuple()
        return any(key[1] == machine for key in index._load_index())  # a container may have come from another one
    except Exception:  # there is none, or it is damaged, which may raise anything
        return False
