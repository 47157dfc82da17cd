"""The distance that each pair in the air needs, and each vehicle's share of it.

Source: `ridlink.separation.definitions`. A vehicle's share of a disc has three rings: airframe, error and displacement.
Two vehicles whose outer rings touch are as near as their definition allows. This is exact where the parts add up, that
is for all definitions except ``chance``: there each ring is the share in a pair of two such vehicles.
"""

from __future__ import annotations

import numpy as np

from ridlink.observer.scene import FloatArray, Places, Scene
from ridlink.separation.chance import DEFAULT_ETA
from ridlink.separation.definitions import (
    Definition,
    Reported,
    bounded_airframe,
    bounded_error,
    bounded_interval,
    bounded_speed,
    separation_discs,
)


def discs_at(
    scene: Scene, first: Places, second: Places, definition: Definition, *, eta: float = DEFAULT_ETA
) -> FloatArray:
    """Radii of the discs of some pairs [m].

    Args:
        scene: All aircraft.
        first, second: Indices of the two of each pair; they broadcast against each other.
        definition: Separation definition, which decides what fields count.
        eta: Parameter of ``chance`` only.

    Returns:
        The broadcast shape.
    """
    interval = bounded_interval(scene.interval_s)
    return separation_discs(
        definition,
        scene.reported[first],
        scene.reported[second],
        interval_s=np.maximum(interval[first], interval[second]),
        eta=eta,
        neighbours=max(1, len(scene) - 1),
    ).radius_m


def largest_disc(scene: Scene, definition: Definition, *, eta: float = DEFAULT_ETA) -> float:
    """Upper bound of the discs of all pairs [m]: the disc of two aircraft with the largest reported values of all.

    Args:
        scene: All aircraft, at least one.
        definition: Separation definition, which decides what fields count.
        eta: Parameter of ``chance`` only.
    """
    worst = Reported(
        bounded_airframe(scene.airframe_m).max(),
        bounded_error(scene.error_bound_m).max(),
        bounded_error(scene.accuracy_bound_m).max(),
        bounded_speed(scene.speed_mps).max(),
    )
    interval = bounded_interval(scene.interval_s.max())
    neighbours = max(1, len(scene) - 1)
    discs = separation_discs(definition, worst, worst, interval_s=interval, eta=eta, neighbours=neighbours)
    return float(discs.radius_m)


def rings(scene: Scene, definition: Definition) -> FloatArray:
    """Radii of the three rings around every vehicle [m], from the inner to the outer one.

    Args:
        scene: All n aircraft.
        definition: Separation definition, which decides what fields count.

    Returns:
        Outer radii of airframe, error and displacement, shape (n, 3).
    """
    twin = separation_discs(
        definition,
        scene.reported,
        scene.reported,
        interval_s=bounded_interval(scene.interval_s),
        neighbours=max(1, len(scene) - 1),
    )
    parts = np.stack([twin.airframe_m, twin.error_sum_m, twin.displacement_m], axis=-1)
    return np.asarray(np.cumsum(parts, axis=-1) / 2.0)
