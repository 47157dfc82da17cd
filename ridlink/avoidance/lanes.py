"""Operations on all lanes of a block at once, and numbers with a bit for each lane; see `rows`.

The compiler takes several numbers in one instruction if it can be certain of what they are. Here it is told. Every
operation is written twice, as plain Python and as instructions, and both do the same.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from llvmlite import ir  # type: ignore[import-untyped]
from numba import types
from numba.core import cgutils

from ridlink.avoidance.kernel import kernel
from ridlink.avoidance.rows import LANES
from ridlink.compiler import instructions_for

LANE_BITS = LANES.bit_length() - 1

BLOCKS_A_WORD = 64 // LANES
"""Blocks whose lanes have a bit each in one number."""


def _together(builder: ir.IRBuilder, numbers: list[ir.Value]) -> ir.Value:
    """Vector of numbers of one type, one in each lane."""
    lanes = ir.Constant(ir.VectorType(numbers[0].type, LANES), ir.Undefined)
    for k, number in enumerate(numbers):
        lanes = builder.insert_element(lanes, number, ir.Constant(ir.IntType(32), k))
    return lanes


@kernel(forceinline=True, inner=True)
def block_of(place):  # type: ignore[no-untyped-def]
    """Block of a neighbour, by its place. A place is not negative; a division cannot assume that, and costs more."""
    return place >> LANE_BITS


@kernel(forceinline=True, inner=True)
def lane_of(place):  # type: ignore[no-untyped-def]
    """Lane of a neighbour in its block, by its place."""
    return place & (LANES - 1)


def copy_lanes(source: np.ndarray, at: int, target: np.ndarray, to: int) -> None:
    """Copy LANES numbers from `source[at:]` to `target[to:]`, both contiguous and of one axis, float64 or int8.

    Without it the compiler, which cannot know that the arrays do not overlap, copies one number after the other.
    """
    target[to : to + LANES] = source[at : at + LANES]


@instructions_for(copy_lanes)
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


def gather_lanes(
    source: np.ndarray, place_0: int, place_1: int, place_2: int, place_3: int, column: int, target: np.ndarray
) -> None:
    """Copy a column of four neighbours, by their places in the blocks of `source`, to the lanes of one block, `target`.

    All four are read before they are written, and written in one piece. A read in one piece soon after a write in
    several has to wait until these have left the processor.
    """
    places = place_0, place_1, place_2, place_3
    target[column : column + LANES] = [source[place // LANES, column + place % LANES] for place in places]


@instructions_for(gather_lanes)
def _gather_lanes(  # type: ignore[no-untyped-def]
    typing_context, source, place_0, place_1, place_2, place_3, column, target
):
    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        table = context.make_array(signature.args[0])(context, builder, arguments[0])
        data = context.make_array(signature.args[6])(context, builder, arguments[6]).data
        width, column = builder.extract_value(table.shape, 1), arguments[5]
        numbers = []
        for place in arguments[1:5]:
            block = builder.ashr(place, ir.Constant(place.type, LANE_BITS))
            lane = builder.and_(place, ir.Constant(place.type, LANES - 1))
            at = builder.add(builder.add(builder.mul(block, width), lane), column)
            numbers.append(builder.load(builder.gep(table.data, [at])))
        lanes = _together(builder, numbers)
        # Without a fence two halves would be stored.
        fence = cgutils.get_or_insert_function(
            builder.module, ir.FunctionType(lanes.type, [lanes.type]), f"llvm.arithmetic.fence.v{LANES}f64"
        )
        place = builder.bitcast(builder.gep(data, [column]), lanes.type.as_pointer())
        builder.store(builder.call(fence, [lanes]), place, align=8)
        return context.get_dummy_value()

    return types.void(source, *[types.intp] * 5, target), generate


def turn_lanes(
    source: np.ndarray, row: int, column: int, target: np.ndarray, to_0: int, to_1: int, to_2: int, to_3: int
) -> None:
    """Transpose four columns of four rows of `source` into four columns of one block, one lane for each row."""
    for k, to in enumerate((to_0, to_1, to_2, to_3)):
        target[to : to + LANES] = source[row : row + LANES, column + k]


@instructions_for(turn_lanes)
def _turn_lanes(typing_context, source, row, column, target, to_0, to_1, to_2, to_3):  # type: ignore[no-untyped-def]
    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        table = context.make_array(signature.args[0])(context, builder, arguments[0])
        data = context.make_array(signature.args[3])(context, builder, arguments[3]).data
        lanes, place = ir.VectorType(ir.DoubleType(), LANES), ir.VectorType(ir.IntType(32), LANES)
        width = builder.extract_value(table.shape, 1)
        at = builder.add(builder.mul(arguments[1], width), arguments[2])
        rows = []
        for _ in range(LANES):
            rows.append(builder.load(builder.bitcast(builder.gep(table.data, [at]), lanes.as_pointer()), align=8))
            at = builder.add(at, width)

        def mixed(a: ir.Value, b: ir.Value, places: list[int]) -> ir.Value:
            return builder.shuffle_vector(a, b, ir.Constant(place, places))

        evens, odds = [0, 4, 2, 6], [1, 5, 3, 7]
        halves = [(mixed(rows[k], rows[k + 1], evens), mixed(rows[k], rows[k + 1], odds)) for k in (0, 2)]
        columns = [mixed(halves[0][k], halves[1][k], side) for side in ([0, 1, 4, 5], [2, 3, 6, 7]) for k in (0, 1)]
        for to, numbers in zip(arguments[4:], columns, strict=True):
            builder.store(numbers, builder.bitcast(builder.gep(data, [to]), lanes.as_pointer()), align=8)
        return context.get_dummy_value()

    return types.void(source, types.intp, types.intp, target, *[types.intp] * 4), generate


_PACKED = [[k for k in range(LANES) if bits >> k & 1] + [0] * (LANES - bits.bit_count()) for bits in range(1 << LANES)]
"""Lanes whose bit is set, one after the other, then zeros; by the bits."""


def pack_lanes(bits: int, first: int, places: np.ndarray, to: int) -> None:
    """Write the places of those lanes of a block whose bit is set to `places[to:]`, int64, one after the other.

    LANES places are written, however many bits are set: the end of a loop over bits cannot be predicted.

    Args:
        bits: A bit for each lane, as `lanes_from` gives them.
        first: Place of the first lane.
        places: Result.
        to: Where to begin in it.
    """
    places[to : to + LANES] = [first + lane for lane in _PACKED[bits]]


@instructions_for(pack_lanes)
def _pack_lanes(typing_context, bits, first, places, to):  # type: ignore[no-untyped-def]
    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        bits, first, _, to = arguments
        lanes = ir.VectorType(first.type, LANES)
        rows = [ir.Constant(lanes, row) for row in _PACKED]
        table = cgutils.global_constant(builder, "packed_lanes", ir.Constant(ir.ArrayType(lanes, len(rows)), rows))
        packed = builder.load(builder.gep(table, [ir.Constant(bits.type, 0), bits]), align=8)
        data = context.make_array(signature.args[2])(context, builder, arguments[2]).data
        place = builder.bitcast(builder.gep(data, [to]), lanes.as_pointer())
        builder.store(builder.add(packed, _together(builder, [first] * LANES)), place, align=8)
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, places, types.intp), generate


def lanes_from(source: np.ndarray, at: int, least: float) -> int:
    """Bits of those of LANES numbers from `source[at:]` on, contiguous float64, that are not less than `least`."""
    return sum(int(source[at + k] >= least) << k for k in range(LANES))


def lanes_with(source: np.ndarray, at: int, number: float) -> int:
    """Bits of those of LANES numbers from `source[at:]` on, contiguous float64, that equal `number`."""
    return sum(int(source[at + k] == number) << k for k in range(LANES))


def _compared(plain: Callable[[np.ndarray, int, float], int], comparison: str) -> None:
    """Compile a function as an instruction that compares LANES numbers with one."""

    @instructions_for(plain)
    def instruction(typing_context, source, at, number):  # type: ignore[no-untyped-def]
        def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
            data = context.make_array(signature.args[0])(context, builder, arguments[0]).data
            lanes = ir.VectorType(ir.DoubleType(), LANES)
            numbers = builder.load(builder.bitcast(builder.gep(data, [arguments[1]]), lanes.as_pointer()), align=8)
            met = builder.fcmp_ordered(comparison, numbers, _together(builder, [arguments[2]] * LANES))
            return builder.zext(builder.bitcast(met, ir.IntType(LANES)), ir.IntType(64))

        return types.int64(source, types.intp, types.float64), generate


_compared(lanes_from, ">=")
_compared(lanes_with, "==")


def lowest_bit(bits: int) -> int:
    """Place of the lowest bit that is set; some must be."""
    return (bits & -bits).bit_length() - 1


@instructions_for(lowest_bit)
def _lowest_bit(typing_context, bits):  # type: ignore[no-untyped-def]
    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        return builder.cttz(arguments[0], ir.Constant(ir.IntType(1), 1))

    return types.int64(types.int64), generate


def exceed(lines: np.ndarray, first: int, last: int, x_1: float, x_2: float) -> float:
    """Fill row 3 with row 2 less the product of rows 0 and 1 with (x_1, x_2), in columns `first..last-1` of contiguous
    lines; returns the largest of these, minus infinity if there are no columns. Their number is a multiple of LANES.

    A compiler that does not know that multiple makes three loops of it.
    """
    worst = -np.inf
    for k in range(first, last):
        lines[3, k] = lines[2, k] - (lines[0, k] * x_1 + lines[1, k] * x_2)
        worst = max(worst, lines[3, k])
    return float(worst)


@instructions_for(exceed)
def _exceed(typing_context, lines, first, last, x_1, x_2):  # type: ignore[no-untyped-def]
    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        table = context.make_array(signature.args[0])(context, builder, arguments[0])
        width = builder.extract_value(table.shape, 1)
        lanes = ir.VectorType(ir.DoubleType(), LANES)
        any_order = {"fastmath": ("nnan", "nsz")}
        larger_lanes = cgutils.get_or_insert_function(
            builder.module, ir.FunctionType(lanes, [lanes, lanes]), f"llvm.maxnum.v{LANES}f64"
        )

        x_1, x_2 = _together(builder, [arguments[3]] * LANES), _together(builder, [arguments[4]] * LANES)
        worst = cgutils.alloca_once_value(builder, ir.Constant(lanes, [float("-inf")] * LANES))
        step = ir.Constant(width.type, LANES)
        with cgutils.for_range_slice(builder, arguments[1], arguments[2], step, inc=True) as (column, _):
            rows, at = [], column
            for _ in range(4):
                rows.append(builder.bitcast(builder.gep(table.data, [at]), lanes.as_pointer()))
                at = builder.add(at, width)
            n_1, n_2, bound = (builder.load(row, align=8) for row in rows[:3])
            excess = builder.fsub(bound, builder.fadd(builder.fmul(n_1, x_1), builder.fmul(n_2, x_2)))
            builder.store(excess, rows[3], align=8)
            builder.store(builder.call(larger_lanes, [builder.load(worst), excess], **any_order), worst)
        largest = builder.load(worst)
        number = ir.DoubleType()
        larger_one = builder.module.declare_intrinsic(
            "llvm.maxnum", [number], ir.FunctionType(number, [number, number])
        )
        each = [builder.extract_element(largest, ir.Constant(ir.IntType(32), k)) for k in range(LANES)]
        while len(each) > 1:
            half = len(each) // 2
            each = [builder.call(larger_one, pair, **any_order) for pair in zip(each[:half], each[half:], strict=True)]
        return each[0]

    return types.float64(lines, types.intp, types.intp, types.float64, types.float64), generate


def bit_count(bits: int) -> int:
    """Number of bits that are set."""
    return bits.bit_count()


@instructions_for(bit_count)
def _bit_count(typing_context, bits):  # type: ignore[no-untyped-def]
    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        return builder.ctpop(arguments[0])

    return types.int64(types.int64), generate
