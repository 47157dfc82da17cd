"""Velocity-space avoidance: discs and velocities in, one admissible velocity out.

The types and helpers here need numpy only. The solvers are in `ridlink.avoidance.solver`, which loads the compiled
kernels; importing this package does not.
"""

from ridlink.avoidance.obstacles import Obstacles
from ridlink.avoidance.progress import ProgressWatch
from ridlink.avoidance.settings import GradedSettings, HalfplaneSettings, RotationSettings
from ridlink.avoidance.types import Decision, Memory, OwnShip, SolverKind, Status, Traffic

__all__ = [
    "Decision",
    "GradedSettings",
    "HalfplaneSettings",
    "Memory",
    "Obstacles",
    "OwnShip",
    "ProgressWatch",
    "RotationSettings",
    "SolverKind",
    "Status",
    "Traffic",
]
