"""numba's compiler, without what no kernel needs.

Where its time goes, for the kernels of half-planes: two thirds in Python, most of it to write their instructions, the
rest to read the functions and find their types; a third in LLVM, about alike for reading the instructions, for putting
each function in order, for optimising kernels with all that they call, and for machine code. So every function costs,
and every set of types that it is compiled for, more than what it does.
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
    """Typing context that answers only once for the same function and arguments.

    Each time that it meets a sum, numba tries every rule for one: a fifth of all its time.
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
"""Passes over every function for what no kernel has: functions in functions, sums of whole arrays, the like."""


class KernelCompiler(Compiler):  # type: ignore[misc]
    """Compiles one kernel, after those that it calls."""

    def __init__(self, typing_context: Context, *others: Any) -> None:
        super().__init__(_remembering(typing_context), *others)

    def define_pipelines(self) -> list[PassManager]:
        """Passes over a function, in their order."""
        (manager,) = super().define_pipelines()
        manager.passes = [one for one in manager.passes if one[0] not in _UNUSED]
        return [manager]

    def compile_extra(self, func: Any) -> Any:
        """Compile a function, without the garbage collector: it finds little, and would take a tenth more time."""
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
        """Compile a function only as far as needed before it becomes part of another."""
        self.state.library = _InnerCode(self.state.targetctx.codegen(), func.__qualname__)
        return super().compile_extra(func)


class _InnerCode(JITCodeLibrary):  # type: ignore[misc]
    """Code of an inner kernel, which is optimised and made machine code only as part of others."""

    @property
    def codegen(self) -> Any:
        """Stand-in that ignores where machine code finds what it keeps in Python: there is none."""
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
        """Code to keep on disk: the bitcode."""
        return self.serialize_using_bitcode()


def instructions_for(plain: Callable[..., Any]) -> Callable[..., Any]:
    """A decorator for the instructions that kernels use in place of a plain function.

    It decorates a function as for `numba.extending.intrinsic`, which returns, for the types of the arguments, the
    signature and a function that writes the instructions. The instructions stand in the caller itself. With
    `numba.extending.overload` each would be a function of its own, which takes 20 ms to compile for every kind of
    caller.
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
