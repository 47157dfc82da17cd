"""How the kernels of this package are compiled: see `ridlink.compiled`."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from llvmlite import ir  # type: ignore[import-untyped]
from numba import types
from numba.extending import intrinsic, overload

from ridlink.avoidance.rows import LANES
from ridlink.compiled import kernel_decorator

_MODULES = (
    "contact", "encounter", "graded", "halfplane", "headings", "kernel", "meeting", "packing", "priority", "programme",
    "reach", "rotation", "route", "rows", "sift", "worlds",
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


def copy_lanes(source: np.ndarray, at: int, target: np.ndarray, to: int) -> None:
    """Copy LANES numbers from `source[at:]` to `target[to:]`, both contiguous and of one axis, float64 or int8.

    The compiler cannot know that two arrays do not overlap, and would copy one number after the other.
    """
    target[to : to + LANES] = source[at : at + LANES]


@intrinsic
def _copy_lanes(typing_context, source, at, target, to):  # type: ignore[no-untyped-def]
    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        places = []
        for array, index, kind in ((0, 1, signature.args[0]), (2, 3, signature.args[2])):
            data = context.make_array(kind)(context, builder, arguments[array]).data
            lanes = ir.VectorType(data.type.pointee, LANES)
            places.append(builder.bitcast(builder.gep(data, [arguments[index]]), lanes.as_pointer()))
        numbers = builder.load(places[0], align=1)
        if numbers.type != lanes:
            convert = builder.fptosi if lanes.element == ir.IntType(8) else builder.sitofp
            numbers = convert(numbers, lanes)
        builder.store(numbers, places[1], align=1)
        return context.get_dummy_value()

    return types.void(source, types.intp, target, types.intp), generate


@overload(copy_lanes)
def _copy_lanes_compiled(source, at, target, to):  # type: ignore[no-untyped-def]
    return lambda source, at, target, to: _copy_lanes(source, at, target, to)
