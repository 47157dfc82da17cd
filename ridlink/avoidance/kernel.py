"""How the kernels of this package are compiled: see `ridlink.compiled`."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

from llvmlite import ir  # type: ignore[import-untyped]
from numba import types

from ridlink.compiled import kernel_decorator
from ridlink.compiler import instructions_for

kernel = kernel_decorator(sorted(Path(__file__).parent.glob("*.py")), counted=False)


@kernel(forceinline=True)
def norm(a, b):  # type: ignore[no-untyped-def]
    """Length of a vector. `math.hypot` also copes with 1e200 metres, and takes several times as long."""
    return math.sqrt(a * a + b * b)


@kernel(forceinline=True, inner=True)
def larger(a, b):  # type: ignore[no-untyped-def]
    """The larger of two numbers, neither of which is NaN.

    The rules of `max` for NaN and for zeros of two signs force the compiler to take the largest of many numbers one
    after the other; here the order is free. It stays a call until everything round it has been put in order: with the
    instruction there from the beginning, a decision took 13 % longer.
    """
    return _maximum(a, b)


@kernel(forceinline=True, inner=True)
def smaller(a, b):  # type: ignore[no-untyped-def]
    """The smaller of two numbers, neither of which is NaN; see `larger`."""
    return _minimum(a, b)


def _maximum(a: float, b: float) -> float:
    return max(a, b)


def _minimum(a: float, b: float) -> float:
    return min(a, b)


def _in_any_order(plain: Callable[[float, float], float], name: str) -> None:
    """Compile a function as an instruction of two numbers that ignores NaN and the sign of zero."""

    @instructions_for(plain)
    def instruction(typing_context, a, b):  # type: ignore[no-untyped-def]
        def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
            number = ir.DoubleType()
            function = builder.module.declare_intrinsic(name, [number], ir.FunctionType(number, [number, number]))
            return builder.call(function, arguments, fastmath=("nnan", "nsz"))

        return types.float64(types.float64, types.float64), generate


_in_any_order(_maximum, "llvm.maxnum")
_in_any_order(_minimum, "llvm.minnum")
