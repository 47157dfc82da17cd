"""What comes to a vehicle from outside: a stream of setpoints, and somebody at the throttle stick.

It remembers what came and when, and knows no modes: what comes of it is decided by `pilot`. Time-outs are those of the
real autopilots with their default parameters.
"""

from __future__ import annotations

import math

from sitl_sim.autopilot.board import Board
from sitl_sim.autopilot.guidance import Velocity
from sitl_sim.autopilot.setpoints import Setpoint

OBEYING_S = 1.0
"""A setpoint as old as this no longer counts as being steered from outside."""

THROTTLE_VALID_S = 3.0
"""So long a stick position counts (ArduPilot's RC_OVERRIDE_TIME)."""

STICK_DOWN_MPS = 2.5
"""Descent of ArduPilot in a mode for a pilot with nobody at the throttle stick (measured in LOITER)."""


class Steering:
    """Setpoints and stick of one vehicle.

    Args:
        board: Whose time-outs it has.

    Attributes:
        setpoint: The last one that could be taken.
        is_flown: Whether the vehicle flies what a setpoint asked for.
        resumes: Whether the stream takes it back into the mode that it has left.
    """

    def __init__(self, board: Board) -> None:
        self._parameters = board.parameters
        self.setpoint: Setpoint | None = None
        self.is_flown = self.resumes = False
        self._setpoint_at_s: float | None = None
        self._throttle_centred_s = -math.inf

    def take(self, setpoint: Setpoint, now_s: float) -> None:
        """Remember a setpoint."""
        self.setpoint, self._setpoint_at_s = setpoint, now_s

    def let_go(self) -> None:
        """Somebody chose a mode: nothing is flown until a setpoint comes, and the stream takes nothing back."""
        self.is_flown = self.resumes = False

    def has_stream(self, now_s: float, within_s: float | None = None) -> bool:
        """Whether a setpoint has come so lately; by default, as PX4 wants it."""
        if within_s is None:
            within_s = self._parameters["COM_OF_LOSS_T"]
        return self._setpoint_at_s is not None and now_s - self._setpoint_at_s <= within_s

    def note_throttle(self, *, centred: bool, now_s: float) -> None:
        """Somebody holds the throttle stick, in the middle or not."""
        self._throttle_centred_s = now_s if centred else -math.inf

    def is_throttle_held(self, now_s: float) -> bool:
        """Whether somebody holds the throttle stick in the middle."""
        return now_s - self._throttle_centred_s <= THROTTLE_VALID_S

    def by_stick(self, now_s: float) -> Velocity:
        """What an ArduPilot in a mode for a pilot flies."""
        return Velocity() if self.is_throttle_held(now_s) else Velocity((0.0, 0.0, STICK_DOWN_MPS))
