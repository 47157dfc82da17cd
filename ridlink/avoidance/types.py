"""Input and output of the avoidance solvers: plain arrays of discs and velocities, no Remote ID and no MAVLink.

Axes: north-east, metres and metres per second, one common local origin. The compass turns clockwise in these axes, so
"to the right" of a vector (n, e) is (-e, n). This module needs numpy only; the compiled kernels are loaded by
`ridlink.avoidance.solver`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import IntEnum, IntFlag
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ridlink.words import Named

FloatArray = NDArray[np.float64]
Int8Array = NDArray[np.int8]

FARTHEST = 1e9
"""Largest number that is taken [m or m/s]: its square is still exact enough to compare."""


def _array(name: str, value: ArrayLike, kind: type[np.generic] | None = np.float64) -> NDArray[Any]:
    """`value` as an array, of numbers of this kind; `ValueError` names it otherwise."""
    try:
        return np.asarray(value, dtype=kind)
    except (TypeError, ValueError, OverflowError) as error:
        raise ValueError(f"{name}: {error}") from None


def checked_pair(name: str, value: ArrayLike) -> FloatArray:
    """`value` as a finite (2,) array; `ValueError` names it otherwise."""
    pair = _array(name, value)
    if pair.shape != (2,):
        raise ValueError(f"{name} must have shape (2,), got {pair.shape}")
    if not (math.isfinite(pair[0]) and math.isfinite(pair[1])):
        raise ValueError(f"{name} must be finite, got {pair.tolist()}")
    if max(abs(pair[0]), abs(pair[1])) > FARTHEST:
        raise ValueError(f"{name} must lie within {FARTHEST:g}, got {pair.tolist()}")
    return pair


def _positive(name: str, value: float) -> None:
    if not (math.isfinite(value) and 0.0 < value <= FARTHEST):
        raise ValueError(f"{name} must be positive and finite, got {value}")


@dataclass(frozen=True, slots=True)
class OwnShip:
    """The vehicle that decides.

    Args:
        position_ne_m: Reported own position, shape (2,).
        velocity_ne_mps: Own velocity from the autopilot, never from differences of positions, shape (2,).
        command_ne_mps: Last velocity sent to the autopilot, shape (2,); the own velocity where none was sent yet.
        airframe_m: Largest horizontal extent (diameter).
        speed_limit_mps: Limit of all velocities that leave the solver.
    """

    position_ne_m: FloatArray
    velocity_ne_mps: FloatArray
    command_ne_mps: FloatArray
    airframe_m: float
    speed_limit_mps: float

    def __post_init__(self) -> None:
        for name in ("position_ne_m", "velocity_ne_mps", "command_ne_mps"):
            object.__setattr__(self, name, checked_pair(name, getattr(self, name)))
        _positive("airframe_m", self.airframe_m)
        _positive("speed_limit_mps", self.speed_limit_mps)


class Memory(IntFlag):
    """Memory of the encounter with one neighbour, kept from step to step."""

    PASSING_RIGHT = 1
    """Own-ship passes on the right, by the rule of the road; at most one of the two sides is set."""
    PASSING_LEFT = 2
    APART = 4
    """The neighbour has been clear of the disc and its buffer, so the buffer is now held against it."""


_MAY_BE_KEPT = np.zeros(256, np.bool_)
"""Which flags are allowed, by their int8 (negative ones count from the end); no neighbour is passed on both sides."""
_MAY_BE_KEPT[[0, Memory.PASSING_RIGHT, Memory.PASSING_LEFT]] = True
_MAY_BE_KEPT[Memory.APART : 2 * Memory.APART] = _MAY_BE_KEPT[: Memory.APART]


@dataclass(frozen=True, slots=True)
class Traffic:
    """Neighbours as a structure of arrays, n of them in the caller's order.

    Args:
        position_ne_m: Positions as reported, at the time of the report, shape (n, 2); the solver extrapolates.
        velocity_ne_mps: Reported velocities, shape (n, 2).
        command_ne_mps: Broadcast commanded velocities, NaN where none was given, shape (n, 2).
        age_s: Age of each report now, shape (n,).
        radius_m: Radius of the pair's disc, shape (n,).
        error_sum_m: Part of it that stands for localization errors, shape (n,).
        reciprocal: True where the neighbour announces that it takes its half of the avoidance, shape (n,).
        memory: Memory of each encounter: `Decision.memory` of the last step in the same order, 0 for a new neighbour,
            shape (n,), `Memory` flags.

    Raises:
        ValueError: If a shape is wrong, a number is not finite, negative or too large, or a flag does not exist.
    """

    position_ne_m: FloatArray
    velocity_ne_mps: FloatArray
    command_ne_mps: FloatArray
    age_s: FloatArray
    radius_m: FloatArray
    error_sum_m: FloatArray
    reciprocal: NDArray[np.bool_]
    memory: Int8Array

    def __post_init__(self) -> None:
        position = _array("position_ne_m", self.position_ne_m)
        if position.ndim != 2:
            raise ValueError(f"position_ne_m must have shape (n, 2), got {position.shape}")
        count = len(position)
        for name in ("position_ne_m", "velocity_ne_mps", "command_ne_mps"):
            array = _array(name, getattr(self, name))
            if array.shape != (count, 2):
                raise ValueError(f"{name} must have shape ({count}, 2), got {array.shape}")
            if name != "command_ne_mps" and not np.all(np.isfinite(array)):
                raise ValueError(f"{name} must be finite, got {array[~np.isfinite(array).all(axis=1)][0].tolist()}")
            if np.any(np.abs(array) > FARTHEST):
                raise ValueError(f"{name} must lie within {FARTHEST:g}, got {np.nanmax(np.abs(array)):g}")
            object.__setattr__(self, name, array)
        for name in ("age_s", "radius_m", "error_sum_m"):
            array = _array(name, getattr(self, name))
            if array.shape != (count,):
                raise ValueError(f"{name} must have shape ({count},), got {array.shape}")
            allowed = (array >= 0.0) & (array <= FARTHEST)
            if not np.all(allowed):
                bad = array[~allowed][0]
                raise ValueError(f"{name} must be finite and not negative, got {bad}")
            object.__setattr__(self, name, array)
        reciprocal = _array("reciprocal", self.reciprocal, None)
        if reciprocal.dtype != np.bool_ and not np.isin(reciprocal, (0, 1)).all():  # NaN would be true
            raise ValueError(f"reciprocal must be true or false, got {reciprocal.tolist()}")
        object.__setattr__(self, "reciprocal", reciprocal.astype(np.bool_, copy=False))
        object.__setattr__(self, "memory", _array("memory", self.memory, np.int8))
        if self.reciprocal.shape != (count,):
            raise ValueError(f"reciprocal must have shape ({count},), got {self.reciprocal.shape}")
        if self.memory.shape != (count,) or not np.all(_MAY_BE_KEPT[self.memory]):
            raise ValueError(f"memory must hold {count} sets of Memory flags, got {self.memory.tolist()}")

    def __len__(self) -> int:
        return len(self.position_ne_m)

    @classmethod
    def empty(cls) -> Traffic:
        """No neighbour at all."""
        pairs, scalars = np.empty((0, 2)), np.empty(0)
        return cls(pairs, pairs, pairs, scalars, scalars, scalars, np.empty(0, np.bool_), np.empty(0, np.int8))


class SolverKind(Named):
    """Which solver decides.

    HALFPLANE: the velocity nearest the preferred one outside of every disc, for vehicles that do not obey at once. May
        slow down. The default.
    GRADED: the heading of least time and risk at full speed. Faster in traffic, promises no distance.
    ROTATION: the paper's, a heading at full speed that leads into no disc. For comparison with the paper.
    """

    HALFPLANE = "halfplane"
    GRADED = "graded"
    ROTATION = "rotation"


class Status(IntEnum):
    """How free the decision was.

    The solvers that choose among headings judge by velocity obstacles. `rotation` takes those of the whole discs, at
    any time; `graded` those of its smaller radii, entered within its look-out, and may choose a pass inside one
    although there are others.
    """

    FREE = 0
    """No neighbour and no obstacle stands in the way of the preferred velocity."""
    CONSTRAINED = 1
    """Another velocity than the preferred one meets every constraint."""
    OVERLAPPED = 2
    """As CONSTRAINED, but own-ship is inside the disc of a neighbour or the clearance of an obstacle, and separates."""
    INFEASIBLE = 3
    """No velocity meets every constraint, or none that can be flown in time. This one exceeds the worst of them least,
    obstacles first, or its path enters discs least (`ridlink.avoidance.evasion`)."""


@dataclass(frozen=True, slots=True)
class Decision:
    """Answer for one step.

    Attributes:
        velocity_ne_mps: Admissible velocity nearest the preferred one, shape (2,).
        command_ne_mps: The same smoothed from the last command: what to send, shape (2,).
        preferred_ne_mps: Velocity without traffic, round obstacles and with the turn, shape (2,).
        status: How free the decision was.
        binding: Indices of the neighbours (at most 3) whose constraints the velocity touches or exceeds. With headings:
            those that rule out the straight way or are exceeded, the worst first.
        obstacle_binding: True if the velocity touches the constraint of a static obstacle, or one rules out the
            straight way.
        worst_slack_mps: Distance of the velocity to its tightest constraint, negative if it is exceeded; infinite
            without any.
        nearest_margin_m: Smallest distance to a neighbour now, less the pair radius without buffer; infinite without
            any.
        nearest_index: Neighbour with that margin, -1 without any.
        time_to_violation_s: Time until the reported velocities lead into the pair radius of the first neighbour, 0
            inside, infinite if never.
        memory: Memory of each encounter, for the next step, shape (n,), `Memory` flags.
        route: Memory of the way round an obstacle, for the next step.
    """

    velocity_ne_mps: FloatArray
    command_ne_mps: FloatArray
    preferred_ne_mps: FloatArray
    status: Status
    binding: tuple[int, ...]
    obstacle_binding: bool
    worst_slack_mps: float
    nearest_margin_m: float
    nearest_index: int
    time_to_violation_s: float
    memory: Int8Array = field(default_factory=lambda: np.empty(0, np.int8))
    route: int = 0

    @property
    def passing_side(self) -> Int8Array:
        """Side that the rule of the road gives own-ship, shape (n,): 1 right, -1 left, 0 where there is none."""
        right, left = self.memory & Memory.PASSING_RIGHT, self.memory & Memory.PASSING_LEFT
        return np.asarray((right != 0).astype(np.int8) - (left != 0).astype(np.int8))
