"""Read a telemetry log: write a short one, read it message by message, and find the closest approach.

python examples/decode_log.py
"""

import math
import tempfile
from pathlib import Path

from ridlink.captures import TlogWriter, read_messages
from ridlink.geodesy import moved, offset_m
from ridlink.mavlink.codec import Encoder
from ridlink.remote_id.assembler import ReportAssembler
from ridlink.remote_id.convert import to_mavlink
from ridlink.remote_id.messages import Location, Separation

START_US = 1_700_000_000_000_000
HOME_DEG = (47.4, 8.5)


def write_log(path: Path) -> None:
    """Two vehicles fly past each other, north and south, 10 m/s each, 12 m apart; only one sends its position error."""
    north, south = Encoder(1, 1), Encoder(2, 1)
    with TlogWriter(path) as log:
        for tenth in range(100):
            way_m = tenth * 0.1 * 10.0
            for encoder, metres, east_m, direction in ((north, way_m - 50, 0, 0.0), (south, 50 - way_m, 12, 180.0)):
                latitude_deg, longitude_deg = moved(*HOME_DEG, metres, east_m)
                location = Location(
                    latitude_deg=latitude_deg,
                    longitude_deg=longitude_deg,
                    speed_horizontal_mps=10.0,
                    direction_deg=direction,
                    timestamp_s=tenth / 10,
                )
                messages: list[Location | Separation] = [location]
                if encoder is north:
                    messages.append(Separation(timestamp_s=tenth / 10, horizontal_error_m=3.0, airframe_size_m=0.6))
                for message in messages:
                    name, fields = to_mavlink(message)
                    log.write(START_US + tenth * 100_000, encoder.encode(name, **fields))


def main() -> None:
    """Print the distance every second, then the closest approach and the position error that each vehicle sent."""
    assembler = ReportAssembler()
    ground_ne_m: dict[int, tuple[float, float]] = {}
    error_m: dict[int, float | None] = {}
    closest_m, closest_at_s = math.inf, 0.0
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "two_vehicles.tlog"
        write_log(path)
        for record in read_messages(path):
            if record.remote_id is None or record.time_us is None:
                continue
            at_s = (record.time_us - START_US) / 1e6
            report = assembler.receive(record.source, record.remote_id, at_s)
            if report is None or report.latitude_deg is None or report.longitude_deg is None:
                continue
            vehicle = report.source[0]
            error_m[vehicle] = report.horizontal_error_m
            ground_ne_m[vehicle] = offset_m(HOME_DEG, (report.latitude_deg, report.longitude_deg))
            if vehicle != 2:
                continue
            distance_m = math.dist(ground_ne_m[1], ground_ne_m[2])
            if distance_m < closest_m:
                closest_m, closest_at_s = distance_m, at_s
            if at_s % 1.0 == 0.0:
                print(f"{at_s:4.1f} s  {distance_m:6.1f} m apart")
    print(f"closest approach: {closest_m:.1f} m after {closest_at_s:.1f} s")
    for vehicle, bound_m in error_m.items():
        print(f"vehicle {vehicle}: position error {'not told, 40 m is assumed' if bound_m is None else f'{bound_m} m'}")


main()
