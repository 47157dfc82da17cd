"""Remote ID that an engine hears, on either link: messages to reports, reports into the picture.

On the vehicle link, receivers relay others, and the vehicle speaks of itself. A vehicle that cannot tell the two apart
would avoid itself. Nothing that is heard can change anything but tracks, and the names of the own vehicle.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Hashable

from ridlink.engine.config import EngineConfig
from ridlink.engine.intake import LOCATION, Intake
from ridlink.mavlink.codec import Message
from ridlink.mavlink.frames import Frame
from ridlink.own_ship import OwnShipTelemetry
from ridlink.own_ship.names import OwnNames
from ridlink.remote_id.assembler import ReportAssembler
from ridlink.remote_id.bridge import REMOTE_ID_IDS
from ridlink.remote_id.messages import BasicId, Location, RemoteIdMessage
from ridlink.traffic.picture import TrafficPicture


class Hearing:
    """Takes datagrams of the air, and Remote ID messages of the vehicle link.

    Args:
        config: Configuration of the engine.
        intake: Takes datagrams and messages apart.
        telemetry: Says which vehicle is the own one.
        picture: Traffic picture that receives the reports.

    Attributes:
        names: Names of the own vehicle.
        reports: LOCATION messages that were taken.
        counters: Messages that were not taken, by cause.
    """

    def __init__(
        self, config: EngineConfig, intake: Intake, telemetry: OwnShipTelemetry, picture: TrafficPicture
    ) -> None:
        self._config, self._intake, self._telemetry, self._picture = config, intake, telemetry, picture
        self._assemblers = {link: ReportAssembler(convention=config.accuracy_convention) for link in ("vehicle", "rid")}
        self.names = OwnNames(telemetry, config.uas_id.encode() if config.uas_id else None)
        self.reports = 0
        self.counters: Counter[str] = Counter()

    def receive_air(self, datagram: bytes, source: Hashable, now_s: float, utc_s: float | None) -> None:
        """Take a datagram of the Remote ID link."""
        messages = self._intake.messages(datagram, REMOTE_ID_IDS)
        if len(messages) > 1:  # LOCATION last here as well: see `Intake.remote_id`
            messages.sort(key=lambda each: each[1].name == LOCATION)
        for frame, message in messages:
            for part in self._intake.remote_id(message):
                self._take("rid", source, frame, part, now_s, utc_s)

    def receive_vehicle(
        self, frame: Frame, message: Message, source: Hashable, now_s: float, utc_s: float | None
    ) -> None:
        """Take a Remote ID message of the vehicle link: of others, relayed by receivers, or of the vehicle itself."""
        lock = self._telemetry.lock
        itself = lock is not None and lock.sysid == frame.sysid and lock.source == source
        for part in self._intake.remote_id(message):
            if not (itself and part.id_or_mac is None):
                self._take("vehicle", source, frame, part, now_s, utc_s)
            elif isinstance(part, BasicId):
                self.names.hear(part)

    def _take(
        self, link: str, source: Hashable, frame: Frame, part: RemoteIdMessage, now_s: float, utc_s: float | None
    ) -> None:
        lock = self._telemetry.lock
        sysid = lock.sysid if lock else self._config.vehicle_sysid
        if sysid is None:  # until own reports can be told from others', we would avoid ourselves
            self.counters["heard_before_the_vehicle"] += 1
            return
        report = self._assemblers[link].receive((frame.sysid, frame.compid), part, now_s)
        if isinstance(part, Location):
            self.reports += 1
        if report is not None:
            self._picture.receive(
                link, report, utc_s=utc_s, own_sysid=sysid, own_names=self.names.known, source=(link, source)
            )
