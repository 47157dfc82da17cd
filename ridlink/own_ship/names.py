"""What the own vehicle is called in Remote ID: as configured, or as it calls itself on its own bus.

A vehicle may have a serial number, a registration and a session, and tell them in turn. By any of them its echo comes
back; its name is the serial number where it has one, as that of neighbours is: an identity that flips is none.
"""

from __future__ import annotations

from ridlink.own_ship.telemetry import OwnShipTelemetry
from ridlink.remote_id.assembler import ID_TYPE_NONE, ID_TYPE_SERIAL_NUMBER
from ridlink.remote_id.messages import BasicId

MOST_NAMES = 8
"""Identities that a vehicle may give itself; each at most once."""


class OwnNames:
    """Fed with what the own vehicle calls itself.

    Args:
        telemetry: Says which vehicle that is; what the last one called itself is a neighbour's name now.
        configured: Its name, whatever it says; None: as it says.
    """

    def __init__(self, telemetry: OwnShipTelemetry, configured: bytes | None = None) -> None:
        self._telemetry, self._configured = telemetry, configured
        self._forget()

    def _forget(self) -> None:
        self._of = self._telemetry.lock
        self._uas_id = self._configured
        self._known = set() if self._configured is None else {self._configured}
        self._id_type = ID_TYPE_NONE if self._configured is None else ID_TYPE_SERIAL_NUMBER

    def _follow(self) -> None:
        if self._of != self._telemetry.lock:
            self._forget()

    def hear(self, said: BasicId) -> None:
        """The vehicle tells one of its identities."""
        self._follow()
        if not said.uas_id or said.id_type == ID_TYPE_NONE:
            return
        if len(self._known) < MOST_NAMES:
            self._known.add(said.uas_id)
        is_serial_number = said.id_type == ID_TYPE_SERIAL_NUMBER
        if self._configured is None and (is_serial_number or self._id_type != ID_TYPE_SERIAL_NUMBER):
            self._uas_id, self._id_type = said.uas_id, said.id_type

    @property
    def uas_id(self) -> bytes | None:
        """Its name; None while unknown."""
        self._follow()
        return self._uas_id

    @property
    def id_type(self) -> int:
        """Of what type its name is, MAV_ODID_ID_TYPE; one that is configured is a serial number."""
        self._follow()
        return self._id_type

    @property
    def known(self) -> set[bytes]:
        """All identities under which it is known."""
        self._follow()
        return self._known
