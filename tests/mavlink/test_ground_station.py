"""A ground station is one to pymavlink, too."""

from __future__ import annotations

from pymavlink.dialects.v20 import common

from ridlink.mavlink.ground_station import ground_station, heartbeat


def test_its_heartbeat_is_that_of_a_ground_station_and_counts_on() -> None:
    encoder = ground_station()
    said = common.MAVLink(None).parse_buffer(heartbeat(encoder) + heartbeat(encoder))
    assert [message.get_seq() for message in said] == [0, 1]
    assert {(message.get_srcSystem(), message.get_srcComponent()) for message in said} == {(255, 190)}
    assert {(message.type, message.autopilot) for message in said} == {
        (common.MAV_TYPE_GCS, common.MAV_AUTOPILOT_INVALID)
    }
