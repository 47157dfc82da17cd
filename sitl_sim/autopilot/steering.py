"""Inputs of a vehicle from outside: a stream of setpoints, and the throttle stick.

It stores inputs and their times, and knows no modes: `pilot` and `routine` decide. Time-outs are those of the real
autopilots with their default parameters.
"""

from __future__ import annotations

import math

from sitl_sim.autopilot.board import Board
from sitl_sim.autopilot.guidance import Velocity
from sitl_sim.autopilot.setpoints import Setpoint

OBEYING_S = 1.0
"""A setpoint as old as this no longer counts as being steered from outside."""

THROTTLE_VALID_S = 3.0
"""Time for which a stick position is valid (ArduPilot's RC_OVERRIDE_TIME)."""

STICK_DOWN_MPS = 2.5
"""Descent of ArduPilot in a mode for a pilot without a throttle stick (measured in LOITER)."""


class Steering:
    """Setpoints and stick of one vehicle.

    Args:
        board: The flight controller, with the time-outs.

    Attributes:
        setpoint: The last accepted setpoint.
        is_flown: Whether the vehicle flies a setpoint.
        resumes: Whether the stream returns it to the mode that it has left.
    """

    def __init__(self, board: Board) -> None:
        self._parameters = board.parameters
        self.setpoint: Setpoint | None = None
        self.is_flown = self.resumes = False
        self._setpoint_at_s: float | None = None
        self._throttle_centred_s = -math.inf

    def take(self, setpoint: Setpoint, now_s: float) -> None:
        """Store a setpoint."""
        self.setpoint, self._setpoint_at_s = setpoint, now_s

    def let_go(self) -> None:
        """A mode was chosen: fly no setpoint until a new one comes, and do not return to an earlier mode."""
        self.is_flown = self.resumes = False

    def has_stream(self, now_s: float, within_s: float | None = None) -> bool:
        """Whether a setpoint came within this time; by default that of PX4."""
        if within_s is None:
            within_s = self._parameters["COM_OF_LOSS_T"]
        return self._setpoint_at_s is not None and now_s - self._setpoint_at_s <= within_s

    def note_throttle(self, *, centred: bool, now_s: float) -> None:
        """Note a throttle stick position, in the middle or not."""
        self._throttle_centred_s = now_s if centred else -math.inf

    def is_throttle_held(self, now_s: float) -> bool:
        """Whether the throttle stick is held in the middle."""
        return now_s - self._throttle_centred_s <= THROTTLE_VALID_S

    def by_stick(self, now_s: float) -> Velocity:
        """The velocity of an ArduPilot in a mode for a pilot."""
        return Velocity() if self.is_throttle_held(now_s) else Velocity((0.0, 0.0, STICK_DOWN_MPS))
