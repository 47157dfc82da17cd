"""The mission protocol of MAVLink 2: upload, download, clear, set the present item. Sans-IO.

An upload replaces the mission when its last item has arrived and all were good; after any error the old mission stays.
Only one peer uploads at a time. A download needs no state: every request is answered separately.

ArduPilot keeps home as item 0, see `mission_flight`. It requests items with the old MISSION_REQUEST, and can replace
some items. During an upload, no other peer can clear, and nobody can read. A mission that is flown cannot be cleared,
but replaced, and there is no word for all kinds of items at once.

Source: https://mavlink.io/en/services/mission.html, mavlink_mission.cpp of PX4, MissionItemProtocol.cpp,
MissionItemProtocol_Waypoints.cpp, GCS_Common.cpp and AP_Mission.cpp of ArduPilot.
"""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, field

from ridlink.mavlink.codec import Message
from sitl_sim.autopilot.board import Board
from sitl_sim.autopilot.mission_flight import MissionFlight
from sitl_sim.autopilot.mission_items import MAX_ITEMS, MissionItem, read_item
from sitl_sim.autopilot.results import MissionResult, Reply, Severity

MISSION, FENCE, RALLY, ALL = 0, 1, 2, 255
"""MAV_MISSION_TYPE."""

REQUEST_AGAIN_S = 1.0
GIVE_UP_AFTER = 5
"""Requests for one item without an answer, after which an upload ends."""

Sender = tuple[int, int]
"""System id and component id."""


@dataclass(slots=True)
class _Upload:
    """`count` items from number `first` on: a whole mission, or a replacement of some items."""

    peer: Hashable
    sender: Sender
    count: int
    requested_s: float
    items: list[MissionItem] = field(default_factory=list)
    requests: int = 1
    first: int = 0
    is_partial: bool = False

    @property
    def wanted(self) -> int:
        """Number of the next item."""
        return self.first + len(self.items)


class MissionProtocol:
    """The vehicle's side of the protocol.

    Args:
        board: PX4 requests the wanted item again, and acknowledges the last one again; ArduPilot refuses an item that
            it did not request.
        flight: Stores the mission and flies it.
    """

    def __init__(self, board: Board, flight: MissionFlight) -> None:
        self._board, self._flight = board, flight
        self._upload: _Upload | None = None
        self._done: tuple[Hashable, Sender, int] | None = None
        """Peer and sender of the last uploaded mission, and its last item."""

    def receive(self, message: Message, sender: Sender, peer: Hashable, now_s: float) -> list[Reply]:
        """Process one message of the protocol; returns the answers.

        Args:
            message: Any message of the mission protocol.
            sender: Its sender.
            peer: Peer that it came from; an upload continues only with this peer.
            now_s: Monotonic time.
        """
        reads = message.name in ("MISSION_REQUEST_LIST", "MISSION_REQUEST_INT", "MISSION_REQUEST")
        clears = message.name == "MISSION_CLEAR_ALL"
        if not self._board.is_px4 and (reads or clears):
            kind = message.mission_type
            if kind not in (MISSION, FENCE, RALLY):
                return [self._refused(sender, MissionResult.UNSUPPORTED, kind)]
            if reads and kind == MISSION and self._upload is not None:
                return [self._refused(sender, MissionResult.DENIED)]
            if clears and kind == MISSION and self._flight.is_running:
                return [self._refused(sender, MissionResult.ERROR)]
        match message.name:
            case "MISSION_COUNT":
                return self._begin(message, sender, peer, now_s)
            case "MISSION_ITEM_INT" | "MISSION_ITEM":
                return self._take(message, sender, peer, now_s)
            case "MISSION_REQUEST_LIST":
                count = len(self._flight.plan) if message.mission_type == MISSION else 0
                fields: dict[str, object] = {"count": count, "mission_type": message.mission_type}
                return [("MISSION_COUNT", _to(sender) | fields)]
            case "MISSION_REQUEST_INT" | "MISSION_REQUEST":
                return self._give(message, sender)
            case "MISSION_CLEAR_ALL":
                return self._clear(message, sender, peer)
            case "MISSION_SET_CURRENT":
                if not self._flight.set_current(message.seq):
                    self._board.say(Severity.WARNING, f"mission: there is no item {message.seq}")
                return [("MISSION_CURRENT", self._flight.current_fields())]
            case "MISSION_WRITE_PARTIAL_LIST":
                return [self._begin_part(message, sender, peer, now_s)]
            case "MISSION_ACK":
                if self._upload is not None and self._upload.peer == peer and message.type:
                    self._upload = None  # cancelled by its sender
        return []

    def tick(self, now_s: float) -> tuple[Hashable, Reply] | None:
        """Request a missing item again; returns the peer and the request. Gives up after a while."""
        upload = self._upload
        if upload is None or now_s - upload.requested_s < REQUEST_AGAIN_S:
            return None
        if upload.requests >= GIVE_UP_AFTER:
            self._upload = None
            return upload.peer, self._refused(upload.sender, MissionResult.OPERATION_CANCELLED)
        upload.requests += 1
        upload.requested_s = now_s
        return upload.peer, self._request(upload)

    # --- up -----------------------------------------------------------------------------------------------------------

    def _begin(self, message: Message, sender: Sender, peer: Hashable, now_s: float) -> list[Reply]:
        kind, count = message.mission_type, message.count
        if kind != MISSION:  # there are no fences and rally points, but a client may clear them
            fine = kind in (FENCE, RALLY) and count == 0
            return [
                self._acknowledged(sender, kind) if fine else self._refused(sender, MissionResult.UNSUPPORTED, kind)
            ]
        if self._is_somebody_elses(peer):
            return [self._refused(sender, MissionResult.ERROR if self._board.is_px4 else MissionResult.DENIED)]
        if count > MAX_ITEMS:
            return [self._refused(sender, MissionResult.NO_SPACE)]
        if count == 0:
            self._upload = None
            return self._clear(message, sender, peer)
        self._upload, self._done = _Upload(peer, sender, count, now_s), None
        return [self._request(self._upload)]

    def _is_somebody_elses(self, peer: Hashable) -> bool:
        """Whether another peer uploads."""
        return self._upload is not None and self._upload.peer != peer

    def _begin_part(self, message: Message, sender: Sender, peer: Hashable, now_s: float) -> Reply:
        """ArduPilot: replace some items, or add items after the last one."""
        first, last, count = message.start_index, message.end_index, len(self._flight.plan)
        if self._board.is_px4 or message.mission_type != MISSION:
            return self._refused(sender, MissionResult.UNSUPPORTED, message.mission_type)
        if self._upload is not None:
            return self._refused(sender, MissionResult.DENIED)
        if not 0 <= first <= last <= min(count, MAX_ITEMS - 1):
            return self._refused(sender, MissionResult.ERROR)
        self._done = None
        self._upload = _Upload(peer, sender, last - first + 1, now_s, first=first, is_partial=True)
        return self._request(self._upload)

    def _take(self, message: Message, sender: Sender, peer: Hashable, now_s: float) -> list[Reply]:
        upload = self._upload
        if message.mission_type != MISSION or upload is None or upload.peer != peer:
            came_twice = message.mission_type == MISSION and self._done == (peer, sender, message.seq)
            if came_twice and self._board.is_px4:  # its acknowledgement was lost
                return [self._acknowledged(sender, MISSION)]
            return [self._refused(sender, MissionResult.ERROR, message.mission_type)]
        wanted = upload.wanted
        if message.seq != wanted:
            if self._board.is_px4 or message.seq < wanted:  # a repeated item is no error
                return [self._request(upload)]
            return [self._refused(sender, MissionResult.INVALID_SEQUENCE)]
        whole = max(upload.first + upload.count, len(self._flight.plan) if upload.is_partial else 0)
        item = read_item(message, whole)
        if isinstance(item, MissionResult):
            self._upload = None
            return [self._refused(sender, item)]
        upload.items.append(item)
        upload.requested_s, upload.requests = now_s, 1
        if len(upload.items) < upload.count:
            return [self._request(upload)]
        self._upload, self._done = None, (peer, sender, wanted)
        if upload.is_partial:
            self._flight.replace(upload.first, upload.items)
        else:
            self._flight.load(upload.items)
        return [self._acknowledged(sender, MISSION)]

    def _request(self, upload: _Upload) -> Reply:
        name = "MISSION_REQUEST_INT" if self._board.is_px4 else "MISSION_REQUEST"
        return name, _to(upload.sender) | {"seq": upload.wanted, "mission_type": MISSION}

    # --- down, clear --------------------------------------------------------------------------------------------------

    def _give(self, message: Message, sender: Sender) -> list[Reply]:
        seq = message.seq
        item = self._flight.item(seq) if message.mission_type == MISSION else None
        if item is None:
            return [self._refused(sender, MissionResult.INVALID_SEQUENCE, message.mission_type)]
        fields = item.fields() | {"seq": seq, "current": int(seq == self._flight.current), "mission_type": MISSION}
        if message.name == "MISSION_REQUEST_INT":
            return [("MISSION_ITEM_INT", _to(sender) | fields)]
        degrees = {"x": fields["x"] / 1e7, "y": fields["y"] / 1e7}
        return [("MISSION_ITEM", _to(sender) | fields | degrees)]

    def _clear(self, message: Message, sender: Sender, peer: Hashable) -> list[Reply]:
        """Clear the mission. An upload by another peer continues; on ArduPilot it also prevents clearing."""
        kind = message.mission_type
        if kind not in (MISSION, FENCE, RALLY, ALL):
            return [self._refused(sender, MissionResult.UNSUPPORTED, kind)]
        if kind in (MISSION, ALL):
            others = self._is_somebody_elses(peer)
            if others and not self._board.is_px4:
                return [self._refused(sender, why, kind) for why in (MissionResult.DENIED, MissionResult.ERROR)]
            if not others:
                self._upload = None
            self._done = None
            self._flight.load([])
        return [self._acknowledged(sender, kind)]

    def _acknowledged(self, sender: Sender, kind: int) -> Reply:
        return "MISSION_ACK", _to(sender) | {"type": int(MissionResult.ACCEPTED), "mission_type": kind}

    def _refused(self, sender: Sender, why: MissionResult, kind: int = MISSION) -> Reply:
        self._board.say(Severity.WARNING, f"mission refused: {why.name.lower().replace('_', ' ')}")
        return "MISSION_ACK", _to(sender) | {"type": int(why), "mission_type": kind}


def _to(sender: Sender) -> dict[str, object]:
    return {"target_system": sender[0], "target_component": sender[1]}
