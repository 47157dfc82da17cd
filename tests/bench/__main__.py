"""Print the benchmark tables, and write them as JSON: ``python -m tests.bench [-o FILE.json]``.

Machines are shared and noisy: peers run interleaved, figures are medians of CPU time over rounds, with their spread,
and the ratio is what counts.
"""

from __future__ import annotations

import argparse
import json
import statistics
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import common as stock

from ridlink.avoidance.solver import HalfplaneSolver, warm_up
from ridlink.avoidance.types import OwnShip, Traffic
from ridlink.mavlink.codec import CRC_EXTRAS, Encoder, decode_message
from ridlink.mavlink.frames import Frame, FrameParser, parse_datagram
from ridlink.traffic.encounter import encounters
from tests.avoidance import study_rvo2
from tests.bench import avoidance, decode, fleet, response, start, view, ways
from tests.bench.measure import ROUNDS, interleaved

FRAMES = 20_000


def traffic_mix(count: int) -> list[bytes]:
    """HEARTBEAT : GLOBAL_POSITION_INT : LOCATION : BASIC_ID : SYSTEM as 1 : 4 : 3 : 1 : 1."""
    encoder = Encoder(1, 1)
    own_id = bytes(20)
    cycle: list[tuple[str, dict[str, Any]]] = [("HEARTBEAT", {"type": 2, "autopilot": 12, "mavlink_version": 3})]
    position = {"lat": 473977420, "lon": 85455940, "alt": 488000, "relative_alt": 50000, "vx": 100, "hdg": 900}
    cycle += [("GLOBAL_POSITION_INT", {**position, "time_boot_ms": k}) for k in range(4)]
    location = {"latitude": 473977420, "longitude": 85455940, "direction": 9000, "altitude_geodetic": 535.5}
    cycle += [("OPEN_DRONE_ID_LOCATION", {**location, "id_or_mac": own_id, "timestamp": 0.1 * k}) for k in range(3)]
    cycle += [("OPEN_DRONE_ID_BASIC_ID", {"uas_id": b"RIDLINK-0001", "id_type": 1, "ua_type": 2})]
    cycle += [("OPEN_DRONE_ID_SYSTEM", {"operator_latitude": 473977420, "operator_longitude": 85455940})]
    return [encoder.encode(name, **fields) for k in range(count) for name, fields in [cycle[k % len(cycle)]]]


def wire() -> list[dict[str, Any]]:
    """Decoding and encoding beside pymavlink."""
    frames = traffic_mix(FRAMES)
    stream = b"".join(frames)

    def datagrams_ridlink() -> None:
        for frame in frames:
            for found in parse_datagram(frame, CRC_EXTRAS):
                assert isinstance(found, Frame)
                decode_message(found)

    def datagrams_pymavlink() -> None:
        mav = stock.MAVLink(None)
        for frame in frames:
            mav.parse_buffer(frame)

    def stream_ridlink() -> None:
        parser = FrameParser(CRC_EXTRAS)
        for at in range(0, len(stream), 65536):
            for found in parser.feed(stream[at : at + 65536]):
                assert isinstance(found, Frame)
                decode_message(found)

    def stream_pymavlink() -> None:
        mav = stock.MAVLink(None)
        for at in range(0, len(stream), 65536):
            mav.parse_buffer(stream[at : at + 65536])

    encoder = Encoder(1, 1)
    location = {"latitude": 473977420, "longitude": 85455940, "direction": 9000, "altitude_geodetic": 535.5}

    def encode_ridlink() -> None:
        for _ in range(FRAMES):
            encoder.encode("OPEN_DRONE_ID_LOCATION", **location, id_or_mac=bytes(20), timestamp=1.0)

    def encode_pymavlink() -> None:
        mav = stock.MAVLink(None, 1, 1)
        own_id = [0] * 20
        for _ in range(FRAMES):
            mav.open_drone_id_location_encode(
                0, 0, own_id, 2, 9000, 0, 0, 473977420, 85455940, 0.0, 535.5, 0, 0.0, 0, 0, 0, 0, 1.0, 0
            ).pack(mav)

    pairs = {
        "decode, one frame a datagram": (datagrams_ridlink, datagrams_pymavlink),
        "decode, 64 kB of stream at a time": (stream_ridlink, stream_pymavlink),
        "encode LOCATION": (encode_ridlink, encode_pymavlink),
    }
    rows = []
    for what, (ours, theirs) in pairs.items():
        seconds = interleaved({"ridlink": ours, "pymavlink": theirs})
        ratios = [peer / own for own, peer in zip(seconds["ridlink"], seconds["pymavlink"], strict=True)]
        rows.append(
            {
                "what": what,
                "ridlink_per_s": FRAMES / statistics.median(seconds["ridlink"]),
                "pymavlink_per_s": FRAMES / statistics.median(seconds["pymavlink"]),
                "ratio": statistics.median(ratios),
                "ratio_min": min(ratios),
                "ratio_max": max(ratios),
            }
        )
    return rows


def decisions() -> list[dict[str, Any]]:
    """Time of one decision for one own-ship, numpy in and out, and how it grows with the neighbours; and the same with
    the threats ranked by the time until their disc is entered, as the engine does it."""
    warm_up()
    random = np.random.default_rng(1)
    rows = []
    for count in (1, 8, 23, 100, 1000):
        position = random.uniform(-400.0, 400.0, (count, 2))
        velocity = random.uniform(-10.0, 10.0, (count, 2))
        radius, age = np.full(count, 23.6), np.full(count, 0.05)
        traffic = Traffic(
            position, velocity, velocity, age, radius, np.full(count, 21.0), np.ones(count, np.bool_),
            np.zeros(count, np.int8),
        )  # fmt: skip
        own = OwnShip(np.zeros(2), np.array([10.0, 0.0]), np.array([10.0, 0.0]), 0.6, 10.0)
        solver = HalfplaneSolver()
        taken, ranked = [], []
        for _ in range(300):
            begun = time.perf_counter()
            seen = encounters(position + velocity * age[:, None], velocity - own.velocity_ne_mps, radius)
            np.argsort(seen.entry_s, kind="stable")
            between = time.perf_counter()
            solver.solve(own, traffic, goal_ne_m=(200.0, 0.0), cruise_mps=10.0)
            ended = time.perf_counter()
            taken.append(1e6 * (ended - between))
            ranked.append(1e6 * (ended - begun))
        taken.sort()
        ranked.sort()
        rows.append(
            {
                "neighbours": count,
                "p50_us": taken[150],
                "p99_us": taken[297],
                "max_us": taken[-1],
                "ranked_p99_us": ranked[297],
            }
        )
    return rows


def _made(folder: Path) -> Path:
    folder.mkdir(exist_ok=True)
    return folder


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.bench", description=__doc__)
    parser.add_argument("-o", "--output", type=Path, help="also write the tables as JSON")
    output = parser.parse_args().output

    wire_rows = wire()
    print(f"wire, {FRAMES} frames, CPU time, median of {ROUNDS} interleaved rounds")
    print(f"{'':36}{'ridlink':>12}{'pymavlink':>12}{'ratio':>8}  (spread)")
    for row in wire_rows:
        print(
            f"{row['what']:36}{row['ridlink_per_s']:>10,.0f}/s{row['pymavlink_per_s']:>10,.0f}/s"
            f"{row['ratio']:>8.2f}  ({row['ratio_min']:.2f}-{row['ratio_max']:.2f})"
        )
    decision_rows = decisions()
    print("\none decision of the half-plane solver, numpy in and out, wall time of 300")
    print(f"{'neighbours':>10}{'p50':>10}{'p99':>10}{'max':>10}{'p99 with threats ranked':>26}")
    for row in decision_rows:
        print(
            f"{row['neighbours']:>10}{row['p50_us']:>7.0f} us{row['p99_us']:>7.0f} us{row['max_us']:>7.0f} us"
            f"{row['ranked_p99_us']:>23.0f} us"
        )
    batch_rows = avoidance.report()
    way_rows = ways.report()
    capture_rows = decode.report()
    response_rows = response.report((output.parent if output else _made(Path("build"))) / "step_responses.png")
    fleet_rows = fleet.report()
    view_rows = view.report()
    start_rows = start.report()
    crowd_rows = study_rvo2.report()
    if output:
        output.write_text(
            json.dumps(
                {
                    "wire": wire_rows,
                    "decisions": decision_rows,
                    **batch_rows,
                    **way_rows,
                    **capture_rows,
                    **response_rows,
                    **fleet_rows,
                    **view_rows,
                    **start_rows,
                    **crowd_rows,
                },
                indent=1,
            )
            + "\n"
        )
        print(f"\n{output}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
