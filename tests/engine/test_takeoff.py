"""When a climb-out may be interrupted, and what counts as a predicted collision."""

from __future__ import annotations

from dataclasses import replace

import pytest
from msgspec import structs

from ridlink.engine import EngineConfig
from ridlink.engine.decision import Conflict, DecisionRecord
from ridlink.engine.takeoff import interruptible, mac_predicted
from ridlink.failsafe import State
from ridlink.geodesy import Geodetic
from ridlink.own_ship import OwnShipTelemetry
from ridlink.remote_id.report import RemoteIdReport
from ridlink.traffic.own_state import OwnState
from ridlink.traffic.track import new_track
from tests.own_ship.autopilot import Autopilot

AWARE = EngineConfig(takeoff_aware=True, takeoff_height_m=20.0, airframe_m=0.6)
OWN = OwnState(
    position=Geodetic(47.0, 8.0, 510.0),
    altitude_ellipsoid_m=None,
    velocity_ned_mps=(0.0, 0.0, -2.0),
    error_bound_m=3.0,
    vertical_error_bound_m=None,
    home_altitude_m=500.0,
    age_s=0.0,
)
NEIGHBOUR = RemoteIdReport(
    source=(9, 1), latitude_deg=47.0, longitude_deg=8.0, horizontal_error_m=4.0, airframe_size_m=1.0, received_at_s=0.0
)
MAC_M = (0.6 + 1.0) / 2.0 + 5.0 / 3.0
"""Both airframes, and one standard deviation of errors of 3 and 4 m at three."""


def told(landed_state: int) -> OwnShipTelemetry:
    """What EXTENDED_SYS_STATE says: 0 nothing, 1 on the ground, 2 in the air, 3 taking off."""
    telemetry = OwnShipTelemetry()
    autopilot = Autopilot(telemetry)
    autopilot.heartbeat(0.0)
    autopilot.say(0.0, "EXTENDED_SYS_STATE", landed_state=landed_state)
    return telemetry


def meeting(miss_m: float, report: RemoteIdReport = NEIGHBOUR) -> DecisionRecord:
    track = new_track(("rid", 9, 1, None, 0), report, 0.0, filtered=False)
    conflict = Conflict(track, entry_s=1.0, closest_s=2.0, miss_m=miss_m, height_m=0.0)
    return DecisionRecord(0.0, State.STANDBY, OWN, 1, conflicts=(conflict,))


@pytest.mark.parametrize(("landed_state", "ready"), [(0, True), (1, False), (2, True), (3, False), (4, True)])
def test_without_the_option_the_autopilots_word_counts(landed_state: int, ready: bool) -> None:
    unaware = replace(AWARE, takeoff_aware=False)
    assert interruptible(unaware, told(landed_state), OWN, meeting(0.0)) is ready


@pytest.mark.parametrize(
    ("height_m", "climb_mps", "interrupted"),
    [
        (10.0, 2.0, False),
        (19.9, 2.0, False),
        (20.0, 2.0, True),
        (10.0, 0.5, True),
        (10.0, 0.51, False),
        (10.0, 0, True),
    ],
)
def test_a_climb_below_the_height_is_a_climb_out(height_m: float, climb_mps: float, interrupted: bool) -> None:
    own = replace(OWN, position=Geodetic(47.0, 8.0, 500.0 + height_m), velocity_ned_mps=(0.0, 0.0, -climb_mps))
    assert interruptible(AWARE, told(2), own, None) is interrupted
    assert interruptible(AWARE, told(2), own, meeting(MAC_M + 0.1)) is interrupted
    assert interruptible(AWARE, told(2), own, meeting(MAC_M - 0.1))
    assert not interruptible(AWARE, told(1), own, meeting(0.0)), "nothing on the ground is avoiding anybody"


def test_an_automatic_take_off_is_a_climb_out_at_any_height() -> None:
    high = replace(OWN, position=Geodetic(47.0, 8.0, 900.0), velocity_ned_mps=(5.0, 0.0, 0.0))
    assert not interruptible(AWARE, told(3), high, meeting(MAC_M + 0.1))
    assert interruptible(AWARE, told(3), high, meeting(MAC_M - 0.1))


def test_without_an_own_state_nothing_is_predicted() -> None:
    assert not interruptible(AWARE, told(3), None, meeting(0.0))
    assert interruptible(AWARE, told(2), None, None)


@pytest.mark.parametrize(
    ("fields", "mac_m"),
    [
        ({}, MAC_M),
        ({"airframe_size_m": None}, (0.6 + 7.5) / 2.0 + 5.0 / 3.0),
        ({"horizontal_error_m": None, "accuracy_bound_m": 4.0}, MAC_M),
        ({"horizontal_error_m": None}, (0.6 + 1.0) / 2.0 + (3.0**2 + 40.0**2) ** 0.5 / 3.0),
        ({"horizontal_error_m": 655.35}, (0.6 + 1.0) / 2.0 + (3.0**2 + 185.0**2) ** 0.5 / 3.0),
        ({"airframe_size_m": 655.35}, (0.6 + 30.0) / 2.0 + 5.0 / 3.0),
    ],
)
def test_a_mac_is_both_airframes_and_one_standard_deviation_of_both_errors(
    fields: dict[str, object], mac_m: float
) -> None:
    report = structs.replace(NEIGHBOUR, **fields)  # type: ignore[arg-type]
    assert mac_predicted(AWARE, OWN, meeting(mac_m - 1e-6, report))
    assert not mac_predicted(AWARE, OWN, meeting(mac_m + 1e-6, report))
    nobody = DecisionRecord(0.0, State.STANDBY, OWN, 0)
    assert not mac_predicted(AWARE, OWN, nobody)
