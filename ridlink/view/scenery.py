"""A source, and facts about it that are not in the traffic."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from ridlink.geodesy import Geodetic

Pair = tuple[float, float]
"""North and east, metres or metres a second."""


@dataclass(frozen=True, slots=True)
class Scenery:
    """A source.

    Attributes:
        title: Title of the page.
        source: ``demo``, ``air``, ``link`` or ``file``.
        live: Whether it continues while it is watched.
        truth: Whether true positions and goals are known.
        utc0_s: UTC of time 0, seconds since 1970; None if unknown.
        origin: Origin of positions; None until a position was received.
        obstacles: Corners of polygons, north and east of the origin [m].
        goals: Goals by name of the vehicle.
        cruises: Cruise speeds [m/s] by name of the vehicle.
    """

    title: str
    source: str
    live: bool
    truth: bool = False
    utc0_s: float | None = None
    origin: Geodetic | None = None
    obstacles: Sequence[Sequence[Pair]] = ()
    goals: Mapping[str, Pair] = field(default_factory=dict)
    cruises: Mapping[str, float] = field(default_factory=dict)
