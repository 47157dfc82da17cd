"""Automatic disarming of a vehicle that stands armed.

PX4 waits for COM_DISARM_PRFLT without a flight and for COM_DISARM_LAND after one, ArduPilot for DISARM_DELAY. Zero or
less: never.

Source: Commander::handleAutoDisarm of PX4, Copter::auto_disarm_check of ArduPilot.
"""

from __future__ import annotations

from sitl_sim.autopilot.board import Board


class Standing:
    """The time that one vehicle has stood armed.

    Args:
        board: The flight controller, with its parameters.
    """

    def __init__(self, board: Board) -> None:
        self._px4, self._parameters = board.is_px4, board.parameters
        self._has_flown = False
        self._since_s: float | None = None

    def is_over(self, *, armed: bool, in_air: bool, is_kept: bool, time_s: float) -> bool:
        """Whether it disarms now.

        Args:
            armed, in_air: State of the vehicle.
            is_kept: Whether it is to stay armed for now.
            time_s: Present time.
        """
        self._has_flown = armed and (in_air or self._has_flown)
        if not armed or in_air or is_kept:
            self._since_s = None
            return False
        if self._since_s is None:
            self._since_s = time_s
        return 0.0 < self._parameters[self._name] <= time_s - self._since_s

    @property
    def _name(self) -> str:
        if not self._px4:
            return "DISARM_DELAY"
        return "COM_DISARM_LAND" if self._has_flown else "COM_DISARM_PRFLT"

    @property
    def px4_words(self) -> str:
        """PX4's STATUSTEXT about it."""
        return "Disarmed by landing" if self._has_flown else "Disarmed by auto preflight disarming"
