"""A drone that only listened is in its own log: by its telemetry, as long as its broadcast is not heard."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest
from msgspec.structs import replace as replace_in

from ridlink.geodesy import geodetic_from_ned
from ridlink.mavlink.codec import CRC_EXTRAS, MESSAGES_BY_NAME, Encoder
from ridlink.mavlink.frames import parse_datagram
from ridlink.observer import Scene
from ridlink.remote_id.accuracy import coded_bound_m
from ridlink.remote_id.convert import to_mavlink
from ridlink.remote_id.messages import Location
from ridlink.remote_id.quantities import write_position
from ridlink.review import Report, Source, Walk, together
from tests.captures.conftest import START_US, tlog_bytes
from tests.observer.flights import HOME, Flyer
from tests.review.recordings import NORTHBOUND, SOUTHBOUND, START_S, records

Records = list[tuple[int, bytes]]
BASIC_ID = MESSAGES_BY_NAME["OPEN_DRONE_ID_BASIC_ID"].msgid
ARMED, PX4, AUTOPILOT, IN_AIR = 0x80, 12, 1, 2


def telemetry(flyer: Flyer, until_s: float, *, period_s: float = 0.2, armed: bool = True) -> Records:
    """What a vehicle says to its ground station, with an accuracy of 1 m."""
    encoder = Encoder(flyer.sysid, AUTOPILOT)
    said: Records = []
    for step in range(round(until_s / period_s)):
        time_s = step * period_s
        time_us = START_US + round(time_s * 1e6)
        if step % 5 == 0:
            beat = {"type": 2, "autopilot": PX4, "base_mode": ARMED * armed, "mavlink_version": 3}
            said.append((time_us, encoder.encode("HEARTBEAT", **beat)))
            said.append((time_us, encoder.encode("EXTENDED_SYS_STATE", landed_state=IN_AIR)))
        latitude_deg, longitude_deg, _ = geodetic_from_ned((*flyer.at(time_s), 0.0), HOME)
        lat, lon = write_position(float(latitude_deg), float(longitude_deg))
        height_mm = round(flyer.altitude_m * 1e3)
        gps = {"fix_type": 3, "lat": lat, "lon": lon, "alt": height_mm, "alt_ellipsoid": height_mm,
               "h_acc": 1000, "v_acc": 1000, "satellites_visible": 12}  # fmt: skip
        said.append((time_us, encoder.encode("GPS_RAW_INT", time_usec=time_us, **gps)))
        north, east = flyer.velocity(time_s)
        position = {"lat": lat, "lon": lon, "alt": height_mm, "vx": round(north * 100), "vy": round(east * 100)}
        said.append((time_us, encoder.encode("GLOBAL_POSITION_INT", time_boot_ms=round(time_s * 1e3), **position)))
    return said


def reported(path: Path, recorded: Records) -> tuple[list[dict], Walk]:  # type: ignore[type-arg]
    path.write_bytes(tlog_bytes(sorted(recorded, key=lambda record: record[0])))
    rows: list[dict] = []  # type: ignore[type-arg]
    walk = Walk([Report(on_encounter=rows.append)])
    walk.through(together([Source(str(path))]))
    return rows, walk


def test_a_listener_meets_whom_it_hears(tmp_path: Path) -> None:
    [row], walk = reported(tmp_path / "f.tlog", telemetry(NORTHBOUND, 25.0) + records([SOUTHBOUND], 25.0))
    assert sorted(row["uas"]) == ["1/1", "BRAVO"] and walk.aircraft == 2
    assert row["closest_m"] == pytest.approx(6.0, abs=0.2)
    assert row["closest_t"] - START_S == pytest.approx(20.0, abs=0.1)
    assert row["closest_vertical_m"] == pytest.approx(0.0, abs=0.1)
    own = row["uas"].index("1/1")
    assert 3.0 <= row["horizontal_error_m"][own] < 10.0, "three sigma of what its receiver says"
    assert row["mac_distance_m"] == pytest.approx((7.5 + 0.6) / 2.0), "its size is not known"


def test_who_broadcasts_is_known_by_that_alone(tmp_path: Path) -> None:
    said = telemetry(NORTHBOUND, 25.0) + records([NORTHBOUND, SOUTHBOUND], 26.0)
    [row], walk = reported(tmp_path / "f.tlog", said)
    assert sorted(row["uas"]) == ["ALPHA", "BRAVO"] and walk.aircraft == 2


@pytest.mark.parametrize("extended", [True, False])
@pytest.mark.parametrize(("begins_s", "ends_s"), [(0.0, 8.0), (6.0, 20.0)])
def test_it_never_meets_itself_where_its_broadcast_begins_or_ends(
    tmp_path: Path, begins_s: float, ends_s: float, extended: bool
) -> None:
    """Its module speaks with a component of its own."""
    module = [
        (time_us, frame)
        for time_us, frame in records([replace(NORTHBOUND, compid=236, extended=extended)], 20.0)
        if begins_s <= (time_us - START_US) / 1e6 < ends_s
    ]
    rows, _ = reported(tmp_path / "f.tlog", telemetry(NORTHBOUND, 20.0) + module)
    assert rows == []


@pytest.mark.parametrize("extended", [True, False])
def test_an_identity_that_is_told_amid_positions_stays_when_the_broadcast_ends(tmp_path: Path, extended: bool) -> None:
    def is_heard(time_us: int, frame: bytes) -> bool:
        time_s = (time_us - START_US) / 1e6
        [message] = parse_datagram(frame, CRC_EXTRAS)
        return time_s < 8.0 and (time_s > 1.0 or message.msgid != BASIC_ID)

    module = records([replace(NORTHBOUND, compid=236, extended=extended)], 25.0)
    module = [(time_us, frame) for time_us, frame in module if is_heard(time_us, frame)]
    rows, _ = reported(tmp_path / "f.tlog", telemetry(NORTHBOUND, 25.0) + module + records([SOUTHBOUND], 25.0))
    assert [sorted(row["uas"]) for row in rows] == 2 * [["ALPHA", "BRAVO"]], "while it broadcasts, and afterwards"


def told_to_the_transmitter(flyer: Flyer, until_s: float) -> Records:
    """What PX4 says of itself on all links: once a second, without a time, and with the code of one sigma of 0.9 m."""
    encoder = Encoder(flyer.sysid, AUTOPILOT)
    said: Records = []
    for second in range(int(until_s)):
        [location] = [each for each in flyer.messages(second + 0.05) if isinstance(each, Location)]
        name, fields = to_mavlink(replace_in(location, timestamp_s=None, horizontal_accuracy=12))
        said.append((START_US + round((second + 0.05) * 1e6), encoder.encode(name, **fields)))
    return said


class Codes:
    """Which errors are known of whom, scene by scene."""

    def __init__(self) -> None:
        self.bounds_m: list[dict[str, tuple[float, float]]] = []

    def step(self, scene: Scene) -> None:
        bounds = zip(scene.error_bound_m.tolist(), scene.accuracy_bound_m.tolist(), strict=True)
        self.bounds_m.append(dict(zip(scene.names, bounds, strict=True)))

    def end(self) -> None:
        """The recording is over."""


def bounds_of(path: Path, recorded: Records, name: str) -> set[tuple[float, float]]:
    """Error and accuracy bound that a vehicle had in any scene [m], -1 where unknown."""
    path.write_bytes(tlog_bytes(sorted(recorded, key=lambda record: record[0])))
    codes = Codes()
    Walk([codes]).through(together([Source(str(path))]))
    found = [each[name] for each in codes.bounds_m if name in each]
    return {(-1.0 if math.isnan(error) else round(error, 1), round(coded, 1)) for error, coded in found}


def test_a_broadcast_that_tells_no_error_counts_as_it_was_heard(tmp_path: Path) -> None:
    """As the others could know it, whatever its telemetry says: 40 m and 7.5 m, or by its code."""
    stock = replace(NORTHBOUND, extended=False)
    said = telemetry(NORTHBOUND, 25.0) + records([stock, SOUTHBOUND], 25.0)
    [row], walk = reported(tmp_path / "f.tlog", said)
    assert row["uas"] == ["ALPHA", "BRAVO"] and walk.aircraft == 2
    assert row["horizontal_error_m"] == [None, 10.5]
    assert row["closest_m"] == pytest.approx(6.0, abs=0.2)
    assert row["margin_m"]["candidate2"] == pytest.approx(6.0 - (7.5 + 0.6) / 2.0 - 50.5 - 2.0, abs=0.3)
    assert row["margin_m"]["odid-accuracy"] == pytest.approx(6.0 - 7.5 - 2.0 * 12.256 - 2.0, abs=0.3)


def test_what_an_autopilot_tells_its_transmitter_is_no_broadcast(tmp_path: Path) -> None:
    """Its telemetry says more, and so does the broadcast: the code that it tells is no other's."""
    flown = telemetry(NORTHBOUND, 20.0)
    told, stock = told_to_the_transmitter(NORTHBOUND, 20.0), replace(NORTHBOUND, extended=False)
    later = {bound for bound in bounds_of(tmp_path / "own.tlog", flown + told, "1/1") if bound[0] > 0.0}
    assert later == bounds_of(tmp_path / "telemetry.tlog", flown, "1/1")
    broadcast = records([stock], 20.0)
    assert bounds_of(tmp_path / "heard.tlog", flown + told + broadcast, "ALPHA") == {(-1.0, 12.3)}


def test_telemetry_has_the_code_that_its_broadcast_would_have(tmp_path: Path) -> None:
    [(error_m, coded_m)] = bounds_of(tmp_path / "f.tlog", telemetry(NORTHBOUND, 20.0), "1/1")
    assert 3.0 <= error_m < 10.0
    assert coded_m == pytest.approx(coded_bound_m(error_m), abs=0.1)


def test_its_own_receiver_that_hears_it_makes_it_no_second_aircraft(tmp_path: Path) -> None:
    """The identity is what joins them: said to the transmitter by the autopilot, and relayed by the receiver."""
    relayed = replace(NORTHBOUND, compid=237, id_or_mac=b"\x02relay".ljust(20, b"\0"))
    identity = [(time_us, frame) for time_us, frame in records([NORTHBOUND], 20.0) if frame[7:10] == b"\x64\x32\x00"]
    rows, _ = reported(tmp_path / "f.tlog", telemetry(NORTHBOUND, 20.0) + identity + records([relayed], 20.0))
    assert rows == []


def test_who_stands_disarmed_is_not_in_the_air(tmp_path: Path) -> None:
    said = telemetry(NORTHBOUND, 25.0, armed=False) + records([SOUTHBOUND], 25.0)
    rows, _ = reported(tmp_path / "f.tlog", said)
    assert rows == []
