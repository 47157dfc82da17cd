"""Checks whether a machine, a network and an autopilot are fit for a flight, with a remedy for each problem."""

from __future__ import annotations

from ridlink.doctor.finding import Finding, Verdict
from ridlink.doctor.machine import examine_machine
from ridlink.doctor.network import Listened, examine_air, examine_vehicle

__all__ = ["Finding", "Listened", "Verdict", "examine_air", "examine_machine", "examine_vehicle"]
