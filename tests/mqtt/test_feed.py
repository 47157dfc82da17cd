"""A foreign feed: good aircraft become frames that a daemon takes, everything else is counted."""

from __future__ import annotations

import json
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ridlink.mavlink.codec import CRC_EXTRAS
from ridlink.mavlink.frames import Frame, parse_datagram
from ridlink.mqtt.feed import Feed
from ridlink.observer import Aircraft, Sky
from ridlink.traffic.picture import TrafficPicture
from tests.traffic.reports import SETTINGS

UTC_S = 1_700_000_123.4


def sky_of(payload: Any, feed: Feed | None = None) -> dict[str, Aircraft]:
    sky = Sky()
    raw = payload if isinstance(payload, bytes) else json.dumps(payload).encode()
    for data in (feed or Feed()).frames(raw, UTC_S):
        for found in parse_datagram(data, CRC_EXTRAS):
            assert isinstance(found, Frame) and found.checked
            sky.receive(found, 0.0)
    return {one.name: one for one in sky.aircraft.values()}


def test_what_we_publish_ourselves_can_be_taken_at_another_site() -> None:
    state = {
        "uas": "ALPHA",
        "latitude_deg": 47.4,
        "longitude_deg": 8.5,
        "altitude_geodetic_m": 550.0,
        "speed_horizontal_mps": 10.0,
        "direction_deg": 90.0,
        "horizontal_error_m": 10.5,
        "age_s": 0.4,
    }
    one = sky_of({"states": [state, state | {"uas": "BRAVO", "latitude_deg": 47.5}]})["ALPHA"].report
    assert (one.latitude_deg, one.longitude_deg) == pytest.approx((47.4, 8.5))
    assert one.velocity_ned_mps == pytest.approx((0.0, 10.0, 0.0), abs=0.01)
    assert one.horizontal_error_m == 10.5
    assert one.timestamp_s == pytest.approx((UTC_S - 0.4) % 3600.0, abs=0.06)
    assert not one.avoiding


def test_names_of_other_tools_are_understood_but_an_altitude_above_an_unknown_reference_is_none() -> None:
    row = {"id": "drone-1", "lat": 47.4, "lon": 8.5, "alt": 600.0, "speed": 3.0, "track": 180}
    one = sky_of(row)["drone-1"].report
    assert one.altitude_geodetic_m is None
    assert one.velocity_ned_mps == pytest.approx((-3.0, 0.0, 0.0), abs=0.01)


@pytest.mark.parametrize(
    ("payload", "cause"),
    [
        (b"{", "not_json"),
        (b'{"id": "\xfd"}', "not_json"),
        (b"[" * 5000, "not_json"),
        (b" " * 70_000, "too_long"),
        (b"[1, null]", "not_an_object"),
        (b'{"lat": 1, "lon": 1}', "without_identity"),
        (b'{"id": "a", "lat": 0, "lon": 0}', "without_position"),
        (b'{"id": "a", "lat": 91, "lon": 1}', "without_position"),
        (b'{"id": "a", "lat": "47", "lon": 1}', "without_position"),
        (b'{"id": "a", "lat": 47, "lon": 1, "age_s": 4}', "too_old"),
        (b'{"id": "a", "lat": 47, "lon": 1, "age_s": 1' + b"0" * 400 + b"}", "too_old"),
        (b'{"id": "a", "lat": true, "lon": 1}', "without_position"),
        (b'{"id": "a", "lat": 1, "lon": 1' + b"0" * 400 + b"}", "without_position"),  # an integer that is no float
    ],
)
def test_what_is_no_aircraft_is_counted(payload: bytes, cause: str) -> None:
    feed = Feed()
    assert not sky_of(payload, feed)
    assert feed.counters[cause] >= 1 and not feed.counters["aircraft"]


def test_aircraft_beyond_those_of_one_message_are_counted() -> None:
    feed = Feed()
    feed.frames(json.dumps([{"id": f"N{number}", "lat": 47.4, "lon": 8.5} for number in range(503)]).encode(), UTC_S)
    assert feed.counters == {"aircraft": 500, "too_many": 3}


@pytest.mark.parametrize("age_s", [0.0, 0.3, 2.0, 3.9])
@pytest.mark.parametrize("on_the_way_s", [0.0, 0.5, 1.0])
def test_an_old_position_is_never_taken_for_a_new_one(age_s: float, on_the_way_s: float) -> None:
    picture = TrafficPicture(SETTINGS)
    (one,) = sky_of({"id": "a", "lat": 47.4, "lon": 8.5, "age_s": age_s}).values()
    picture.receive("relay", one.report, utc_s=UTC_S + on_the_way_s)
    (track,) = picture.tracks.values()
    assert one.report.received_at_s - track.measured_at_s == pytest.approx(age_s + on_the_way_s, abs=0.051)


numbers = st.floats() | st.integers(-(10**400), 10**400)
values = st.recursive(
    st.none() | st.booleans() | numbers | st.text(max_size=30),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=6,
)
keys = st.sampled_from(["id", "lat", "lon", "speed", "track", "age_s", "vspeed", "horizontal_error_m", "states", "x"])


@settings(max_examples=200, deadline=None)
@given(
    st.dictionaries(keys, values, max_size=9)
    | st.fixed_dictionaries({"id": st.text(min_size=1), "lat": numbers, "lon": numbers}, optional={"age_s": numbers})
    | values
    | st.binary(max_size=60)
)
def test_nothing_in_a_feed_raises(payload: Any) -> None:
    raw = payload if isinstance(payload, bytes) else json.dumps(payload).encode()
    sky_of(raw)
