"""How the kernels of this package are compiled: see `ridlink.compiled`."""

from __future__ import annotations

import math
from pathlib import Path

from llvmlite import ir  # type: ignore[import-untyped]
from numba import types
from numba.extending import intrinsic, overload

from ridlink.compiled import kernel_decorator

_MODULES = (
    "contact", "encounter", "graded", "halfplane", "headings", "kernel", "lanes", "meeting", "packing", "priority",
    "programme", "reach", "rotation", "route", "rows", "sift", "worlds",
)  # fmt: skip

kernel = kernel_decorator((Path(__file__).with_name(f"{name}.py") for name in _MODULES), counted=False)


@kernel(forceinline=True)
def norm(a, b):  # type: ignore[no-untyped-def]
    """Length of a vector. `math.hypot` also copes with 1e200 metres, and takes several times as long."""
    return math.sqrt(a * a + b * b)


def larger(a: float, b: float) -> float:
    """The larger of two numbers, of which none is NaN.

    The rules of `max` for NaN and for zeros of two signs forbid the compiler to take the largest of many numbers in any
    other order than one after the other. This one leaves it free to.
    """
    return max(a, b)


def smaller(a: float, b: float) -> float:
    """The smaller of two numbers, of which none is NaN; see `larger`."""
    return min(a, b)


def _in_any_order(name: str):  # type: ignore[no-untyped-def]
    """An instruction of two numbers that takes neither NaN nor the sign of zero into account."""

    @intrinsic
    def instruction(typing_context, a, b):  # type: ignore[no-untyped-def]
        def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
            number = ir.DoubleType()
            function = builder.module.declare_intrinsic(name, [number], ir.FunctionType(number, [number, number]))
            return builder.call(function, arguments, fastmath=("nnan", "nsz"))

        return types.float64(types.float64, types.float64), generate

    return instruction


_maxnum, _minnum = _in_any_order("llvm.maxnum"), _in_any_order("llvm.minnum")


@overload(larger)
def _larger(a, b):  # type: ignore[no-untyped-def]
    return lambda a, b: _maxnum(a, b)


@overload(smaller)
def _smaller(a, b):  # type: ignore[no-untyped-def]
    return lambda a, b: _minnum(a, b)
