"""What is done once in a while, on a grid and without bursts."""

from __future__ import annotations

from ridlink.periodic import Periodic


def test_periodic_keeps_its_grid_and_makes_up_for_nothing() -> None:
    every = Periodic(1.0)
    due = [t / 10 for t in range(50) if every.due(t / 10)]
    assert due == [0.0, 1.0, 2.0, 3.0, 4.0]
    assert every.due(20.3) and not every.due(20.4) and every.due(21.3)
