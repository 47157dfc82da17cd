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

LANE_BITS = LANES.bit_length() - 1

BLOCKS_A_WORD = 64 // LANES
"""Blocks with a bit for each of their lanes in one number."""

kernel = kernel_decorator((Path(__file__).with_name(f"{name}.py") for name in _MODULES), counted=False)


@kernel(forceinline=True)
def norm(a, b):  # type: ignore[no-untyped-def]
    """Length of a vector. `math.hypot` also copes with 1e200 metres, and takes several times as long."""
    return math.sqrt(a * a + b * b)


@kernel(forceinline=True, inner=True)
def block_of(place):  # type: ignore[no-untyped-def]
    """Block of a neighbour by its place, which is not negative: a division does not know that, and costs more."""
    return place >> LANE_BITS


@kernel(forceinline=True, inner=True)
def lane_of(place):  # type: ignore[no-untyped-def]
    """Its lane in that block."""
    return place & (LANES - 1)


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


def lanes_from(source: np.ndarray, at: int, least: float) -> int:
    """Which of LANES numbers from `source[at:]` on, contiguous float64, are not less than `least`: a bit for each."""
    return sum(int(source[at + k] >= least) << k for k in range(LANES))


@intrinsic
def _lanes_from(typing_context, source, at, least):  # type: ignore[no-untyped-def]
    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        data = context.make_array(signature.args[0])(context, builder, arguments[0]).data
        lanes = ir.VectorType(ir.DoubleType(), LANES)
        numbers = builder.load(builder.bitcast(builder.gep(data, [arguments[1]]), lanes.as_pointer()), align=8)
        each = ir.Constant(lanes, ir.Undefined)
        for k in range(LANES):
            each = builder.insert_element(each, arguments[2], ir.Constant(ir.IntType(32), k))
        met = builder.fcmp_ordered(">=", numbers, each)
        return builder.zext(builder.bitcast(met, ir.IntType(LANES)), ir.IntType(64))

    return types.int64(source, types.intp, types.float64), generate


@overload(lanes_from)
def _lanes_from_compiled(source, at, least):  # type: ignore[no-untyped-def]
    return lambda source, at, least: _lanes_from(source, at, least)


def lowest_bit(bits: int) -> int:
    """Place of the lowest bit that is set; some must be."""
    return (bits & -bits).bit_length() - 1


@intrinsic
def _lowest_bit(typing_context, bits):  # type: ignore[no-untyped-def]
    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        return builder.cttz(arguments[0], ir.Constant(ir.IntType(1), 1))

    return types.int64(types.int64), generate


@overload(lowest_bit)
def _lowest_bit_compiled(bits):  # type: ignore[no-untyped-def]
    return lambda bits: _lowest_bit(bits)
