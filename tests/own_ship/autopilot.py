"""An autopilot that says things to a telemetry."""

from __future__ import annotations

from collections.abc import Hashable

from ridlink.mavlink.codec import CRC_EXTRAS, Encoder, decode_message
from ridlink.mavlink.frames import Frame, parse_datagram
from ridlink.own_ship import OwnShipTelemetry

HERE = (47.3977, 8.5456)


class Autopilot:
    """Says things to a telemetry, as real frames."""

    def __init__(self, telemetry: OwnShipTelemetry, sysid: int = 1, compid: int = 1, source: Hashable = "a") -> None:
        self.telemetry, self.encoder, self.source = telemetry, Encoder(sysid, compid), source

    def say(self, now_s: float, name: str, **fields: object) -> None:
        (frame,) = parse_datagram(self.encoder.encode(name, **fields), CRC_EXTRAS)
        assert isinstance(frame, Frame)
        self.telemetry.receive(frame.sysid, frame.compid, decode_message(frame), now_s, self.source)

    def heartbeat(self, now_s: float, *, autopilot: int = 12, mode: int = 6 << 16, armed: bool = True) -> None:
        self.say(now_s, "HEARTBEAT", type=2, autopilot=autopilot, base_mode=129 if armed else 1, custom_mode=mode)

    def position(self, now_s: float, **fields: object) -> None:
        given = {"lat": round(HERE[0] * 1e7), "lon": round(HERE[1] * 1e7), "alt": 540_000, "relative_alt": 50_000}
        given |= {"time_boot_ms": round(now_s * 1e3)} | fields
        self.say(now_s, "GLOBAL_POSITION_INT", **given)

    def receiver(self, now_s: float, **fields: object) -> None:
        self.say(now_s, "GPS_RAW_INT", **({"fix_type": 3, "h_acc": 900, "v_acc": 1500, "alt": 540_000} | fields))


def flying(now_s: float = 0.0, **options: object) -> tuple[OwnShipTelemetry, Autopilot]:
    telemetry = OwnShipTelemetry(**options)  # type: ignore[arg-type]
    autopilot = Autopilot(telemetry)
    autopilot.heartbeat(now_s)
    autopilot.receiver(now_s)
    autopilot.position(now_s)
    return telemetry, autopilot
