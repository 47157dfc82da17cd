"""Names of the own vehicle in Remote ID: as configured, or as it calls itself on its own bus.

A vehicle may have a serial number, a registration and a session, and tell them in turn. Its echo may come back under
any of them. Its name is the serial number if it has one, as for neighbours: an identity that flips is none.
"""

from __future__ import annotations

from ridlink.own_ship.telemetry import OwnShipTelemetry
from ridlink.remote_id.messages import ID_TYPE_NONE, ID_TYPE_SERIAL_NUMBER, BasicId

MOST_NAMES = 8
"""Most identities that a vehicle may give itself, each once."""


class OwnNames:
    """Collects what the own vehicle calls itself.

    Args:
        telemetry: Says which vehicle that is; names of the last one are names of a neighbour now.
        configured: Its name, whatever it says itself; None: as it says.
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
        """Take one of the identities that the vehicle tells."""
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
        """Name of the vehicle; None while unknown."""
        self._follow()
        return self._uas_id

    @property
    def id_type(self) -> int:
        """Type of the name, MAV_ODID_ID_TYPE; a configured name is a serial number."""
        self._follow()
        return self._id_type

    @property
    def known(self) -> set[bytes]:
        """All identities under which the vehicle is known."""
        self._follow()
        return self._known
