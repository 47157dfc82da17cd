"""Applies faults to a flight: events of the scenario, and events injected during the flight.

Units: seconds. Events of the scenario wait for the mission; durations count from the event, whether or not the mission
has begun. An event with a duration is undone at its end, unless another one of its kind has happened meanwhile: the
last one counts.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from ridlink.scenario import EVERYBODY, Event, Wind
from sitl_sim.gnss import GnssReceivers
from sitl_sim.vehicle import FleetBattery

BoolArray = npt.NDArray[np.bool_]

ENDS = {
    "gnss-outage": "gnss-outage",
    "gnss-jump": "gnss-jump",
    "gnss-spoof": "gnss-spoof",
    "gnss-sigma": "gnss-sigma",
    "radio-off": "radio",
    "radio-on": "radio",
    "link-off": "link",
    "link-on": "link",
}
"""Kinds of events of which the last one counts."""


@dataclass(slots=True)
class Machinery:
    """The objects that faults act on.

    Args:
        receivers: GNSS receivers.
        sigma_m: Initial accuracies of the receivers.
        battery: Batteries.
        radio_on: Whether the Remote ID of each vehicle works, shape (n,), written.
        link_on: Whether the MAVLink of each vehicle works, shape (n,), written.
        land: Lands a vehicle where it is.
        set_wind: Sets the wind of all vehicles.
    """

    receivers: GnssReceivers
    sigma_m: list[float]
    battery: FleetBattery
    radio_on: BoolArray
    link_on: BoolArray
    land: Callable[[int], None]
    set_wind: Callable[[Wind], None]


class Faults:
    """The faults of one fleet.

    Args:
        machinery: The objects that they act on.
        events: Events of the scenario, in the order of time.
    """

    def __init__(self, machinery: Machinery, events: tuple[Event, ...] = ()) -> None:
        self._machinery = machinery
        self._waiting = list(events)
        self._undo: dict[tuple[str, int], tuple[float, Callable[[], None]]] = {}
        self._now_s = 0.0

    def step(self, now_s: float, mission_s: float | None) -> None:
        """Apply the events that are due.

        Args:
            now_s: Time.
            mission_s: Time since the mission began; None before.
        """
        self._now_s = now_s
        while mission_s is not None and self._waiting and self._waiting[0].at_s <= mission_s:
            self.inject(self._waiting.pop(0))
        if self._undo:
            for key in [key for key, (until_s, _) in self._undo.items() if until_s <= now_s]:
                self._undo.pop(key)[1]()

    def inject(self, event: Event) -> None:
        """Apply one event now.

        Raises:
            ValueError: If there is no such vehicle.
        """
        count = len(self._machinery.sigma_m)
        if event.vehicle > count:
            raise ValueError(f"there is no vehicle {event.vehicle}")
        if event.what == "wind":
            wind = Wind((event["north_mps"], event["east_mps"]), event["gust_sigma_mps"])
            self._machinery.set_wind(wind)
            return
        for index in range(count) if event.vehicle == EVERYBODY else (event.vehicle - 1,):
            undo = self._happen(event, index)
            kind = ENDS.get(event.what)
            if kind is None:
                continue
            self._undo.pop((kind, index), None)
            duration_s = event.figures.get("duration_s", 0.0)
            if undo is not None and duration_s > 0.0:
                self._undo[kind, index] = self._now_s + duration_s, undo

    def _happen(self, event: Event, index: int) -> Callable[[], None] | None:
        """Apply it to one vehicle; returns the function that undoes it."""
        machinery = self._machinery
        receivers = machinery.receivers
        match event.what:
            case "gnss-outage":
                receivers.set_outage(index, True)
                return lambda: receivers.set_outage(index, False)
            case "gnss-jump":
                receivers.set_jump(index, (event["north_m"], event["east_m"], event["down_m"]))
                return lambda: receivers.set_jump(index, np.zeros(3))
            case "gnss-spoof":
                receivers.set_pull(index, (event["north_mps"], event["east_mps"]))
                return lambda: receivers.release(index)
            case "gnss-sigma":
                claimed_m = event["claimed_m"]
                receivers.set_sigma(index, event["sigma_m"], None if claimed_m < 0.0 else claimed_m)
            case "gnss-restore":
                receivers.restore(index, machinery.sigma_m[index])
                for kind in ("gnss-outage", "gnss-jump", "gnss-spoof", "gnss-sigma"):
                    self._undo.pop((kind, index), None)
            case "battery":
                machinery.battery.set_remaining(index, event["remaining"])
            case "radio-off" | "radio-on":
                machinery.radio_on[index] = event.what == "radio-on"
                return lambda: machinery.radio_on.__setitem__(index, True)
            case "link-off" | "link-on":
                machinery.link_on[index] = event.what == "link-on"
                return lambda: machinery.link_on.__setitem__(index, True)
            case "forced-landing":
                machinery.land(index)
            case unknown:
                raise ValueError(f"nothing here makes {unknown} happen")
        return None
