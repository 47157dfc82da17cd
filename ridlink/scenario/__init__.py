"""Scenarios for the emulator and for campaigns: built in, from TOML files, or from GeoJSON tracks."""

from __future__ import annotations

from ridlink.scenario.built_in import BUILT_IN, built_in
from ridlink.scenario.events import EVENTS, EVERYBODY, Event, event_of
from ridlink.scenario.files import load_scenario, resolve_scenario
from ridlink.scenario.geojson import load_tracks
from ridlink.scenario.model import (
    DEFAULT_AIRFRAME_M,
    DEFAULT_INTERVAL_S,
    DEFAULT_SPEED_MPS,
    MAX_AIRFRAME_HEIGHT_M,
    ObstacleSpec,
    Point2,
    Point3,
    Scenario,
    VehicleSpec,
    Wind,
    distance_to_polygon,
)

__all__ = [
    "BUILT_IN",
    "DEFAULT_AIRFRAME_M",
    "DEFAULT_INTERVAL_S",
    "DEFAULT_SPEED_MPS",
    "EVENTS",
    "EVERYBODY",
    "MAX_AIRFRAME_HEIGHT_M",
    "Event",
    "ObstacleSpec",
    "Point2",
    "Point3",
    "Scenario",
    "VehicleSpec",
    "Wind",
    "built_in",
    "distance_to_polygon",
    "event_of",
    "load_scenario",
    "load_tracks",
    "resolve_scenario",
]
