"""The parameter protocol of MAVLink: read all, read one, set one. Sans-IO.

A refused value is answered with a STATUSTEXT and the present value.

Source: https://mavlink.io/en/services/parameter.html
"""

from __future__ import annotations

from ridlink.mavlink.codec import Message
from sitl_sim.autopilot.board import Board
from sitl_sim.autopilot.parameters import parameter_name
from sitl_sim.autopilot.results import Reply, Severity


class ParameterProtocol:
    """Answers to PARAM_REQUEST_LIST, PARAM_REQUEST_READ and PARAM_SET.

    Args:
        board: The flight controller. PX4 reports an unknown parameter with a STATUSTEXT, ArduPilot does not answer.
    """

    def __init__(self, board: Board) -> None:
        self._board, self._parameters = board, board.parameters

    def everything(self, message: Message) -> list[Reply]:
        """All of them."""
        return [self._value(index) for index in range(len(self._parameters))]

    def read(self, message: Message) -> list[Reply]:
        """One parameter, by name or by index."""
        index = self._parameters.find(message.param_id, message.param_index)
        return self._unknown(message.param_id, message.param_index) if index is None else [self._value(index)]

    def set(self, message: Message) -> tuple[list[Reply], bool]:
        """The present value after the request, and whether it changed: then all peers get it."""
        index = self._parameters.find(message.param_id)
        if index is None:
            return self._unknown(message.param_id, -1), False
        complaint = self._parameters.set(index, message.param_value, message.param_type)
        if complaint is not None:
            self._board.say(Severity.WARNING, f"parameter refused: {complaint}")
        return [self._value(index)], complaint is None

    def _value(self, index: int) -> Reply:
        return "PARAM_VALUE", self._parameters.fields(index)

    def _unknown(self, param_id: bytes, index: int) -> list[Reply]:
        if self._board.is_px4:
            what = parameter_name(param_id) if index < 0 else f"index {index}"
            self._board.say(Severity.WARNING, f"unknown parameter: {what}")
        return []
