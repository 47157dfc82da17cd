"""Checks of what the links receive: an autopilot and its parameters, neighbours on the air."""

from __future__ import annotations

import asyncio
import math
from collections import Counter
from collections.abc import Iterator

from ridlink.doctor.finding import Finding, Verdict
from ridlink.doctor.parameters import EXPECTED, parameter_value
from ridlink.links import Address, Link, LinkUrl, open_link
from ridlink.mavlink.codec import CRC_EXTRAS, Encoder, Message, decode_message
from ridlink.mavlink.frames import Cause, Frame, parse_datagram
from ridlink.mavlink.ground_station import HEARTBEAT_EVERY_S, MAV_AUTOPILOT_INVALID, ground_station, heartbeat
from ridlink.own_ship import ARDUPILOT, AUTOPILOT_COMPONENT, FIX_3D, PX4
from ridlink.words import counted

LISTEN_S = 4.0
ASKED_EVERY_S = 0.3
AUTOPILOTS = {ARDUPILOT: "ArduPilot", PX4: "PX4"}


class Listened:
    """Messages and senders heard on a link.

    Attributes:
        counts: Messages by name.
        rejects: Damaged frames, and runs of bytes that are no frame.
        autopilots: MAV_AUTOPILOT by system id.
        versions: MAVLink version of the last heartbeat of each. An autopilot that can use 2 may begin with 1.
        addresses: Address at which each was last heard; requests go there.
        latest: The latest message of autopilots, by name.
        parameters: Parameter values of the first autopilot, by name.
        senders: System ids by message name.
    """

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()
        self.rejects = 0
        self.autopilots: dict[int, int] = {}
        self.versions: dict[int, int] = {}
        self.addresses: dict[int, Address] = {}
        self.latest: dict[str, Message] = {}
        self.parameters: dict[str, float] = {}
        self.senders: dict[str, set[int]] = {}

    def receive(self, data: bytes, address: Address) -> None:
        """Take a datagram."""
        for frame in parse_datagram(data, CRC_EXTRAS):
            if not isinstance(frame, Frame):
                self.rejects += 1
            elif frame.checked:
                self._take(frame, decode_message(frame), address)

    def _take(self, frame: Frame, message: Message, address: Address) -> None:
        self.counts[message.name] += 1
        self.senders.setdefault(message.name, set()).add(frame.sysid)
        if frame.compid != AUTOPILOT_COMPONENT:
            return
        if message.name == "HEARTBEAT" and message.autopilot != MAV_AUTOPILOT_INVALID:
            self.autopilots.setdefault(frame.sysid, message.autopilot)
            self.addresses[frame.sysid] = address
            self.versions[frame.sysid] = frame.version
        if frame.sysid in self.autopilots:
            self.latest[message.name] = message
        if message.name == "PARAM_VALUE" and frame.sysid == next(iter(self.autopilots), None):
            name = message.param_id.split(b"\0", 1)[0].decode("ascii", "replace")
            autopilot = self.autopilots[frame.sysid]
            self.parameters[name] = parameter_value(message.param_value, message.param_type, autopilot)


async def listen(url: LinkUrl, *, asks: bool, for_s: float = LISTEN_S) -> Listened:
    """Listen on a link, sending HEARTBEAT as a ground station.

    Args:
        url: The link.
        asks: Ask the first autopilot for the parameters that matter; listening ends early when all have arrived.
        for_s: How long [s].

    Raises:
        LinkError: If the link cannot be opened.
    """
    heard = Listened()
    link = await open_link(url, heard.receive)
    loop = asyncio.get_running_loop()
    ends_s = loop.time() + for_s
    encoder = ground_station()
    heartbeat_due_s = -math.inf
    try:
        while loop.time() < ends_s:
            if loop.time() >= heartbeat_due_s:
                heartbeat_due_s = loop.time() + HEARTBEAT_EVERY_S
                link.send(heartbeat(encoder))
            if asks and _ask(link, encoder, heard) == 0 and "GLOBAL_POSITION_INT" in heard.latest:
                break
            await asyncio.sleep(ASKED_EVERY_S)
    finally:
        link.close()
    heard.rejects += sum(link.counters[cause] for cause in Cause)  # the link counts those of streams
    return heard


def _ask(link: Link, encoder: Encoder, heard: Listened) -> int:
    """Ask for the parameters that are missing. Returns their number, 1 without an autopilot."""
    if not heard.autopilots:
        return 1
    sysid, autopilot = next(iter(heard.autopilots.items()))
    missing = [wanted.name for wanted in EXPECTED.get(autopilot, ()) if wanted.name not in heard.parameters]
    for name in missing:
        link.send(
            encoder.encode(
                "PARAM_REQUEST_READ",
                target_system=sysid,
                target_component=AUTOPILOT_COMPONENT,
                param_id=name.encode(),
                param_index=-1,
            ),
            heard.addresses[sysid],
        )
    return len(missing)


async def examine_vehicle(url: LinkUrl, for_s: float = LISTEN_S) -> list[Finding]:
    """Check the autopilot at the end of a link, and its parameters that matter.

    Raises:
        LinkError: If the link cannot be opened.
    """
    heard = await listen(url, asks=True, for_s=for_s)
    return list(_vehicle(url, heard, for_s))


def _vehicle(url: LinkUrl, heard: Listened, for_s: float) -> Iterator[Finding]:
    if not heard.autopilots:
        what = f"no heartbeat of an autopilot within {for_s:g} s"
        if heard.counts or heard.rejects:
            what += f" ({counted(heard.counts.total(), 'other message')}, {heard.rejects} damaged)"
        yield Finding("autopilot", Verdict.FAILURE, what, f"{url}: {url.where_to_look}")
        return
    sysid, autopilot = next(iter(heard.autopilots.items()))
    name = AUTOPILOTS.get(autopilot, f"MAV_AUTOPILOT {autopilot}")
    if autopilot in AUTOPILOTS:
        yield Finding("autopilot", Verdict.OK, f"{name}, system id {sysid}")
    else:
        yield Finding("autopilot", Verdict.WARNING, f"{name}, system id {sysid}", "ridlink knows PX4 and ArduPilot")
    if heard.versions[sysid] != 2:
        yield Finding(
            "MAVLink",
            Verdict.WARNING,
            f"version {heard.versions[sysid]}, which the daemon does not take",
            "PX4: MAV_PROTO_VER 2; ArduPilot: SERIALn_PROTOCOL 2; or --allow-v1 of ridlink avoid and broadcast",
        )
    if len(heard.autopilots) > 1:
        others = ", ".join(map(str, list(heard.autopilots)[1:]))
        yield Finding(
            "other autopilots", Verdict.WARNING, f"system ids {others} are heard here, too", "give --vehicle-sysid"
        )
    yield from _state(heard, autopilot)
    for wanted in EXPECTED.get(autopilot, ()):
        value = heard.parameters.get(wanted.name)
        if value is None:
            yield Finding(wanted.name, Verdict.WARNING, "not answered", "is the parameter protocol let through?")
        elif math.isfinite(value) and wanted.is_right(value):
            yield Finding(wanted.name, Verdict.OK, f"{value:g} {wanted.meaning}")
        else:
            yield Finding(wanted.name, Verdict.WARNING, f"{value:g} {wanted.meaning}", wanted.remedy)


def _state(heard: Listened, autopilot: int) -> Iterator[Finding]:
    gps = heard.latest.get("GPS_RAW_INT")
    if gps is not None:
        accuracy = f", h_acc {gps.h_acc / 1000:g} m" if gps.h_acc else ""
        good = gps.fix_type >= FIX_3D
        yield Finding(
            "GNSS",
            Verdict.OK if good else Verdict.FAILURE,
            f"fix type {gps.fix_type}, {counted(gps.satellites_visible, 'satellite')}{accuracy}",
            "" if good else "wait for a 3-D fix: without it the daemon does not engage",
        )
    if "GLOBAL_POSITION_INT" in heard.latest:
        yield Finding("own position", Verdict.OK, "sent")
    elif autopilot == ARDUPILOT:
        yield Finding("own position", Verdict.OK, "not sent unasked, as ArduPilot does; the daemon asks for it")
    else:
        yield Finding(
            "own position", Verdict.WARNING, "not sent", "is the link an onboard one (mavlink start -m onboard)?"
        )
    if "OPEN_DRONE_ID_LOCATION" in heard.latest:
        yield Finding("Remote ID on the bus", Verdict.OK, "own OPEN_DRONE_ID_LOCATION is sent")


async def examine_air(url: LinkUrl, for_s: float = LISTEN_S) -> list[Finding]:
    """Check which neighbours are heard on a link.

    Raises:
        LinkError: If the link cannot be opened.
    """
    heard = await listen(url, asks=False, for_s=for_s)
    located = heard.senders.get("OPEN_DRONE_ID_LOCATION", set())
    extended = heard.senders.get("RIDLINK_SEPARATION", set())
    if not located:
        what = f"no OPEN_DRONE_ID_LOCATION within {for_s:g} s ({counted(heard.counts.total(), 'other message')})"
        return [Finding("air", Verdict.WARNING, what, f"{url}: is a receiver, or the emulated air, there?")]
    rate_hz = heard.counts["OPEN_DRONE_ID_LOCATION"] / len(located) / for_s
    senders = counted(len(located), "sender")
    text = f"{senders}, {rate_hz:.1f} positions a second each, {len(extended)} with RIDLINK_SEPARATION"
    return [Finding("air", Verdict.OK, text)]
