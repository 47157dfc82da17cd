"""Whatever is asked for, what leaves keeps every limit: the last line of defence, tested as if nothing stood above."""

from __future__ import annotations

import math
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ridlink.engine import Engine, EngineConfig
from ridlink.mavlink.codec import CRC_EXTRAS, Encoder, Message, decode_message
from ridlink.mavlink.frames import Frame, parse_datagram
from ridlink.setpoint import STOP, SetpointStream, VelocityLimits, clamp_velocity, encode_setpoint

LIMITS = VelocityLimits()
anything = st.tuples(*[st.floats(allow_nan=True, allow_infinity=True)] * 3)
sane = st.tuples(st.floats(-40, 40), st.floats(-40, 40), st.floats(-9, 9))


def decoded(frame: bytes) -> Message:
    (found,) = parse_datagram(frame, CRC_EXTRAS)
    assert isinstance(found, Frame)
    return decode_message(found)


def size(velocity: tuple[float, ...]) -> float:
    return math.sqrt(sum(value * value for value in velocity))


def test_the_wire_form_is_velocity_only_in_local_ned() -> None:
    message = decoded(encode_setpoint(Encoder(7, 196), (1.0, -2.0, 0.5), 1234, 7, 1))
    assert message.name == "SET_POSITION_TARGET_LOCAL_NED"
    assert message.type_mask == 0x0DC7
    assert message.coordinate_frame == 1
    assert (message.vx, message.vy, message.vz) == (1.0, -2.0, 0.5)
    assert (message.target_system, message.target_component, message.time_boot_ms) == (7, 1, 1234)
    assert (message.x, message.afx, message.yaw, message.yaw_rate) == (0, 0, 0, 0)


@given(st.lists(st.tuples(anything, st.integers(0, 3000)), min_size=1, max_size=30))
def test_i1_the_stream_keeps_the_limits_whatever_is_asked(
    steps: list[tuple[tuple[float, float, float], int]],
) -> None:
    stream, encoder = SetpointStream(LIMITS), Encoder(1, 196)
    last, last_ms, time_ms = STOP, 0, 0
    for wanted, later_ms in steps:
        time_ms += later_ms
        message = decoded(stream.next(encoder, wanted, time_ms, 1, 1))
        sent = (message.vx, message.vy, message.vz)
        assert all(math.isfinite(value) for value in sent)
        assert math.hypot(sent[0], sent[1]) <= LIMITS.horizontal_mps
        assert abs(sent[2]) <= LIMITS.vertical_mps
        if sent != STOP:
            change = size((sent[0] - last[0], sent[1] - last[1], sent[2] - last[2]))
            assert change <= LIMITS.acceleration_mps2 * (message.time_boot_ms - last_ms) / 1e3 + 1e-4
        assert message.time_boot_ms >= last_ms
        last, last_ms = sent, message.time_boot_ms


@given(anything, sane, st.integers(0, 2), st.sampled_from([math.nan, math.inf, -math.inf]))
def test_what_is_not_finite_becomes_zero(
    wanted: tuple[float, float, float], last: tuple[float, float, float], axis: int, bad: float
) -> None:
    spoilt = (*wanted[:axis], bad, *wanted[axis + 1 :])
    assert clamp_velocity(spoilt, last, 0.1, LIMITS) == STOP  # type: ignore[arg-type]


def test_not_finite_is_counted() -> None:
    stream = SetpointStream(LIMITS)
    stream.next(Encoder(1, 196), (math.nan, 0.0, 0.0), 100, 1, 1)
    assert stream.counters["setpoint_not_finite"] == 1
    assert stream.velocity == STOP


def test_zero_does_not_slew() -> None:
    assert clamp_velocity(STOP, (15.0, 0.0, 2.0), 0.0, LIMITS) == STOP


def test_the_course_is_kept_when_speed_is_cut() -> None:
    north, east, _ = clamp_velocity((30.0, 40.0, 0.0), (9.0, 12.0, 0.0), 0.1, LIMITS)
    assert (north, east) == pytest.approx((9.0, 12.0), rel=1e-5)


@given(sane)
def test_a_velocity_within_limits_passes_unchanged_when_there_is_time(wanted: tuple[float, float, float]) -> None:
    loose = VelocityLimits(horizontal_mps=60.0, vertical_mps=10.0, acceleration_mps2=1000.0)
    assert clamp_velocity(wanted, STOP, 0.5, loose) == wanted


def test_limits_hold_to_the_last_bit_of_the_wire() -> None:
    """Not by a tolerance: an observer who reads float32 sees nothing above them."""
    at_limits = (LIMITS.horizontal_mps * 0.6, LIMITS.horizontal_mps * 0.8, LIMITS.vertical_mps)
    fast = clamp_velocity((30.0, 40.0, 9.0), at_limits, 0.5, LIMITS)
    message = decoded(encode_setpoint(Encoder(1, 196), fast, 0, 1, 1))
    assert 14.9999 < math.hypot(message.vx, message.vy) < LIMITS.horizontal_mps
    assert 1.9999 < message.vz < LIMITS.vertical_mps
    slewed = clamp_velocity((10.0, 0.0, 0.0), STOP, 0.1, LIMITS)
    assert 0.49999 < decoded(encode_setpoint(Encoder(1, 196), slewed, 0, 1, 1)).vx < 0.5


def test_the_slew_goes_straight_towards_what_is_wanted() -> None:
    sent = clamp_velocity((6.0, 1.0, 1.0), (3.0, 5.0, 1.0), 0.5, LIMITS)  # 5 m/s away, of which half
    assert sent == pytest.approx((4.5, 3.0, 1.0), abs=1e-4)
    assert clamp_velocity((4.0, 0.0, -2.0), (4.0, 0.0, 2.0), 0.2, LIMITS) == pytest.approx((4.0, 0.0, 1.0), abs=1e-4)


def test_a_long_gap_does_not_buy_a_leap() -> None:
    north, _, _ = clamp_velocity((15.0, 0.0, 0.0), STOP, 60.0, LIMITS)
    assert north == pytest.approx(2.5, rel=1e-5)


def test_time_never_goes_back() -> None:
    stream, encoder = SetpointStream(LIMITS), Encoder(1, 196)
    stream.next(encoder, STOP, 500, 1, 1)
    assert decoded(stream.next(encoder, STOP, 400, 1, 1)).time_boot_ms == 500


def test_the_stream_goes_on_when_the_milliseconds_of_the_wire_begin_anew() -> None:
    engine = Engine(EngineConfig())
    engine.step(0.0)
    stream, encoder = SetpointStream(LIMITS), Encoder(1, 196)
    times_ms = [engine.time_boot_ms(0.1 * k + 2**32 / 1e3 - 0.2) for k in range(5)]
    frames = [decoded(stream.next(encoder, (5.0, 0.0, 0.0), time_ms, 1, 1)) for time_ms in times_ms]
    assert [frame.time_boot_ms for frame in frames[2:]] == [0, 100, 200]
    steps = [after.vx - before.vx for before, after in pairwise(frames)]
    assert steps == pytest.approx([0.1 * LIMITS.acceleration_mps2] * 4, rel=0.02)


def test_restart_begins_from_zero() -> None:
    stream, encoder = SetpointStream(LIMITS), Encoder(1, 196)
    stream.next(encoder, (0.4, 0.0, 0.0), 100, 1, 1)
    assert stream.velocity != STOP
    stream.restart()
    assert stream.velocity == STOP
    assert stream.sent == 1


@pytest.mark.parametrize("field", ["horizontal_mps", "vertical_mps", "acceleration_mps2"])
@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
def test_limits_are_checked(field: str, value: float) -> None:
    with pytest.raises(ValueError, match=field):
        VelocityLimits(**{field: value})


def test_a_speed_limit_that_nothing_flies_is_refused() -> None:
    for field in ("horizontal_mps", "vertical_mps"):
        with pytest.raises(ValueError, match=f"{field} must lie between 0.01 and 100 m/s, got 101"):
            VelocityLimits(**{field: 101.0})


def test_an_acceleration_that_limits_nothing_is_refused() -> None:
    assert VelocityLimits(acceleration_mps2=10_000.0).acceleration_mps2 == 10_000.0
    with pytest.raises(ValueError, match=r"acceleration_mps2 must lie between 0.1 and 10000 m/s\^2, got 10001"):
        VelocityLimits(acceleration_mps2=10_001.0)


def test_the_defaults_are_those_of_the_contract() -> None:
    assert VelocityLimits() == VelocityLimits(15.0, 2.0, 5.0)
    assert VelocityLimits(100.0, 100.0).horizontal_mps == 100.0
    assert VelocityLimits(0.5, 0.5, 0.5).acceleration_mps2 == 0.5, "slow is allowed"


def test_what_is_cut_is_counted_and_what_is_not_is_not() -> None:
    for axis in range(3):
        stream = SetpointStream(VelocityLimits(acceleration_mps2=1000.0))
        wanted = [0.0, 0.0, 0.0]
        wanted[axis] = 1.0
        stream.next(Encoder(1, 196), (wanted[0], wanted[1], wanted[2]), 1000, 1, 1)
        assert stream.counters["setpoint_limited"] == 0
        wanted[axis] = 50.0
        stream.next(Encoder(1, 196), (wanted[0], wanted[1], wanted[2]), 2000, 1, 1)
        assert stream.counters["setpoint_limited"] == 1
    assert stream.sent == 2


@pytest.mark.parametrize(("wanted_mps", "counted"), [(0.505, 0), (0.52, 1), (1.0, 1)])
def test_a_centimetre_per_second_is_not_worth_a_count(wanted_mps: float, counted: int) -> None:
    stream = SetpointStream(VelocityLimits())
    stream.next(Encoder(1, 196), (wanted_mps, 0.0, 0.0), 100, 1, 1)  # half a metre per second is what the slew allows
    assert stream.counters["setpoint_limited"] == counted


def test_the_first_setpoint_may_leave_zero_by_the_slew_only() -> None:
    stream = SetpointStream(VelocityLimits())
    message = decoded(stream.next(Encoder(1, 196), (10.0, 0.0, 0.0), 100, 1, 1))
    assert message.vx == pytest.approx(0.5, rel=1e-4)
