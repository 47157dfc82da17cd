"""Vehicles known from telemetry in a recording, such as the log of a drone that only listened.

If the broadcast of a vehicle is recorded, only that is used, with or without an error in it: it is all that others
could know. Otherwise its telemetry is used. Telemetry tells its own error, and the rules of the daemon
(`ridlink.own_ship`) decide whether to trust it. If a receiver relays the broadcast, the identity joins the two.

A LOCATION without a time is no broadcast, since a broadcast has one. An autopilot sends it to its transmitter, with an
accuracy code of its own; PX4 does so on all links. The broadcast, or else the telemetry, says more.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

from ridlink.mavlink.codec import MESSAGES_BY_NAME, decode_message
from ridlink.mavlink.frames import Frame
from ridlink.observer import Sky
from ridlink.own_ship import AUTOPILOT_COMPONENT, OwnShipTelemetry
from ridlink.remote_id.accuracy import DEFAULT_CONVENTION, AccuracyConvention, coded_bound_m
from ridlink.remote_id.messages import STATUS_AIRBORNE, STATUS_ON_GROUND, BasicId, Location, RemoteIdMessage
from ridlink.remote_id.report import RemoteIdReport

GLOBAL_POSITION = MESSAGES_BY_NAME["GLOBAL_POSITION_INT"].msgid
TELEMETRY_IDS = frozenset(
    MESSAGES_BY_NAME[name].msgid
    for name in ("HEARTBEAT", "GPS_RAW_INT", "GLOBAL_POSITION_INT", "ESTIMATOR_STATUS", "EXTENDED_SYS_STATE")
)

SILENT_S = 5.0
"""A vehicle whose broadcast is not heard for this long is taken to have stopped broadcasting."""

SETTLED_S = 2.0
"""New telemetry is not used for this long: the broadcast may be about to begin as well."""

RENEWED_S = 1.0

AUTOPILOTS = 64


@dataclass(slots=True)
class _Telemetry:
    """Telemetry of one autopilot."""

    begun_s: float
    telemetry: OwnShipTelemetry
    reported_s: float = -math.inf


class OwnVehicles:
    """Adds vehicles that are best known by their telemetry to a sky.

    Args:
        sky: The sky to add them to.
        convention: How receivers would read the accuracy code that such a vehicle would send.

    Attributes:
        speaking: System ids whose own broadcast is heard; their telemetry is not used.
    """

    def __init__(self, sky: Sky, *, convention: AccuracyConvention = DEFAULT_CONVENTION) -> None:
        self.speaking: set[int] = set()
        self._sky = sky
        self._convention = convention
        self._spoke_s: dict[int, float] = {}
        self._component: dict[int, int] = {}
        self._identity: dict[int, bytes] = {}
        self._telemetry: dict[int, _Telemetry] = {}

    def supersedes(self, frame: Frame, messages: Iterable[RemoteIdMessage], now_s: float) -> bool:
        """Take a Remote ID frame and its messages. Whether it says less than broadcast or telemetry of its sender."""
        sysid = frame.sysid
        superseded = False
        for said in messages:
            if said.id_or_mac is not None:
                continue
            if isinstance(said, BasicId) and said.uas_id:
                self._identity[sysid] = said.uas_id
            elif isinstance(said, Location):
                self._component[sysid] = frame.compid
                if said.timestamp_s is None:
                    own = self._telemetry.get(sysid)
                    superseded = sysid in self.speaking or (own is not None and now_s - own.reported_s < RENEWED_S)
                elif said.latitude_deg is not None:
                    self._spoke_s[sysid] = now_s
                    if sysid not in self.speaking:
                        self.speaking.add(sysid)
                        self._forget_other(sysid, frame.compid)
        return superseded

    def receive(self, frame: Frame, now_s: float) -> None:
        """Take a frame of telemetry."""
        sysid = frame.sysid
        if frame.compid != AUTOPILOT_COMPONENT or sysid in self.speaking:
            return
        if sysid not in self._telemetry:
            if len(self._telemetry) >= AUTOPILOTS:
                return
            self._telemetry[sysid] = _Telemetry(now_s, OwnShipTelemetry(sysid, filtered=False))
        own = self._telemetry[sysid]
        own.telemetry.receive(sysid, frame.compid, decode_message(frame), now_s)
        if frame.msgid == GLOBAL_POSITION and now_s - own.begun_s >= SETTLED_S:
            report = self._report(sysid, own.telemetry, now_s)
            if report is not None:
                own.reported_s = now_s
                self._forget_other(sysid, AUTOPILOT_COMPONENT)
                self._sky.take(report, now_s)

    def step(self, now_s: float) -> None:
        """Update `speaking`: a vehicle whose broadcast stopped may be known by its telemetry again."""
        self.speaking = {sysid for sysid in self.speaking if now_s - self._spoke_s[sysid] < SILENT_S}

    def _forget_other(self, sysid: int, compid: int) -> None:
        """Remove the same vehicle under another component id from the sky."""
        for other in {AUTOPILOT_COMPONENT, self._component.get(sysid, AUTOPILOT_COMPONENT)} - {compid}:
            self._sky.forget((sysid, other, None))

    def _report(self, sysid: int, telemetry: OwnShipTelemetry, now_s: float) -> RemoteIdReport | None:
        state = telemetry.state(now_s)
        if state is None:
            return None
        north, east, down = state.velocity_ned_mps
        return RemoteIdReport(
            source=(sysid, AUTOPILOT_COMPONENT),
            uas_id=self._identity.get(sysid),
            status=STATUS_AIRBORNE if telemetry.armed and not telemetry.on_ground else STATUS_ON_GROUND,
            latitude_deg=state.position.latitude_deg,
            longitude_deg=state.position.longitude_deg,
            altitude_geodetic_m=state.altitude_ellipsoid_m,
            velocity_ned_mps=state.velocity_ned_mps,
            climb_mps=-down,
            speed_horizontal_mps=math.hypot(north, east),
            horizontal_error_m=state.error_bound_m,
            accuracy_bound_m=coded_bound_m(state.error_bound_m, self._convention),
            vertical_error_m=state.vertical_error_bound_m,
            received_at_s=now_s,
        )
