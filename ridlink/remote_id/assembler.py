"""Joins the Remote ID messages of each sender into reports, since a sender splits its data into several messages.

Senders are not trusted: memory is bounded, the sender heard least recently is forgotten first, and a message can only
change the memory of its own ``(system id, component id, id_or_mac)``.
"""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass

from ridlink.remote_id.accuracy import DEFAULT_CONVENTION, AccuracyConvention
from ridlink.remote_id.messages import (
    ID_TYPE_NONE,
    ID_TYPE_SERIAL_NUMBER,
    BasicId,
    Location,
    RemoteIdMessage,
    Separation,
)
from ridlink.remote_id.report import RemoteIdReport, SourceKey, report_of

SEPARATION_VALID_S = 1.5
"""Age up to which an older RIDLINK_SEPARATION replaces a lost one, since errors and sizes change slowly. It is longer
than the period of a sender at 1 Hz."""

EQUAL_TIMESTAMP_VALID_S = 10.0
"""Timestamps repeat every hour, so equal ones count only within this time, for which a track would live."""


@dataclass(slots=True)
class _Sender:
    """What is remembered of one sender."""

    id_type: int = ID_TYPE_NONE
    uas_id: bytes | None = None
    ua_type: int = 0
    location: Location | None = None
    location_at_s: float = 0.0
    joined: Separation | None = None
    separation: Separation | None = None
    separation_at_s: float = 0.0


class ReportAssembler:
    """Joins the messages of each sender into reports.

    Args:
        max_sources: Senders remembered at most.
        convention: How to read the horizontal accuracy code of standard senders.

    Raises:
        ValueError: If no sender may be remembered, or the convention is unknown.
    """

    def __init__(self, max_sources: int = 2000, *, convention: AccuracyConvention | str = DEFAULT_CONVENTION) -> None:
        if max_sources < 1:
            raise ValueError(f"max_sources must be at least 1, not {max_sources}")
        self._max_sources = max_sources
        self._convention = AccuracyConvention(convention)
        self._senders: OrderedDict[SourceKey, _Sender] = OrderedDict()

    def __len__(self) -> int:
        return len(self._senders)

    def receive(self, source: tuple[int, int], message: RemoteIdMessage, received_at_s: float) -> RemoteIdReport | None:
        """The report that this message makes possible, if any.

        A LOCATION always makes a report. The report includes the last RIDLINK_SEPARATION of the same sender, if that
        has the same timestamp or is younger than 1.5 s. A RIDLINK_SEPARATION that belongs to the last LOCATION makes
        the report again, completed: same position, same time of receipt.

        Args:
            source: System id and component id of the frame.
            message: What the frame carried.
            received_at_s: Monotonic time of receipt.
        """
        if isinstance(message, Location):
            sender = self._sender(source, message.id_or_mac)
            sender.location, sender.location_at_s = message, received_at_s
            sender.joined = self._separation_for(sender, message, received_at_s)
            return self._report(source, sender, message)
        if isinstance(message, Separation):
            sender = self._sender(source, message.id_or_mac)
            sender.separation, sender.separation_at_s = message, received_at_s
            if sender.location is None or message == sender.joined:
                return None
            if not self._belongs(message, received_at_s, sender.location, sender.location_at_s):
                return None
            sender.joined = message
            return self._report(source, sender, sender.location)
        if isinstance(message, BasicId):
            self._identify(self._sender(source, message.id_or_mac), message)
        elif (*source, message.id_or_mac) in self._senders:
            self._senders.move_to_end((*source, message.id_or_mac))
        return None

    def _sender(self, source: tuple[int, int], id_or_mac: bytes | None) -> _Sender:
        key = (*source, id_or_mac)
        sender = self._senders.get(key)
        if sender is None:
            sender = self._senders[key] = _Sender()
            if len(self._senders) > self._max_sources:
                self._senders.popitem(last=False)
        else:
            self._senders.move_to_end(key)
        return sender

    @staticmethod
    def _identify(sender: _Sender, message: BasicId) -> None:
        if message.ua_type:
            sender.ua_type = message.ua_type
        if message.id_type == ID_TYPE_NONE or not message.uas_id:
            return
        # a sender may alternate serial number and registration; the identity must not alternate with them
        if message.id_type == ID_TYPE_SERIAL_NUMBER or sender.id_type != ID_TYPE_SERIAL_NUMBER:
            sender.id_type, sender.uas_id = message.id_type, message.uas_id

    @staticmethod
    def _belongs(separation: Separation, separation_at_s: float, location: Location, location_at_s: float) -> bool:
        """Both messages describe the same instant."""
        apart_s = abs(separation_at_s - location_at_s)
        if separation.timestamp_s is None:  # no timestamps to compare, so compare times of receipt
            return location.timestamp_s is None and apart_s < SEPARATION_VALID_S
        return separation.timestamp_s == location.timestamp_s and apart_s < EQUAL_TIMESTAMP_VALID_S

    @classmethod
    def _separation_for(cls, sender: _Sender, location: Location, received_at_s: float) -> Separation | None:
        held = sender.separation
        if held is None:
            return None
        if received_at_s - sender.separation_at_s < SEPARATION_VALID_S:
            return held
        return held if cls._belongs(held, sender.separation_at_s, location, received_at_s) else None

    def _report(self, source: tuple[int, int], sender: _Sender, location: Location) -> RemoteIdReport:
        return report_of(
            source,
            location,
            sender.joined,
            sender.location_at_s,
            uas_id=sender.uas_id,
            ua_type=sender.ua_type,
            convention=self._convention,
        )
