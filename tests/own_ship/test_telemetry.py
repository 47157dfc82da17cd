"""Own state: one autopilot is believed, as long as what it says can be, and its age is that of the caller's clock."""

from __future__ import annotations

import math

import pytest

from ridlink.geodesy import moved, offset_m
from ridlink.mavlink.codec import Message
from ridlink.own_ship import OwnShipTelemetry
from ridlink.own_ship.jump import JumpWatch
from tests.own_ship.autopilot import HERE, Autopilot, flying


def north_east(telemetry: OwnShipTelemetry, now_s: float) -> tuple[float, float]:
    """Where it says it is [m], about HERE."""
    state = telemetry.state(now_s)
    assert state is not None
    return offset_m(HERE, (state.position.latitude_deg, state.position.longitude_deg))


def test_state_of_a_px4() -> None:
    telemetry, autopilot = flying()
    autopilot.receiver(0.0, alt_ellipsoid=587_500)
    autopilot.position(0.0, vx=500, vy=-200, vz=100)
    state = telemetry.state(0.2)
    assert state is not None
    assert north_east(telemetry, 0.2) == pytest.approx((1.0, -0.4), abs=0.02)
    assert state.position.altitude_m == pytest.approx(539.8)
    assert state.altitude_ellipsoid_m == pytest.approx(587.3)
    assert state.velocity_ned_mps == (5.0, -2.0, 1.0)
    assert state.speed_mps == pytest.approx(math.hypot(5, 2))
    assert state.error_bound_m == pytest.approx(2.7)
    assert state.vertical_error_bound_m == pytest.approx(4.5)
    assert state.home_altitude_m == pytest.approx(490.0)
    assert state.age_s == pytest.approx(0.2)
    assert telemetry.armed and telemetry.external_mode and telemetry.wants_stream


def test_a_receiver_whose_heights_contradict_each_other_is_counted_and_gives_no_height_above_the_ellipsoid() -> None:
    telemetry, autopilot = flying()
    autopilot.receiver(0.0, alt_ellipsoid=740_000)
    autopilot.position(0.0)
    state = telemetry.state(0.1)
    assert state is not None and state.altitude_ellipsoid_m is None
    assert telemetry.counters["own_height_implausible"] == 1


@pytest.mark.parametrize(
    ("autopilot", "mode", "external"),
    [
        (12, 6 << 16, True),
        (12, 4 << 16 | 3 << 24, False),
        (12, 4, False),
        (3, 4, True),
        (3, 6 << 16, False),
        (3, 5, False),
    ],
)
def test_external_mode_of_both_autopilots(autopilot: int, mode: int, external: bool) -> None:
    telemetry = OwnShipTelemetry()
    Autopilot(telemetry).heartbeat(0.0, autopilot=autopilot, mode=mode, armed=False)
    assert telemetry.external_mode is external
    assert not telemetry.armed
    assert telemetry.wants_stream is (autopilot == 12)


def test_nothing_is_known_before_an_autopilot_is_heard() -> None:
    telemetry = OwnShipTelemetry()
    Autopilot(telemetry).position(0.0)
    assert telemetry.lock is None
    assert telemetry.state(0.0) is None
    assert math.isinf(telemetry.age_s(0.0)) and math.isinf(telemetry.heard_s(0.0))
    assert not telemetry.wants_stream


def test_an_unknown_error_is_the_worst_of_the_standard() -> None:
    telemetry = OwnShipTelemetry()
    autopilot = Autopilot(telemetry)
    autopilot.heartbeat(0.0)
    autopilot.position(0.0)
    state = telemetry.state(0.0)
    assert state is not None
    assert state.error_bound_m == 40.0
    assert state.altitude_ellipsoid_m is None
    autopilot.receiver(0.0, h_acc=0, v_acc=0)
    assert telemetry.state(0.0).error_bound_m == 40.0  # type: ignore[union-attr]


def test_an_unknown_or_old_vertical_error_is_unknown() -> None:
    telemetry, autopilot = flying()
    autopilot.receiver(0.0, v_acc=0)
    autopilot.position(0.0)
    state = telemetry.state(0.1)
    assert state is not None and state.vertical_error_bound_m is None
    autopilot.receiver(0.1, v_acc=2000)
    autopilot.position(0.2, vz=200)
    fresh, late = telemetry.state(0.2), telemetry.state(1.2)
    assert fresh is not None and fresh.vertical_error_bound_m == pytest.approx(6.0)
    assert late is not None and late.vertical_error_bound_m == pytest.approx(8.0)  # a second of descent without a word
    telemetry, autopilot = flying()
    autopilot.receiver(0.0)
    autopilot.position(5.0)
    state = telemetry.state(5.2)
    assert state is not None and state.vertical_error_bound_m is None


def test_the_larger_of_receiver_and_estimator_counts_and_is_capped() -> None:
    telemetry, autopilot = flying()
    autopilot.say(0.0, "ESTIMATOR_STATUS", flags=831, pos_horiz_accuracy=2.4)
    assert telemetry.state(0.0).error_bound_m == pytest.approx(7.2)  # type: ignore[union-attr]
    autopilot.say(0.0, "ESTIMATOR_STATUS", flags=831, pos_horiz_accuracy=math.nan)
    assert telemetry.state(0.0).error_bound_m == pytest.approx(2.7)  # type: ignore[union-attr]
    autopilot.receiver(0.0, h_acc=100_000)
    assert telemetry.state(0.0).error_bound_m == 185.0  # type: ignore[union-attr]


def test_f14_an_old_position_is_less_certain() -> None:
    telemetry, autopilot = flying()
    autopilot.position(0.0, vx=1000)
    assert telemetry.state(0.3).error_bound_m == pytest.approx(2.7)  # type: ignore[union-attr]
    assert telemetry.state(0.8).error_bound_m == pytest.approx(2.7 + 8.0)  # type: ignore[union-attr]
    assert telemetry.state(10.0) is not None
    assert telemetry.state(10.1) is None


def test_positions_without_a_fix_do_not_count_however_fresh() -> None:
    telemetry, autopilot = flying()
    autopilot.receiver(1.0, fix_type=1, h_acc=300)
    for tick in range(20):
        autopilot.position(1.0 + tick * 0.1)
    assert telemetry.age_s(3.0) == pytest.approx(3.0)
    assert telemetry.counters["own_position_untrusted"] == 20
    assert telemetry.position_silent_s(3.0) == pytest.approx(0.1)


def test_positions_without_an_absolute_solution_do_not_count() -> None:
    telemetry, autopilot = flying()
    autopilot.say(1.0, "ESTIMATOR_STATUS", flags=869 & ~16, pos_horiz_accuracy=2.4)
    autopilot.position(1.0)
    assert telemetry.age_s(1.0) == 1.0
    autopilot.position(7.0)  # an estimator that has fallen silent has not found its solution again
    assert telemetry.age_s(7.0) == 7.0
    autopilot.say(7.5, "ESTIMATOR_STATUS", flags=869 | 16, pos_horiz_accuracy=0.3)
    autopilot.position(7.5)
    assert telemetry.age_s(7.5) == 0.0


@pytest.mark.parametrize("fields", [{"lat": 0, "lon": 0}, {"lat": 910_000_000}, {"lon": -1_810_000_000}])
def test_impossible_positions_do_not_count(fields: dict[str, int]) -> None:
    telemetry, autopilot = flying()
    autopilot.position(1.0, **fields)
    assert telemetry.counters["own_position_unusable"] == 1
    assert telemetry.age_s(1.0) == 1.0


def test_foreign_heartbeats_are_ignored_until_ours_is_silent() -> None:
    telemetry, _ = flying()
    stranger = Autopilot(telemetry, sysid=42, source="b")
    stranger.heartbeat(1.0, armed=False)
    Autopilot(telemetry, source="b").heartbeat(1.0, armed=False)  # our system id from another address
    Autopilot(telemetry, sysid=255, compid=190).say(1.0, "HEARTBEAT", type=6, autopilot=8)
    Autopilot(telemetry, compid=191).heartbeat(1.0, armed=False)
    assert telemetry.armed
    assert telemetry.lock is not None and telemetry.lock.source == "a"
    assert telemetry.counters["foreign_autopilot"] == 2
    stranger.position(1.0, lat=0, lon=1)
    assert telemetry.age_s(1.0) == 1.0
    stranger.heartbeat(3.1)
    assert telemetry.lock.sysid == 42  # type: ignore[union-attr]
    assert telemetry.take_reboot()
    assert telemetry.state(3.1) is None


def test_a_pinned_vehicle_is_never_exchanged() -> None:
    telemetry = OwnShipTelemetry(sysid=7)
    Autopilot(telemetry, sysid=1).heartbeat(0.0)
    assert telemetry.lock is None
    Autopilot(telemetry, sysid=7).heartbeat(0.0)
    Autopilot(telemetry, sysid=1).heartbeat(9.0)
    assert telemetry.lock is not None and telemetry.lock.sysid == 7


def test_a_clock_that_goes_back_is_a_restart_and_a_little_is_a_late_datagram() -> None:
    telemetry, autopilot = flying()
    autopilot.position(60.0)
    autopilot.position(60.1, time_boot_ms=59_500)
    assert telemetry.counters["own_position_late"] == 1
    assert not telemetry.take_reboot()
    autopilot.position(60.2, time_boot_ms=900)
    assert telemetry.counters["autopilot_restart"] == 1
    assert telemetry.take_reboot()
    assert not telemetry.take_reboot()
    autopilot.say(60.3, "LOCAL_POSITION_NED", time_boot_ms=100, vx=3.0)
    assert telemetry.state(60.3).velocity_ned_mps == (0.0, 0.0, 0.0)  # type: ignore[union-attr]


def test_what_was_overtaken_while_the_clock_came_round_is_late_and_no_restart() -> None:
    telemetry, autopilot = flying()
    for at_ms in (-20, 40, -40, 60):
        autopilot.position(0.1, time_boot_ms=at_ms % 2**32)
    assert (telemetry.counters["own_position_late"], telemetry.take_reboot()) == (1, False)
    for last_ms in (2**32 - 70_000, 2**31):
        telemetry, autopilot = flying()
        autopilot.position(0.1, time_boot_ms=last_ms)
        autopilot.position(0.2, time_boot_ms=20)
        assert telemetry.take_reboot(), "not within a minute"


def test_local_velocity_counts_if_it_is_a_number() -> None:
    telemetry, autopilot = flying()
    autopilot.say(0.1, "LOCAL_POSITION_NED", time_boot_ms=100, vx=3.0, vy=1.0, vz=0.0)
    assert telemetry.state(0.1).velocity_ned_mps == (3.0, 1.0, 0.0)  # type: ignore[union-attr]
    autopilot.say(0.2, "LOCAL_POSITION_NED", time_boot_ms=200, vx=math.nan, vy=1.0, vz=0.0)
    assert telemetry.state(0.2).velocity_ned_mps == (3.0, 1.0, 0.0)  # type: ignore[union-attr]


def test_neither_on_the_ground_nor_taking_off() -> None:
    telemetry, autopilot = flying()
    assert telemetry.ready
    for landed_state, ready in ((1, False), (3, False), (2, True), (4, True)):
        autopilot.say(0.0, "EXTENDED_SYS_STATE", landed_state=landed_state)
        assert telemetry.ready is ready and telemetry.landed_state_known(5.0)
    assert not telemetry.landed_state_known(5.1)
    autopilot.say(5.1, "EXTENDED_SYS_STATE", landed_state=0)
    assert not telemetry.landed_state_known(5.1) and telemetry.ready


def test_white_noise_in_positions_is_smoothed_and_a_jump_is_followed() -> None:
    telemetry, autopilot = flying()
    autopilot.receiver(0.0, h_acc=3500)
    for tick in range(1, 101):
        latitude, longitude = moved(*HERE, 5.0 * (-1.0) ** tick, 0.0)
        autopilot.receiver(tick * 0.1, h_acc=3500)
        autopilot.position(tick * 0.1, lat=round(latitude * 1e7), lon=round(longitude * 1e7))
    assert abs(north_east(telemetry, 10.0)[0]) < 1.0
    latitude, longitude = moved(*HERE, 40.0, 0.0)
    autopilot.position(10.1, lat=round(latitude * 1e7), lon=round(longitude * 1e7))
    assert north_east(telemetry, 10.1)[0] == pytest.approx(40.0, abs=0.1)


def test_the_filter_can_be_switched_off() -> None:
    telemetry, autopilot = flying(filtered=False)
    latitude, longitude = moved(*HERE, 1.0, 0.0)
    autopilot.position(0.1, lat=round(latitude * 1e7), lon=round(longitude * 1e7))
    assert north_east(telemetry, 0.1)[0] == pytest.approx(1.0, abs=0.01)


def shifted(north_m: float, east_m: float = 0.0) -> dict[str, int]:
    latitude, longitude = moved(*HERE, north_m, east_m)
    return {"lat": round(latitude * 1e7), "lon": round(longitude * 1e7)}


def test_f16_a_jump_is_doubted_for_a_second_and_counts_as_error_for_ten() -> None:
    telemetry, autopilot = flying()
    for tick in range(1, 11):
        autopilot.position(0.1 * tick, **shifted(1.0 * tick), vx=1000)
    assert not telemetry.jumped(1.0) and telemetry.counters["own_position_jump"] == 0
    autopilot.position(1.1, **shifted(51.0), vx=1000)
    assert telemetry.jumped(1.1) and telemetry.jumped(2.0) and not telemetry.jumped(2.2)
    assert telemetry.counters["own_position_jump"] == 1
    assert north_east(telemetry, 1.1)[0] == pytest.approx(51.0, abs=0.1), "where it is said to be now"
    errors = []
    for tick in range(12, 130):
        autopilot.receiver(0.1 * tick)
        autopilot.position(0.1 * tick, **shifted(51.0 + tick - 11), vx=1000)
        state = telemetry.state(0.1 * tick)
        assert state is not None
        errors.append(state.error_bound_m)
    assert errors[0] == pytest.approx(40.0, abs=1.0)
    assert errors == sorted(errors, reverse=True)
    assert errors[-1] == pytest.approx(2.7)


def test_f16_white_noise_and_hard_manoeuvres_are_no_jumps() -> None:
    telemetry, autopilot = flying()
    autopilot.receiver(0.0, h_acc=3500)
    north, speed = 0.0, 15.0
    for tick in range(1, 400):
        speed = -speed if tick % 40 == 0 else speed
        north += 0.1 * speed
        if tick % 20 == 0:
            autopilot.receiver(0.1 * tick, h_acc=3500)
        noise = 10.0 * math.sin(1e6 * math.sin(tick))
        autopilot.position(0.1 * tick, **shifted(north + noise), vx=round(100 * speed))
    assert telemetry.counters["own_position_jump"] == 0


def test_f16_what_a_jump_is_and_how_long_it_counts() -> None:
    watch = JumpWatch()
    assert not watch.doubtful(0.0) and watch.error_m(0.0) == 0.0
    assert not watch.update(16.0, bound_m=3.0, travelled_m=10.0, now_s=1.0), "twice the bound, and the way"
    assert watch.update(16.1, bound_m=3.0, travelled_m=10.0, now_s=1.0)
    assert not watch.update(2.0, bound_m=0.0, travelled_m=0.0, now_s=1.5)
    assert watch.doubtful(1.9) and not watch.doubtful(2.0)
    assert [watch.error_m(t) for t in (1.0, 6.0, 11.0, 30.0)] == pytest.approx([16.1, 8.05, 0.0, 0.0])
    assert watch.update(7.0, bound_m=3.0, travelled_m=0.0, now_s=2.0)
    assert watch.error_m(2.0) == pytest.approx(16.1 * 0.9), "a smaller jump takes nothing back"
    assert watch.error_m(1.0) == watch.error_m(2.0), "nor is there more of it for a position that was measured before"
    assert JumpWatch().update(2.1, bound_m=0.0, travelled_m=0.0, now_s=1.0), "two metres, for whoever claims none"


def test_f16_a_centimetre_is_no_jump_however_exact_the_receiver_says_it_is() -> None:
    telemetry, autopilot = flying()
    for tick in range(1, 20):
        autopilot.receiver(0.1 * tick, h_acc=1)
        autopilot.position(0.1 * tick, **shifted(0.3 * (tick % 2)))
    assert telemetry.counters["own_position_jump"] == 0


def test_f16_an_outage_is_no_jump() -> None:
    telemetry, autopilot = flying()
    autopilot.position(0.1, vx=1000)
    autopilot.position(4.1, **shifted(45.0), vx=1000)
    assert telemetry.counters["own_position_jump"] == 0


def test_f17_what_waited_in_a_buffer_is_as_old_as_the_autopilots_clock_says() -> None:
    telemetry, autopilot = flying()
    for tick in range(1, 21):
        autopilot.position(0.1 * tick)
    for tick in range(21, 70):  # all at once, after five seconds
        autopilot.position(7.0, time_boot_ms=100 * tick)
        assert telemetry.age_s(7.0) == pytest.approx(7.0 - 0.1 * tick, abs=1.1), "the pause itself forgives a second"
    assert telemetry.counters["own_position_delayed"] > 20
    autopilot.position(7.05, time_boot_ms=7050)
    assert telemetry.age_s(7.05) == 0.0


def test_f17_a_clock_that_runs_slow_is_believed() -> None:
    telemetry, autopilot = flying()
    for tick in range(1, 600):
        autopilot.position(0.1 * tick, time_boot_ms=85 * tick)
    assert telemetry.age_s(59.9) < 0.1


def test_ardupilots_estimator_is_heard_too() -> None:
    telemetry, autopilot = flying()
    message = Message("EKF_STATUS_REPORT", 193, {"flags": 37})
    telemetry.receive(1, 1, message, 1.0, "a")
    autopilot.position(1.1)
    assert telemetry.counters["own_position_untrusted"] == 1
    telemetry.receive(1, 1, Message("EKF_STATUS_REPORT", 193, {"flags": 831}), 1.2, "a")
    autopilot.position(1.3)
    assert telemetry.age_s(1.3) == 0.0


# --- another writer ---------------------------------------------------------------------------------------------------

VELOCITY_ONLY, POSITION_ONLY = 0x0DC7, 0x0DF8


def target(telemetry: OwnShipTelemetry, now_s: float, vx: float, vy: float = 0.0, mask: int = VELOCITY_ONLY) -> None:
    Autopilot(telemetry).say(now_s, "POSITION_TARGET_LOCAL_NED", type_mask=mask, coordinate_frame=1, vx=vx, vy=vy)


def contest(begins_s: float, lasts_s: float, *, ours: float = 10.0, foreign: float = -4.0) -> OwnShipTelemetry:
    """We stream from 0 on at 10 Hz; from then on every second target is somebody else's."""
    telemetry, _ = flying()
    writer = telemetry.other_writer
    for tick in range(round(10 * (begins_s + lasts_s))):
        now_s = 0.1 * tick
        writer.sent((ours, 0.0, 0.0), now_s)
        target(telemetry, now_s + 0.03, ours)
        target(telemetry, now_s + 0.08, foreign if now_s >= begins_s else ours)
    return telemetry


def test_our_own_targets_are_nobody_elses_however_they_are_clipped_and_shaped() -> None:
    telemetry, _ = flying()
    for tick in range(100):
        now_s = 0.1 * tick
        telemetry.other_writer.sent((0.5 * min(tick, 30), 0.1, 0.0), now_s)
        target(telemetry, now_s + 0.05, min(0.5 * max(min(tick, 30) - 4, 0), 12.0))
        assert not telemetry.other_writer.contested(now_s + 0.05)


def test_an_ardupilot_that_does_not_hear_us_flies_after_what_it_heard_last_for_three_seconds() -> None:
    telemetry, _ = flying()
    writer = telemetry.other_writer
    for tick in range(50):
        now_s, ours = 0.1 * tick, 0.5 * min(tick, 20)
        writer.sent((ours, 0.0, 0.0), now_s)
        target(telemetry, now_s + 0.05, min(ours, 2.5))  # the sixth was the last one that it heard
        assert writer.contested(now_s + 0.05) is (now_s + 0.05 > 3.8), "then it is somebody else's, or nobody's"


def deaf(lasts_s: float, *, autopilot: int = 3, told_s: float = 1.0, again_s: float = math.inf) -> OwnShipTelemetry:
    """It flies after us for some seconds, then hears nothing and stands, but for an instant every so often."""
    telemetry = OwnShipTelemetry()
    Autopilot(telemetry).heartbeat(0.0, autopilot=autopilot, mode=4 if autopilot == 3 else 6 << 16)
    for tick in range(round(10 * lasts_s)):
        now_s = 0.1 * tick
        telemetry.other_writer.sent((10.0, 0.0, 0.0), now_s)
        hears = now_s < told_s or now_s % again_s > again_s - 0.15
        target(telemetry, now_s + 0.05, 10.0 if hears else 0.0)
    return telemetry


@pytest.mark.parametrize("told_s", [0.0, 5.0])
def test_an_ardupilot_that_hears_nothing_and_stands_has_no_other_writer(told_s: float) -> None:
    begins_s = told_s + 0.3
    writer = deaf(told_s + 20.0, told_s=told_s).other_writer
    assert (
        writer.unheard(told_s + 20.0) and not writer.contested(told_s + 20.0) and not writer.must_yield(told_s + 20.0)
    )
    assert writer.must_give_up(told_s + 20.0) and not writer.must_give_up(begins_s + 10.0)
    assert not writer.unheard(told_s + 24.0), "of what is long past nobody is accused"


def test_one_that_stands_in_between_is_told_to_by_somebody() -> None:
    """Unheard, it flies on for three seconds before it stands again. A PX4 leaves its mode."""
    assert deaf(6.0, told_s=5.0).other_writer.unheard(6.0)
    assert deaf(6.0, told_s=5.0, autopilot=12).other_writer.contested(6.0)
    for told_s, again_s, somebody in ((5.0, 1.0, True), (1.5, math.inf, True), (2.5, math.inf, False)):
        assert deaf(told_s + 3.0, told_s=told_s, again_s=again_s).other_writer.contested(told_s + 3.0) is somebody


def test_a_place_is_stood_at_until_another_one_is_named() -> None:
    for moves in (False, True):
        telemetry = OwnShipTelemetry()
        Autopilot(telemetry).heartbeat(0.0, autopilot=3, mode=4)
        for tick in range(30):
            telemetry.other_writer.sent((8.0, 0.0, 0.0), 0.1 * tick)
            place = {"x": 5.0, "y": 3.0, "z": -20.0 - moves * 0.1 * tick}
            Autopilot(telemetry).say(
                0.1 * tick, "POSITION_TARGET_LOCAL_NED", type_mask=POSITION_ONLY, coordinate_frame=1, **place
            )
        assert telemetry.other_writer.contested(2.9) is moves and telemetry.other_writer.unheard(2.9) is not moves


def test_whoever_comes_second_gives_way_and_the_first_waits_for_that() -> None:
    second = contest(begins_s=0.0, lasts_s=1.5).other_writer
    assert second.contested(1.4) and second.must_yield(1.4)
    first = contest(begins_s=10.0, lasts_s=2.0).other_writer
    assert first.contested(11.9) and not first.must_yield(11.9)
    stubborn = contest(begins_s=10.0, lasts_s=12.0).other_writer
    assert stubborn.must_yield(21.9)
    assert not stubborn.contested(26.0) and not stubborn.must_yield(26.0), "without targets nobody is accused"


def test_a_writer_that_is_seldom_seen_between_our_own_targets_is_seen_all_the_same() -> None:
    telemetry, _ = flying()
    for tick in range(60):
        telemetry.other_writer.sent((10.0, 0.0, 0.0), 0.1 * tick)
        target(telemetry, 0.1 * tick, -5.0 if tick % 7 == 6 else 10.0)
    assert telemetry.other_writer.must_yield(5.6)


def test_before_we_stream_a_target_that_moves_has_a_writer_and_one_that_stands_has_lost_it() -> None:
    for moves in (True, False):
        telemetry, _ = flying()
        for tick in range(15):
            target(telemetry, 0.1 * tick, 8.0 + (0.02 * tick if moves else 0.0))
        assert telemetry.other_writer.must_yield(1.4) is moves
        Autopilot(telemetry).heartbeat(1.5, mode=3 << 16)
        assert not telemetry.other_writer.must_yield(1.5)


def test_positions_as_targets_are_foreign_once_we_stream() -> None:
    for streaming in (True, False):
        telemetry, _ = flying()
        for tick in range(30):
            if streaming:
                telemetry.other_writer.sent((1.0, 0.0, 0.0), 0.1 * tick)
            target(telemetry, 0.1 * tick, 0.0, mask=POSITION_ONLY)
            target(telemetry, 0.1 * tick, math.nan)
        assert telemetry.other_writer.contested(2.9) is streaming
    telemetry.other_writer.sent(None, 3.0)
    assert not telemetry.other_writer.must_yield(9.0)


@pytest.mark.parametrize("fields", [{}, {"latitude": 900_000_001}, {"latitude": 1, "longitude": -1_800_000_001}])
def test_a_home_that_cannot_be_is_none(fields: dict[str, int]) -> None:
    telemetry, autopilot = flying()
    autopilot.say(0.1, "HOME_POSITION", **fields)
    assert telemetry.home is None
    autopilot.say(0.2, "HOME_POSITION", latitude=470_000_000, longitude=80_000_000, altitude=490_500)
    autopilot.say(0.3, "HOME_POSITION", **fields)
    assert telemetry.home is not None
    assert (telemetry.home.latitude_deg, telemetry.home.longitude_deg, telemetry.home.altitude_m) == (47.0, 8.0, 490.5)


def test_grave_words_of_the_vehicle_are_told_once_and_a_flood_of_them_not_at_once() -> None:
    telemetry, autopilot = flying()
    stranger = Autopilot(telemetry, sysid=2)
    for text, severity in (("Crash: Disarming: \x1b[2J", 0), ("GPS Glitch", 2), ("EKF3 IMU0 in-flight yaw", 6)):
        for _ in range(3):
            autopilot.say(1.0, "STATUSTEXT", severity=severity, text=text)
    stranger.say(1.0, "STATUSTEXT", severity=0, text="I am you")
    autopilot.say(1.0, "STATUSTEXT", severity=0, text="w" * 50, id=7)
    autopilot.say(1.0, "STATUSTEXT", severity=0, text="the rest of it", id=7, chunk_seq=1)
    told = [telemetry.words.take(1.0 + 0.1 * step) for step in range(100)]
    assert [text for text in told if text] == ["Crash: Disarming: \\x1b[2J", "GPS Glitch", "w" * 50 + " ..."]
    assert told.index("GPS Glitch") == 10, "one a second"
    for number in range(1000):
        autopilot.say(20.0, "STATUSTEXT", severity=0, text=f"flood {number}")
    told = [telemetry.words.take(20.0 + second) for second in range(100)]
    assert len([text for text in told if text]) + telemetry.counters["vehicle_text_left_out"] == 1000
    autopilot.say(90.0, "STATUSTEXT", severity=2, text="GPS Glitch")
    assert telemetry.words.take(200.0) == "GPS Glitch", "it is so again, or still"


def test_grave_words_do_not_fill_the_memory() -> None:
    telemetry, autopilot = flying()
    for second in range(59):
        autopilot.say(1.0 + second, "STATUSTEXT", severity=0, text=f"cause {second}")
        assert telemetry.words.take(1.0 + second) == f"cause {second}"
    autopilot.say(60.0, "STATUSTEXT", severity=0, text="cause 58")
    assert telemetry.words.take(61.0) == "", "known for a minute"
    autopilot.say(60.0, "STATUSTEXT", severity=0, text="cause 0")
    assert telemetry.words.take(61.0) == "cause 0", "of too many the oldest is forgotten, and told again"


def test_what_nobody_asks_for_changes_nothing() -> None:
    telemetry, autopilot = flying()
    before = telemetry.state(0.1), telemetry.counters.copy()
    autopilot.say(0.1, "COMMAND_ACK", command=176, result=4)
    assert (telemetry.state(0.1), telemetry.counters) == before
