"""MAV_CMD_INJECT_FAILURE: what goes wrong because a client says so, as with PX4's ``failure`` command."""

from __future__ import annotations

from ridlink.scenario import EVENTS, Event

GPS, BATTERY, MOTOR, MAVLINK_SIGNAL = 4, 100, 101, 105
"""FAILURE_UNIT."""

OK, OFF, WRONG = 0, 1, 4
"""FAILURE_TYPE."""

WRONG_BY_M = 50.0
"""Error, to the north, of a receiver that is set to be wrong."""

LINK_OFF_S = 10.0
"""How long a link that is switched off stays off: no command could switch it on again."""

_FAILURES: dict[tuple[int, int], tuple[str, dict[str, float]]] = {
    (GPS, OK): ("gnss-restore", {}),
    (GPS, OFF): ("gnss-outage", {}),
    (GPS, WRONG): ("gnss-jump", {"north_m": WRONG_BY_M}),
    (BATTERY, OK): ("battery", {"remaining": 1.0}),
    (BATTERY, OFF): ("battery", {"remaining": 0.0}),
    (MOTOR, OFF): ("forced-landing", {}),
    (MAVLINK_SIGNAL, OFF): ("link-off", {"duration_s": LINK_OFF_S}),
}


def failure_event(unit: int, kind: int, system_id: int) -> Event | None:
    """The event that a failure is; None: this vehicle cannot fail like that."""
    known = _FAILURES.get((unit, kind))
    if known is None:
        return None
    what, figures = known
    usual = {name: figure.default for name, figure in EVENTS[what].items() if figure.default is not None}
    return Event(0.0, system_id, what, usual | figures)
