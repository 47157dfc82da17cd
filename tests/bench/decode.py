"""Decoding and encoding whole captures beside pymavlink: columns, lines, counts, batches of frames, damage.

Ratios are taken round by round, between runs that follow each other. pymavlink parses a tenth of the messages, for it
would take most of the time otherwise; its time grows with their number.
"""

from __future__ import annotations

import os
import resource
import statistics
import struct
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import common as stock

from ridlink.captures.columns import decode, encode
from ridlink.mavlink import dialect
from ridlink.mavlink.codec import Encoder
from tests.bench.measure import ROUNDS, cpu_seconds
from tests.captures.pcap_files import ethernet, ipv4, pcap, udp

MESSAGES = 1_000_000
SHARE = 10
START_US = 1_700_000_000_000_000
FLIPPED = 0.001
PROGRAM_ROUNDS = 3

LATITUDE_DEGE7, LONGITUDE_DEGE7 = 473977420, 85455940
CYCLE = ("HEARTBEAT", *("GLOBAL_POSITION_INT", "OPEN_DRONE_ID_LOCATION", "RIDLINK_SEPARATION") * 3,
         "GLOBAL_POSITION_INT", "OPEN_DRONE_ID_BASIC_ID", "OPEN_DRONE_ID_SYSTEM")  # fmt: skip


def traffic(count: int) -> list[bytes]:
    """HEARTBEAT : GLOBAL_POSITION_INT : LOCATION : BASIC_ID : SYSTEM as 1 : 4 : 3 : 1 : 1, and a RIDLINK_SEPARATION
    for each LOCATION, of eight senders that move."""
    random = np.random.default_rng(1)
    steps = random.integers(0, 1_000_000, count).tolist()
    encoders = [Encoder(sysid, 1) for sysid in range(1, 9)]
    frames = []
    for index, step in enumerate(steps):
        name = CYCLE[index % len(CYCLE)]
        latitude, longitude, second = LATITUDE_DEGE7 + step, LONGITUDE_DEGE7 - step, index * 0.01 % 3600.0
        fields: dict[str, dict[str, Any]] = {
            "HEARTBEAT": {"type": 2, "autopilot": 12, "mavlink_version": 3, "custom_mode": step},
            "GLOBAL_POSITION_INT": {
                "time_boot_ms": index, "lat": latitude, "lon": longitude, "alt": 488000, "vx": 100, "hdg": 900,
            },
            "OPEN_DRONE_ID_LOCATION": {
                "latitude": latitude, "longitude": longitude, "direction": 9000 + step % 100, "status": 2,
                "speed_horizontal": 1000, "altitude_geodetic": 535.5, "height": 50.0, "horizontal_accuracy": 11,
                "timestamp": second, "timestamp_accuracy": 2,
            },
            "RIDLINK_SEPARATION": {
                "timestamp": second, "horizontal_error": 300, "airframe_size": 60, "commanded_vx": step % 1000,
                "flags": 9,
            },
            "OPEN_DRONE_ID_BASIC_ID": {"uas_id": b"RIDLINK-0001", "id_type": 1, "ua_type": 2},
            "OPEN_DRONE_ID_SYSTEM": {"operator_latitude": latitude, "operator_longitude": longitude},
        }  # fmt: skip
        frames.append(encoders[index // len(CYCLE) % len(encoders)].encode(name, **fields[name]))
    return frames


def _row(what: str, ours_per_s: list[float], theirs_per_s: list[float]) -> dict[str, Any]:
    ratios = [own / peer for own, peer in zip(ours_per_s, theirs_per_s, strict=True)]
    return {
        "what": what,
        "ridlink_per_s": statistics.median(ours_per_s),
        "pymavlink_per_s": statistics.median(theirs_per_s),
        "ratio": statistics.median(ratios),
        "ratio_min": min(ratios),
        "ratio_max": max(ratios),
    }


def _beside(
    what: str, ours: Callable[[], object], ours_count: int, theirs: Callable[[], object], theirs_count: int,
    rounds: int = ROUNDS, cost: Callable[[Callable[[], object]], float] = cpu_seconds,
) -> dict[str, Any]:  # fmt: skip
    ours_per_s, theirs_per_s = [], []
    for turn in range(rounds + 1):
        peer, own = theirs_count / cost(theirs), ours_count / cost(ours)
        if turn:  # the first round warms up
            ours_per_s.append(own)
            theirs_per_s.append(peer)
    return _row(what, ours_per_s, theirs_per_s)


def _child_seconds(action: Callable[[], object]) -> float:
    """CPU time of the processes that an action starts and waits for [s]."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    action()
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def captures() -> list[dict[str, Any]]:
    """All comparisons."""
    with tempfile.TemporaryDirectory() as folder:
        return list(_captures(Path(folder)))


def _captures(folder: Path) -> list[dict[str, Any]]:
    frames = traffic(MESSAGES)
    some = b"".join(frames[: MESSAGES // SHARE])
    raw, tlog, small = folder / "all.mavlink", folder / "all.tlog", folder / "some.tlog"
    raw.write_bytes(b"".join(frames))
    timed = [struct.pack(">Q", START_US + 500 * index) + frame for index, frame in enumerate(frames)]
    tlog.write_bytes(b"".join(timed))
    small.write_bytes(b"".join(timed[: MESSAGES // SHARE]))

    def parse_buffer() -> None:
        mav = dialect.MAVLink(None)
        for at in range(0, len(some), 65536):
            mav.parse_buffer(some[at : at + 65536])

    rows = [
        _beside("decode a tlog into columns", lambda: decode(tlog), MESSAGES, parse_buffer, MESSAGES // SHARE),
        _beside("decode a raw stream into columns", lambda: decode(raw), MESSAGES, parse_buffer, MESSAGES // SHARE),
    ]

    locations = decode(tlog, ["OPEN_DRONE_ID_LOCATION"])["OPEN_DRONE_ID_LOCATION"]
    mav, own_id, count = stock.MAVLink(None, 1, 1), [0] * 20, 20_000

    def pack() -> None:
        for _ in range(count):
            mav.open_drone_id_location_encode(
                0,
                0,
                own_id,
                2,
                9000,
                1000,
                0,
                LATITUDE_DEGE7,
                LONGITUDE_DEGE7,
                0.0,
                535.5,
                0,
                50.0,
                11,
                0,
                0,
                0,
                1.0,
                2,
            ).pack(mav)

    name = "OPEN_DRONE_ID_LOCATION"
    rows.append(_beside("encode LOCATION from columns", lambda: encode(name, locations), len(locations), pack, count))
    packets = folder / "all.pcap"
    packets.write_bytes(
        pcap([(START_US + 500 * index, ethernet(ipv4(udp(frame)))) for index, frame in enumerate(frames)])
    )
    rows += _programs(tlog, packets, small)
    return rows


def _programs(tlog: Path, packets: Path, small: Path) -> list[dict[str, Any]]:
    """Whole processes that write lines and that count; those whose peer is installed.

    A pcap is no file for the peers: beside it they read the same messages out of a tlog.
    """
    environment = os.environ | {"MAVLINK20": "1", "MAVLINK_DIALECT": "common"}

    def run(*command: str | Path) -> None:
        subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=True, env=environment)

    def beside(what: str, path: Path, ours: list[str], script: str, theirs: list[str]) -> dict[str, Any] | None:
        peer = Path(sys.executable).with_name(script)
        if not peer.exists():
            return None
        return _beside(
            f"{what}, whole process ({peer.stem})",
            lambda: run(sys.executable, "-m", "ridlink", "decode", path, *ours), MESSAGES,
            lambda: run(sys.executable, "-W", "ignore", peer, *theirs, small), MESSAGES // SHARE,
            PROGRAM_ROUNDS, _child_seconds,
        )  # fmt: skip

    rows = [
        beside("rows", tlog, [], "mavlogdump.py", []),
        beside("JSON lines", tlog, ["-f", "jsonl"], "mavlogdump.py", ["--format", "json"]),
        beside("counts", tlog, ["--stats"], "mavloss.py", ["--stats", "--dialect", "common"]),
        beside("rows of a pcap", packets, [], "mavlogdump.py", []),
        beside("JSON lines of a pcap", packets, ["-f", "jsonl"], "mavlogdump.py", ["--format", "json"]),
        beside("counts of a pcap", packets, ["--stats"], "mavloss.py", ["--stats", "--dialect", "common"]),
    ]
    return [row for row in rows if row is not None]


def damage() -> dict[str, int]:
    """100,000 frames with one byte in a thousand changed: how many are intact, and how many of those come back."""
    frames = traffic(100_000)
    data = np.frombuffer(bytearray(b"".join(frames)), np.uint8)
    random = np.random.default_rng(2)
    hit = random.random(len(data)) < FLIPPED
    data[hit] ^= random.integers(1, 256, int(hit.sum()), dtype=np.uint8)
    ends = np.cumsum([len(frame) for frame in frames])
    begins = ends - [len(frame) for frame in frames]
    hits = np.concatenate([[0], np.cumsum(hit)])
    intact = set(begins[hits[ends] == hits[begins]].tolist())
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "damaged.mavlink"
        path.write_bytes(data)
        columns = decode(path, kind="mavlink")
    found = {offset for rows in columns.values() for offset in rows["offset"].tolist()}
    mav = dialect.MAVLink(None)
    mav.robust_parsing = True
    parsed = mav.parse_buffer(data.tobytes()) or []
    theirs = {bytes(message.get_msgbuf()) for message in parsed if message.get_type() != "BAD_DATA"}
    by_offset = dict(zip(begins.tolist(), frames, strict=True))
    return {
        "frames": len(frames),
        "intact": len(intact),
        "ridlink": len(intact & found),
        "pymavlink": sum(by_offset[offset] in theirs for offset in intact),
    }


def start() -> dict[str, float]:
    """Wall time of the first decode of a process: with an empty cache of compiled code, and with a full one [s]."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "f.tlog"
        path.write_bytes(struct.pack(">Q", START_US) + Encoder(1, 1).encode("HEARTBEAT", type=2))
        code = "import sys,time;from ridlink import decode;b=time.perf_counter();decode(sys.argv[1])"
        command = [sys.executable, "-c", f"{code};print(time.perf_counter()-b)", str(path)]
        environment = os.environ | {"NUMBA_CACHE_DIR": str(Path(folder) / "cache")}
        cold, warm = (
            float(subprocess.run(command, capture_output=True, text=True, check=True, env=environment).stdout)
            for _ in range(2)
        )
    return {"cold_s": cold, "cached_s": warm}


def report() -> dict[str, Any]:
    """Measure everything and print it."""
    rows = captures()
    print(f"\ncaptures, {MESSAGES:,} messages, CPU time on one core, median of interleaved rounds")
    print(f"{'':46}{'ridlink':>14}{'pymavlink':>12}{'ratio':>8}  (spread)")
    for row in rows:
        print(
            f"{row['what']:46}{row['ridlink_per_s']:>12,.0f}/s{row['pymavlink_per_s']:>10,.0f}/s"
            f"{row['ratio']:>8.1f}  ({row['ratio_min']:.1f}-{row['ratio_max']:.1f})"
        )
    recovered, started = damage(), start()
    print(
        f"one byte in {1 / FLIPPED:,.0f} changed: of {recovered['intact']:,} intact frames among "
        f"{recovered['frames']:,} ridlink finds {recovered['ridlink']:,}, pymavlink {recovered['pymavlink']:,}"
    )
    print(f"first decode: {started['cold_s']:.1f} s when it compiles, {started['cached_s']:.2f} s afterwards")
    return {"captures": rows, "damage": recovered, "start": started}
