"""Vehicles that are in a recording by their telemetry: the log of a drone that only listened, or broadcasts no error.

What a vehicle reports to its ground station is as good as a broadcast, and says how wrong it is; the daemon's own rules
(`ridlink.own_ship`) judge it. Where its own RIDLINK_SEPARATION is heard, its broadcast alone counts, else its telemetry
in place of its broadcast. Where a receiver relays the latter, the identity joins the two.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass

from ridlink.mavlink.codec import MESSAGES_BY_NAME, decode_message
from ridlink.mavlink.frames import Frame
from ridlink.observer import Sky
from ridlink.own_ship import AUTOPILOT_COMPONENT, OwnShipTelemetry
from ridlink.remote_id.bridge import messages_of
from ridlink.remote_id.messages import BasicId, Location, Separation
from ridlink.remote_id.report import RemoteIdReport

GLOBAL_POSITION = MESSAGES_BY_NAME["GLOBAL_POSITION_INT"].msgid
TELEMETRY_IDS = frozenset(
    MESSAGES_BY_NAME[name].msgid
    for name in ("HEARTBEAT", "GPS_RAW_INT", "GLOBAL_POSITION_INT", "ESTIMATOR_STATUS", "EXTENDED_SYS_STATE")
)

SILENT_S = 5.0
"""Who says nothing of its error for so long is believed not to."""

SETTLED_S = 2.0
"""Telemetry that begins is not taken at once: the broadcast may be about to begin as well."""

RENEWED_S = 1.0

ON_GROUND, AIRBORNE = 1, 2
AUTOPILOTS = 64


@dataclass(slots=True)
class _Telemetry:
    """What one autopilot says."""

    begun_s: float
    telemetry: OwnShipTelemetry
    reported_s: float = -math.inf


class OwnVehicles:
    """Puts vehicles into a sky that are best known by their telemetry.

    Args:
        sky: Where they go.

    Attributes:
        speaking: System ids whose own RIDLINK_SEPARATION is heard; their telemetry is not needed.
    """

    def __init__(self, sky: Sky) -> None:
        self.speaking: set[int] = set()
        self._sky = sky
        self._spoke_s: dict[int, float] = {}
        self._component: dict[int, int] = {}
        self._identity: dict[int, bytes] = {}
        self._telemetry: dict[int, _Telemetry] = {}
        self._refused: Counter[str] = Counter()

    def supersedes(self, frame: Frame, now_s: float) -> bool:
        """Whether a frame about Remote ID says less than the telemetry of its sender; take note of it."""
        sysid = frame.sysid
        if now_s - self._spoke_s.get(sysid, -math.inf) < RENEWED_S:
            return False
        superseded = False
        for said in messages_of(decode_message(frame), self._refused):
            if said.id_or_mac is not None:
                continue
            if isinstance(said, BasicId) and said.uas_id:
                self._identity[sysid] = said.uas_id
            elif isinstance(said, Separation):
                self._spoke_s[sysid] = now_s
                if sysid not in self.speaking:
                    self.speaking.add(sysid)
                    self._forget_other(sysid, frame.compid)
            elif isinstance(said, Location):
                self._component[sysid] = frame.compid
                own = self._telemetry.get(sysid)
                superseded = own is not None and now_s - own.reported_s < RENEWED_S
        return superseded

    def receive(self, frame: Frame, now_s: float) -> None:
        """Telemetry came."""
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
        """Time has passed: who fell silent may be known by its telemetry again."""
        self.speaking = {sysid for sysid in self.speaking if now_s - self._spoke_s[sysid] < SILENT_S}

    def _forget_other(self, sysid: int, compid: int) -> None:
        """The same vehicle under another component."""
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
            status=AIRBORNE if telemetry.armed and not telemetry.on_ground else ON_GROUND,
            latitude_deg=state.position.latitude_deg,
            longitude_deg=state.position.longitude_deg,
            altitude_geodetic_m=state.altitude_ellipsoid_m,
            velocity_ned_mps=state.velocity_ned_mps,
            climb_mps=-down,
            speed_horizontal_mps=math.hypot(north, east),
            horizontal_error_m=state.error_bound_m,
            vertical_error_m=state.vertical_error_bound_m,
            received_at_s=now_s,
        )
