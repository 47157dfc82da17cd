"""Whatever senders claim, rows are strict JSON and the page is drawn."""

from __future__ import annotations

import json
from typing import Any

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ridlink.mavlink.codec import CRC_EXTRAS, Encoder
from ridlink.mavlink.frames import Frame, parse_datagram
from ridlink.review import Report, Walk
from ridlink.review.page import Summary, report_page
from ridlink.review.whatif import WhatIf
from ridlink.separation.definitions import Definition
from tests.captures.conftest import START_US

claims = st.fixed_dictionaries(
    {
        "latitude": st.sampled_from([0, 474_000_000, 474_000_100, 900_000_000, -900_000_000, 2**31 - 1]),
        "longitude": st.sampled_from([0, 85_000_000, 85_000_100, 1_800_000_000, -1_800_000_000]),
        "altitude_geodetic": st.floats(width=32),
        "speed_horizontal": st.integers(0, 65535),
        "speed_vertical": st.integers(-32768, 32767),
        "direction": st.integers(0, 65535),
        "timestamp": st.floats(width=32),
        "horizontal_accuracy": st.integers(0, 255),
        "status": st.integers(0, 5),
    }
)
extensions = st.fixed_dictionaries(
    {
        "horizontal_error": st.integers(0, 65535),
        "vertical_error": st.integers(0, 65535),
        "airframe_size": st.integers(0, 65535),
        "airframe_height": st.integers(0, 65535),
        "update_interval": st.integers(0, 65535),
        "timestamp": st.floats(width=32),
    }
)
steps = st.tuples(st.integers(0, 400_000), st.integers(1, 4), claims, st.none() | extensions)


@settings(max_examples=25)
@given(st.lists(steps, min_size=2, max_size=30))
def test_whatever_is_claimed_the_report_is_json_and_the_page_has_numbers(
    said: list[tuple[int, int, dict[str, Any], dict[str, Any] | None]],
) -> None:
    rows: list[bytes] = []
    report = Report(on_encounter=lambda row: rows.append(msgspec.json.encode(row)), keep=20)
    whatif = WhatIf(tuple(Definition))
    walk, time_us = Walk([report, whatif]), START_US
    for wait_us, sysid, claim, extension in said:
        time_us += wait_us
        encoder = Encoder(sysid, 1)
        data = encoder.encode("OPEN_DRONE_ID_LOCATION", **claim)
        if extension is not None:
            data += encoder.encode("RIDLINK_SEPARATION", **extension)
        for frame in parse_datagram(data, CRC_EXTRAS):
            assert isinstance(frame, Frame)
            walk.receive(time_us, frame)
    walk.end()
    rows += [msgspec.json.encode(judgement.as_dict()) for judgement in whatif.judgements]
    for row in rows:
        json.loads(row, parse_constant=pytest.fail)
    summary = Summary(["f"], 0.0, 1.0, walk.aircraft, report.encounters, Definition.CANDIDATE2, report.closest)
    page = report_page(summary, report.worst(), drawn=20)
    assert not {"nan", "inf"} & set(page.replace('"', " ").replace(">", " ").replace("<", " ").split())
