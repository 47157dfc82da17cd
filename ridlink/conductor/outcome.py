"""How a conducted flight can end."""

from __future__ import annotations

from enum import StrEnum

from ridlink.errors import RidlinkError


class FlightError(RidlinkError):
    """What was asked for cannot be flown: not healthy, refused, or not done in time; the text says why."""


class TakenError(FlightError):
    """Somebody else changed the mode: nothing more is asked of the vehicle."""

    def __init__(self) -> None:
        super().__init__(End.TAKEN)


class SilentError(FlightError):
    """The vehicle has fallen silent, and whoever waits for it is to end: nothing more is asked of it."""

    def __init__(self, what: str, silent_s: float) -> None:
        super().__init__(f"{what}: the vehicle has been silent for {silent_s:.0f} s, and may still be in the air")


class End(StrEnum):
    """How a flight under a daemon ended."""

    ARRIVED = "arrived"
    LANDING = "landing"
    """The vehicle comes down by itself."""
    TAKEN = "somebody else changed the mode, and has the vehicle"
    DAEMON_LOST = "the daemon fell silent"
    STOPPED = "stopped"

    @property
    def is_good(self) -> bool:
        """Whether the daemon flew to the end."""
        return self in (End.ARRIVED, End.LANDING)
