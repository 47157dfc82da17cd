"""Vehicles whose telemetry is in a recording and whose Remote ID is not: the log of a drone that only listened.

What a vehicle reports to its ground station is as good as a broadcast, if it is known how wrong it is; the daemon's own
rules (`ridlink.own_ship`) say so. Where its own Remote ID is heard, that alone counts; where a receiver relays it, the
identity joins the two.
"""

from __future__ import annotations

import math
from collections import Counter

from ridlink.mavlink.codec import MESSAGES_BY_NAME, decode_message
from ridlink.mavlink.frames import Frame
from ridlink.observer import Sky
from ridlink.own_ship import AUTOPILOT_COMPONENT, OwnShipTelemetry
from ridlink.remote_id.bridge import messages_of
from ridlink.remote_id.messages import BasicId, Location
from ridlink.remote_id.report import RemoteIdReport

GLOBAL_POSITION = MESSAGES_BY_NAME["GLOBAL_POSITION_INT"].msgid
TELEMETRY_IDS = frozenset(
    MESSAGES_BY_NAME[name].msgid
    for name in ("HEARTBEAT", "GPS_RAW_INT", "GLOBAL_POSITION_INT", "ESTIMATOR_STATUS", "EXTENDED_SYS_STATE")
)

SILENT_S = 5.0
"""Who says nothing of Remote ID for so long is believed not to; telemetry that begins waits as long."""

RENEWED_S = 1.0

ON_GROUND, AIRBORNE = 1, 2
AUTOPILOTS = 64


class OwnVehicles:
    """Puts vehicles into a sky that are known by their telemetry alone.

    Args:
        sky: Where they go.

    Attributes:
        speaking: System ids whose own Remote ID is heard; their telemetry is not needed.
    """

    def __init__(self, sky: Sky) -> None:
        self.speaking: set[int] = set()
        self._sky = sky
        self._spoke_s: dict[int, float] = {}
        self._identity: dict[int, bytes] = {}
        self._telemetry: dict[int, tuple[float, OwnShipTelemetry]] = {}
        self._refused: Counter[str] = Counter()

    def heard(self, frame: Frame, now_s: float) -> None:
        """A frame about Remote ID came: somebody's own, perhaps."""
        if now_s - self._spoke_s.get(frame.sysid, -math.inf) < RENEWED_S:
            return
        for said in messages_of(decode_message(frame), self._refused):
            if said.id_or_mac is not None:
                continue
            if isinstance(said, BasicId) and said.uas_id and len(self._identity) < 256:
                self._identity[frame.sysid] = said.uas_id
            elif isinstance(said, Location):
                self._spoke_s[frame.sysid] = now_s
                if frame.sysid not in self.speaking:
                    self.speaking.add(frame.sysid)
                    if frame.compid != AUTOPILOT_COMPONENT:
                        self._sky.forget((frame.sysid, AUTOPILOT_COMPONENT, None))

    def receive(self, frame: Frame, now_s: float) -> None:
        """Telemetry came."""
        sysid = frame.sysid
        if frame.compid != AUTOPILOT_COMPONENT or sysid in self.speaking:
            return
        if sysid not in self._telemetry:
            if len(self._telemetry) >= AUTOPILOTS:
                return
            self._telemetry[sysid] = now_s, OwnShipTelemetry(sysid, filtered=False)
        begun_s, telemetry = self._telemetry[sysid]
        telemetry.receive(sysid, frame.compid, decode_message(frame), now_s)
        if frame.msgid == GLOBAL_POSITION and now_s - begun_s >= SILENT_S:
            report = self._report(sysid, telemetry, now_s)
            if report is not None:
                self._sky.take(report, now_s)

    def step(self, now_s: float) -> None:
        """Time has passed: who fell silent may be known by its telemetry again."""
        self.speaking = {sysid for sysid in self.speaking if now_s - self._spoke_s[sysid] < SILENT_S}

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
