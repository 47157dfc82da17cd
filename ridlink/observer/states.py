"""All aircraft as JSON objects, with the SI names of the decoder; unknown is None."""

from __future__ import annotations

import math
from typing import Any

from ridlink.observer.discs import rings
from ridlink.observer.known import Aircraft
from ridlink.observer.pairs import Nearest, nearest_of
from ridlink.observer.scene import Scene
from ridlink.observer.sky import Sky
from ridlink.separation.definitions import Definition


def aircraft_states(sky: Sky, scene: Scene, definition: Definition, utc_s: float) -> list[dict[str, Any]]:
    """All aircraft in the air: the report of each, its share of a disc, and its nearest neighbour.

    Args:
        sky: The aircraft in the air.
        scene: Their positions, from `Sky.at`.
        definition: What sizes the discs.
        utc_s: The same instant, seconds since 1970.
    """
    outer = rings(scene, definition)[:, 2]
    nearest = nearest_neighbours(scene, nearest_of(scene, definition))
    at = {number: index for index, number in enumerate(scene.numbers)}
    return [
        aircraft_state(one, scene.time_s, utc_s)
        | {
            "definition": str(definition),
            "disc_radius_m": rounded(outer[at[one.number]]),
            "nearest": nearest[at[one.number]],
        }
        for one in sky.aircraft.values()
        if one.number in at
    ]


def aircraft_state(one: Aircraft, now_s: float, utc_s: float) -> dict[str, Any]:
    """The report of one aircraft.

    Args:
        one: The aircraft.
        now_s: Present time, on the clock on which it was heard.
        utc_s: The same instant, seconds since 1970.
    """
    report = one.report
    velocity = report.velocity_ned_mps
    direction = None
    if velocity is not None and (velocity[0] or velocity[1]):
        direction = round(math.degrees(math.atan2(velocity[1], velocity[0])) % 360.0, 1)
    return {
        "t": round(utc_s, 3),
        "uas": one.name,
        "source": "/".join(map(str, report.source)),
        "ua_type": report.ua_type,
        "status": report.status,
        "latitude_deg": report.latitude_deg,
        "longitude_deg": report.longitude_deg,
        "altitude_geodetic_m": rounded(report.altitude_geodetic_m),
        "altitude_barometric_m": rounded(report.altitude_barometric_m),
        "height_m": rounded(report.height_m),
        "height_reference": report.height_reference,
        "direction_deg": direction,
        "speed_horizontal_mps": rounded(report.speed_horizontal_mps),
        "speed_vertical_mps": rounded(report.climb_mps),
        "horizontal_accuracy_m": rounded(report.horizontal_accuracy_m),
        "horizontal_error_m": rounded(report.horizontal_error_m),
        "vertical_error_m": rounded(report.vertical_error_m),
        "velocity_error_mps": rounded(report.velocity_error_mps),
        "airframe_size_m": rounded(report.airframe_size_m),
        "airframe_height_m": rounded(report.airframe_height_m),
        "update_interval_s": rounded(one.interval_s, 3),
        "avoiding": report.avoiding,
        "age_s": round(max(0.0, now_s - one.last_heard_s), 3),
    }


def nearest_neighbours(scene: Scene, nearest: Nearest) -> list[dict[str, Any] | None]:
    """The nearest neighbour of each: name, distance and margin [m]; None if nobody flies at its height.

    Args:
        scene: All aircraft.
        nearest: The neighbours, from `nearest_of`.
    """
    figures = zip(
        nearest.who.tolist(),
        nearest.distance_m.tolist(),
        (nearest.distance_m - nearest.radius_m).tolist(),
        strict=True,
    )
    return [
        None if who < 0 else {"uas": scene.names[who], "distance_m": rounded(distance), "margin_m": rounded(margin)}
        for who, distance, margin in figures
    ]


def rounded(value: float | None, digits: int = 2) -> float | None:
    """The rounded value for JSON; None if it is unknown or infinite."""
    return None if value is None or not math.isfinite(value) else round(float(value), digits)
