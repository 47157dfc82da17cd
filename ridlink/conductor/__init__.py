"""The conductor: takes vehicles off with MAVSDK, hands them over to their daemons, lands them (extra ``mavsdk``)."""

from ridlink.conductor.flight import ConductedFlight
from ridlink.conductor.outcome import End, FlightError, TakenError
from ridlink.conductor.station import connect, mavsdk_ground_station, open_connection
from ridlink.conductor.vehicle import Conductor

__all__ = ["ConductedFlight", "Conductor", "End", "FlightError", "TakenError", "connect", "mavsdk_ground_station",
           "open_connection"]  # fmt: skip
