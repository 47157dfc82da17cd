"""What a source is, and what is known about it beside what is heard."""

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
        title: What the page is headed with.
        source: ``demo``, ``air``, ``link`` or ``file``.
        live: It goes on while it is watched.
        truth: It is known where vehicles truly are, and where they want to go.
        utc0_s: UTC of time 0, seconds since 1970; None if that is not known.
        origin: Where metres are counted from; None until a position was heard.
        obstacles: Corners of polygons, north and east of the origin [m].
        goals: Where vehicles want to go, by their names.
        cruises: How fast they want to fly [m/s], by their names.
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
