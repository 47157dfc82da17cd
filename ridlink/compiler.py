"""numba's compiler, without what no kernel needs.

Where its time goes, for the kernels of half-planes: two thirds into Python, most of it for writing their instructions,
the rest for reading the functions and for their types; a third into LLVM, for reading these, putting each function in
order, optimising kernels with all that they call, and machine code about alike. So what costs is every function and
every set of types that it is compiled for, more than what it does.
"""

from __future__ import annotations

import gc
from collections.abc import Callable
from functools import cache
from inspect import signature
from types import SimpleNamespace
from typing import Any

from numba import types
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.compiler_machinery import PassManager
from numba.core.typed_passes import InlineOverloads, NopythonRewrites
from numba.core.typing import Context
from numba.core.untyped_passes import InlineClosureLikes, InlineInlinables, LiteralUnroll, WithLifting
from numba.extending import lower_builtin, type_callable


class _RememberingContext(Context):  # type: ignore[misc]
    """What the compiler asks for the types of calls, which answers for the same function and arguments but once.

    numba tries every rule that there is for a sum each time that it meets one: a fifth of all its time.
    """

    def __init__(self, context: Context) -> None:
        self.__dict__ |= context.__dict__
        self._known: dict[Any, Any] = {}

    def resolve_function_type(self, func: Any, args: Any, kws: Any) -> Any:
        """Signature of a call, None if there is none for these types."""
        if kws or not isinstance(func, types.Function):
            return super().resolve_function_type(func, args, kws)
        known = self._known.get((func, args))
        if known is None:
            known = self._known[func, args] = super().resolve_function_type(func, args, kws)
        return known


_remembering = cache(_RememberingContext)

_UNUSED = (WithLifting, InlineClosureLikes, InlineInlinables, LiteralUnroll, InlineOverloads, NopythonRewrites)
"""Passes over every function for what kernels have none of: functions in functions, sums of whole arrays, the like."""


class KernelCompiler(Compiler):  # type: ignore[misc]
    """Compiles one kernel, and those that it calls first."""

    def __init__(self, typing_context: Context, *others: Any) -> None:
        super().__init__(_remembering(typing_context), *others)

    def define_pipelines(self) -> list[PassManager]:
        """Passes over a function, in their order."""
        (manager,) = super().define_pipelines()
        manager.passes = [one for one in manager.passes if one[0] not in _UNUSED]
        return [manager]

    def compile_extra(self, func: Any) -> Any:
        """Compile a function. Little of what is left behind is garbage; to look for it would take a tenth more."""
        collects = gc.isenabled()
        gc.disable()
        try:
            return super().compile_extra(func)
        finally:
            if collects:
                gc.enable()


class InnerCompiler(KernelCompiler):
    """Compiles a kernel that only becomes part of others."""

    def compile_extra(self, func: Any) -> Any:
        """Compile a function, as far as it must be before it becomes part of another."""
        self.state.library = _InnerCode(self.state.targetctx.codegen(), func.__qualname__)
        return super().compile_extra(func)


class _InnerCode(JITCodeLibrary):  # type: ignore[misc]
    """Code of an inner kernel: it is optimised, and machine code made of it, as part of others only."""

    @property
    def codegen(self) -> Any:
        """What is told where the machine code finds what it keeps in Python: there is none."""
        return SimpleNamespace(set_env=lambda name, environment: None)

    def _optimize_final_module(self) -> None:
        pass

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        """Address of a function: none."""
        self._ensure_finalized()
        return 0

    def serialize_using_object_code(self) -> Any:
        """What is kept on disk."""
        return self.serialize_using_bitcode()


def instructions_for(plain: Callable[..., Any]) -> Callable[..., Any]:
    """A decorator for the instructions that kernels have in the place of a plain function.

    What it decorates is as for `numba.extending.intrinsic`: from the types of the arguments it gives the signature and
    what writes the instructions. They stand in the caller itself; by way of `numba.extending.overload` each would be a
    function of its own, which takes 20 ms to compile for every kind of caller.
    """

    def register(instructions: Callable[..., Any]) -> Callable[..., Any]:
        @type_callable(plain)  # type: ignore[untyped-decorator]
        def type_call(context: Any) -> Callable[..., Any]:
            def typer(*kinds: Any) -> Any:
                return instructions(context, *kinds)[0]

            typer.__signature__ = signature(plain)  # type: ignore[attr-defined]
            return typer

        @lower_builtin(plain, types.VarArg(types.Any))  # type: ignore[untyped-decorator]
        def write(context: Any, builder: Any, call: Any, arguments: Any) -> Any:
            return instructions(context.typing_context, *call.args)[1](context, builder, call, arguments)

        return instructions

    return register
