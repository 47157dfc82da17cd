"""Outcomes and errors of a conducted flight."""

from __future__ import annotations

from enum import StrEnum

from ridlink.errors import RidlinkError


class FlightError(RidlinkError):
    """The flight failed: vehicle not healthy, a command refused, or not done in time; the text says why."""


class TakenError(FlightError):
    """Somebody else changed the mode; the conductor sends no further command."""

    def __init__(self) -> None:
        super().__init__(End.TAKEN)


class SilentError(FlightError):
    """The vehicle is silent and the flight is to end; the conductor sends no further command."""

    def __init__(self, what: str, silent_s: float) -> None:
        super().__init__(f"{what}: the vehicle has been silent for {silent_s:.0f} s, and may still be in the air")


class End(StrEnum):
    """How a flight under a daemon ended."""

    ARRIVED = "arrived"
    LANDING = "landing"
    """The vehicle lands by itself."""
    TAKEN = "somebody else changed the mode, and has the vehicle"
    DAEMON_LOST = "the daemon fell silent"
    STOPPED = "stopped"

    @property
    def is_good(self) -> bool:
        """Whether the daemon was in control until the end."""
        return self in (End.ARRIVED, End.LANDING)
