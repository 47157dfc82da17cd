"""What is done to all lanes of a block at once: as instructions and as plain Python it is the same."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numba import njit

from ridlink.avoidance.lanes import gather_lanes, pack_lanes, turn_lanes
from ridlink.avoidance.rows import LANES


@njit
def packed(bits, first, places, to):
    pack_lanes(bits, first, places, to)


@njit
def gathered(source, place_0, place_1, place_2, place_3, column, target):
    gather_lanes(source, place_0, place_1, place_2, place_3, column, target)


@njit
def turned(source, row, column, target, to_0, to_1, to_2, to_3):
    turn_lanes(source, row, column, target, to_0, to_1, to_2, to_3)


@pytest.mark.parametrize("turn", [turn_lanes, turned])
def test_columns_of_four_rows_become_columns_of_a_block(turn):
    source, target = np.arange(100.0).reshape(10, 10), np.zeros(5 * LANES)
    turn(source, 3, 5, target, 0, 3 * LANES, LANES, 4 * LANES)
    # Rows 3 to 6, columns 5 to 8; nothing is written between.
    wanted = [[35, 45, 55, 65], [37, 47, 57, 67], [0, 0, 0, 0], [36, 46, 56, 66], [38, 48, 58, 68]]
    assert target.reshape(5, LANES).tolist() == wanted


@pytest.mark.parametrize("pack", [pack_lanes, packed])
@pytest.mark.parametrize("bits", range(1 << LANES))
def test_places_of_the_lanes_with_a_bit_come_one_after_the_other(pack, bits):
    places = np.full(3 * LANES, -1)
    pack(bits, 40, places, 5)
    wanted = [40 + k for k in range(LANES) if bits >> k & 1]
    assert places[5 : 5 + len(wanted)].tolist() == wanted
    # What follows is some place of that block, never one that does not exist; nothing else is touched.
    assert set(places[5 : 5 + LANES].tolist()) <= set(range(40, 40 + LANES))
    assert set(places[:5].tolist()) == set(places[5 + LANES :].tolist()) == {-1}


@given(st.lists(st.integers(0, 5 * LANES - 1), min_size=4, max_size=4), st.integers(0, 2))
def test_four_neighbours_of_any_blocks_are_gathered_in_one(places, column):
    source = np.random.default_rng(1).random((5, 3 * LANES))
    for gather in (gather_lanes, gathered):
        target = np.zeros(3 * LANES)
        gather(source, *places, LANES * column, target)
        wanted = [source[place // LANES, LANES * column + place % LANES] for place in places]
        assert target[LANES * column : LANES * (column + 1)].tolist() == wanted
        assert np.count_nonzero(target) == LANES
