"""Events of a flight, such as faults and wind: from a scenario file, or injected while it runs.

Units and axes: seconds of the mission, metres, metres a second; north-east-down.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from ridlink.checked_toml import CheckedTable, TomlSource

EVERYBODY = 0
"""Vehicle number of an event that concerns all vehicles."""


@dataclass(frozen=True, slots=True)
class Figure:
    """One figure of an event.

    Args:
        default: Value if not given; None if it must be given.
        least, most: Its range.
    """

    default: float | None = None
    least: float = -1e6
    most: float = 1e6


_METRES = Figure(0.0)
_FOR_EVER = Figure(0.0, least=0.0)
"""Duration; 0: until another event ends it."""

EVENTS: Mapping[str, Mapping[str, Figure]] = {
    "gnss-outage": {"duration_s": _FOR_EVER},
    "gnss-jump": {"north_m": _METRES, "east_m": _METRES, "down_m": _METRES, "duration_s": _FOR_EVER},
    "gnss-spoof": {"north_mps": _METRES, "east_mps": _METRES, "duration_s": _FOR_EVER},
    "gnss-sigma": {"sigma_m": Figure(least=0.0), "claimed_m": Figure(-1.0, least=-1.0)},
    "gnss-restore": {},
    "battery": {"remaining": Figure(least=0.0, most=1.0)},
    "radio-off": {"duration_s": _FOR_EVER},
    "radio-on": {},
    "link-off": {"duration_s": _FOR_EVER},
    "link-on": {},
    "forced-landing": {},
    "wind": {"north_mps": _METRES, "east_mps": _METRES, "gust_sigma_mps": Figure(0.0, least=0.0)},
}
"""Kinds of events with their figures:

- gnss-outage: no fix; the reported position drifts away.
- gnss-jump: the reported position jumps by an offset (multipath); the receiver does not notice.
- gnss-spoof: the reported position is pulled away at a velocity; the receiver does not notice.
- gnss-sigma: another error, and another reported accuracy (-1: the receiver reports the true one).
- gnss-restore: the receiver works as at the start.
- battery: the remaining charge, a share.
- radio-off, radio-on: Remote ID is neither sent nor heard.
- link-off, link-on: no MAVLink to or from the vehicle.
- forced-landing: the vehicle lands where it is and obeys no command.
- wind: changes the wind for all vehicles; the vehicle number is ignored.
"""


@dataclass(frozen=True, slots=True)
class Event:
    """One event of a flight.

    Args:
        at_s: Seconds of the mission.
        vehicle: System id; 0 for all vehicles.
        what: One of ``EVENTS``.
        figures: All figures of this kind of event.
    """

    at_s: float
    vehicle: int
    what: str
    figures: Mapping[str, float] = field(default_factory=dict)

    def __getitem__(self, name: str) -> float:
        return self.figures[name]


def read_event(table: CheckedTable, *, at_s: float | None = None, vehicles: int | None = None) -> Event:
    """An event from a table with ``at_s``, ``vehicle``, ``what`` and the figures of that kind.

    Args:
        table: The table; read completely.
        at_s: Default of the time; None if the table must have it.
        vehicles: Number of vehicles; None if unknown here.

    Raises:
        ConfigError: If a key is missing, unknown or out of range.
    """
    when_s = table.number("at_s", at_s, least=0.0)
    vehicle = table.number("vehicle", float(EVERYBODY), least=0.0)
    if vehicle != int(vehicle):
        raise table.fault("vehicle", f"must be a system id, or 0 for all, not {vehicle:g}")
    if vehicles is not None and vehicle > vehicles:
        raise table.fault("vehicle", f"must be at most {vehicles}: there is no vehicle {vehicle:g}")
    what = table.text("what")
    if what not in EVENTS:
        raise table.fault("what", f"must be one of {', '.join(EVENTS)}, not '{what}'")
    figures = {
        name: table.number(name, figure.default, least=figure.least, most=figure.most)
        for name, figure in EVENTS[what].items()
    }
    table.nothing_else()
    return Event(when_s, EVERYBODY if what == "wind" else int(vehicle), what, figures)


def event_of(values: Mapping[str, Any], source: str, *, at_s: float) -> Event:
    """An event from a parsed JSON object; without a time in it, the event happens at ``at_s``.

    Raises:
        ConfigError: As `read_event`.
    """
    return read_event(CheckedTable(TomlSource(source, ""), dict(values), "event", 0), at_s=at_s)
