"""A flight of `make soak`, so that the program which flies hundreds of them is known to fly."""

from __future__ import annotations

import asyncio

from tests.soak.flights import Cell, fly


def test_two_vehicles_that_hear_only_what_their_daemons_broadcast_keep_clear() -> None:
    flown = asyncio.run(fly(Cell("head-on", "ardupilot", broadcast=True), seed=1))
    assert (flown.arrived, flown.macs, flown.errors) == (2, 0, 0)
    assert flown.nearest_m > 15.0
