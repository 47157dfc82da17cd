"""Own state from the autopilot's telemetry, how far it can be believed, and whether another writer steers as well."""

from __future__ import annotations

from ridlink.own_ship.telemetry import (
    ARDUPILOT,
    AUTOPILOT_COMPONENT,
    PX4,
    AutopilotLock,
    OwnShipTelemetry,
)
from ridlink.own_ship.trust import FIX_3D

__all__ = ["ARDUPILOT", "AUTOPILOT_COMPONENT", "FIX_3D", "PX4", "AutopilotLock", "OwnShipTelemetry"]
