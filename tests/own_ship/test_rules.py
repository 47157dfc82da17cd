"""What receiver and estimator are believed, and who else steers: these two alone, at times far from zero."""

from __future__ import annotations

import math

import pytest

from ridlink.mavlink.codec import Message
from ridlink.own_ship.other_writer import OtherWriter
from ridlink.own_ship.requests import WANTED_MESSAGES_US
from ridlink.own_ship.trust import NavigationTrust

T = 1000.0
ABSOLUTE = 16

# --- trust ------------------------------------------------------------------------------------------------------------


def gps(**fields: int) -> Message:
    plain = {
        "fix_type": 3, "h_acc": 1000, "v_acc": 2000, "vel_acc": 300, "alt": 500_000, "alt_ellipsoid": 547_000,
    }  # fmt: skip
    return Message("GPS_RAW_INT", 24, plain | fields)


def receiving(**fields: int) -> NavigationTrust:
    trust = NavigationTrust()
    trust.receiver(gps(**fields), T)
    return trust


def test_before_anybody_speaks_there_is_no_reason_for_doubt_and_no_figure() -> None:
    trust = NavigationTrust()
    assert trust.trusted and not trust.measured(T)
    assert not trust.estimator_silent(T)
    assert trust.error_m(T) == 40.0
    assert trust.vertical_error_m(T) is None and trust.velocity_error_mps(T) is None and trust.undulation_m is None
    assert trust.receiver_silent_s(T) == math.inf


def test_figures_of_a_receiver_are_three_standard_deviations_for_five_seconds() -> None:
    trust = receiving()
    for now_s in (T, T + 5.0):
        assert (trust.error_m(now_s), trust.vertical_error_m(now_s)) == (3.0, 6.0)
        assert trust.velocity_error_mps(now_s) == pytest.approx(0.9)
        assert trust.measured(now_s)
    assert trust.undulation_m == 47.0 and trust.receiver_silent_s(T + 2.0) == 2.0
    old_s = T + 5.1
    assert trust.error_m(old_s) == 40.0 and not trust.measured(old_s)
    assert trust.vertical_error_m(old_s) is None and trust.velocity_error_mps(old_s) is None


@pytest.mark.parametrize("unknown", [0, 0xFFFFFFFF])
def test_a_figure_that_says_unknown_is_none(unknown: int) -> None:
    trust = receiving(h_acc=unknown, v_acc=unknown, vel_acc=unknown, alt_ellipsoid=0)
    assert trust.error_m(T) == 40.0 and not trust.measured(T)
    assert trust.vertical_error_m(T) is None and trust.velocity_error_mps(T) is None and trust.undulation_m is None
    assert receiving(h_acc=1, v_acc=1, vel_acc=1).velocity_error_mps(T) == pytest.approx(0.003)


@pytest.mark.parametrize(
    ("undulation_mm", "known"), [(-120_000, True), (120_000, True), (-120_001, False), (120_001, False)]
)
def test_two_heights_that_no_geoid_can_lie_between_are_none(undulation_mm: int, known: bool) -> None:
    undulation_m = receiving(alt_ellipsoid=500_000 + undulation_mm).undulation_m
    assert undulation_m == (undulation_mm / 1e3 if known else None)


@pytest.mark.parametrize(("fix_type", "trusted"), [(0, False), (2, False), (3, True), (6, True)])
def test_f14_without_a_fix_in_three_dimensions_nothing_is_trusted_until_one_is(fix_type: int, trusted: bool) -> None:
    trust = receiving(fix_type=fix_type)
    assert trust.trusted is trust.measured(T + 5.0) is trusted
    assert not trust.measured(T + 5.1)
    trust.receiver(gps(), T + 9.0)
    assert trust.trusted


def test_f14_an_estimator_without_an_absolute_solution_is_not_trusted_until_it_has_one() -> None:
    trust = receiving()
    trust.estimator(0xFFFF & ~ABSOLUTE, 1.0, T)
    assert not trust.trusted and not trust.measured(T + 5.0)
    assert not trust.estimator_silent(T + 5.0) and trust.estimator_silent(T + 5.1)
    trust.estimator(ABSOLUTE, 1.0, T + 1.0)
    assert trust.trusted


def test_near_the_sea_no_height_above_the_ellipsoid_is_none_as_well() -> None:
    assert receiving(alt=50_000, alt_ellipsoid=0).undulation_m is None


@pytest.mark.parametrize(
    ("accuracy_m", "error_m"), [(0.5, 1.5), (0.0, 0.3), (-1.0, 0.3), (math.nan, 0.3), (math.inf, 0.3)]
)
def test_an_estimator_adds_to_an_exact_receiver_only_what_it_says(accuracy_m: float, error_m: float) -> None:
    trust = receiving(h_acc=100)
    trust.estimator(ABSOLUTE, accuracy_m, T)
    assert trust.error_m(T) == pytest.approx(error_m)


def test_the_larger_error_counts_while_it_is_fresh_and_none_beyond_the_cap() -> None:
    trust = receiving()
    trust.estimator(ABSOLUTE, 0.5, T)
    assert trust.error_m(T) == 3.0
    trust.receiver(gps(h_acc=500), T)
    for accuracy_m, error_m in ((2.0, 6.0), (math.nan, 1.5), (math.inf, 1.5), (-5.0, 1.5), (0.0, 1.5), (100.0, 185.0)):
        trust.estimator(ABSOLUTE, accuracy_m, T)
        assert trust.error_m(T + 4.9) == error_m
    trust.receiver(gps(), T + 5.0)
    assert trust.error_m(T + 5.1) == 3.0, "the estimator has fallen silent"


# --- another writer ---------------------------------------------------------------------------------------------------

VELOCITY, POSITION = 0x0DC7, 0x0DF8


def target(vx: float, vy: float = 0.0, mask: int = VELOCITY, vz: float = 0.0) -> Message:
    return Message("POSITION_TARGET_LOCAL_NED", 85, {"type_mask": mask, "vx": vx, "vy": vy, "vz": vz})


def streaming(since_s: float, *, vx: float = 0.0, vy: float = 0.0, until_s: float = T + 30.0) -> OtherWriter:
    writer = OtherWriter()
    for tick in range(round(10.0 * (until_s - since_s)) + 1):
        writer.sent((vx, vy, 0.0), since_s + 0.1 * tick)
    return writer


def is_foreign(writer: OtherWriter, message: Message, now_s: float = T) -> bool:
    for k in range(4):
        writer.receive(message, now_s + 0.01 * k)
    return writer.contested(now_s + 0.03)


@pytest.mark.parametrize(
    ("ours_mps", "seen_mps", "foreign"),
    [
        (0.0, 0.45, False), (0.0, 0.55, True), (0.0, -0.45, False), (0.0, -0.55, True),
        (10.0, 12.9, False), (10.0, 13.1, True), (10.0, 7.1, False), (10.0, 6.9, True),
    ],
)  # fmt: skip
def test_targets_near_what_we_send_are_ours(ours_mps: float, seen_mps: float, foreign: bool) -> None:
    north = streaming(T - 10.0, vx=ours_mps, until_s=T)
    assert is_foreign(north, target(seen_mps)) is foreign
    east = streaming(T - 10.0, vy=ours_mps, until_s=T)
    assert is_foreign(east, target(0.0, seen_mps)) is foreign


def test_what_was_sent_within_the_last_second_may_be_its_echo() -> None:
    writer = OtherWriter()
    for tick in range(41):
        writer.sent((10.0 if tick <= 30 else 0.0, 0.0, 0.0), T + 0.1 * tick)
    assert not is_foreign(writer, target(5.0), T + 3.95), "between two of ours"
    writer.forget()
    for tick in range(41, 45):
        writer.sent((0.0, 0.0, 0.0), T + 0.1 * tick)
    assert is_foreign(writer, target(5.0), T + 4.41)


def test_four_sightings_in_three_seconds_are_somebody() -> None:
    writer = streaming(T - 10.0)
    for at_s in (T, T + 1.0, T + 2.0):
        writer.receive(target(9.0), at_s)
        assert not writer.contested(at_s)
    writer.receive(target(9.0), T + 3.0)
    assert writer.contested(T + 3.0) and not writer.contested(T + 3.1), "the first of the four was too long ago"


def test_a_writer_that_was_gone_for_three_seconds_is_another_one() -> None:
    writer = streaming(T)
    writer.receive(target(9.0), T + 1.0)
    for k in range(4):
        writer.receive(target(9.0), T + 4.1 + 0.1 * k)
    assert writer.contested(T + 4.5) and not writer.must_yield(T + 4.5), "it came four seconds after us"


@pytest.mark.parametrize(("first_seen_s", "yields"), [(0.5, True), (2.9, True), (3.2, False), (6.0, False)])
def test_whoever_sees_another_one_within_three_seconds_came_second(first_seen_s: float, yields: bool) -> None:
    writer = streaming(T)
    for k in range(4):
        writer.receive(target(9.0), T + first_seen_s + 0.1 * k)
    assert writer.must_yield(T + first_seen_s + 0.4) is yields
    assert not writer.must_yield(T + first_seen_s + 3.5), "nobody is accused for long"


def test_the_first_waits_ten_seconds_for_the_second_to_give_way() -> None:
    writer = streaming(T - 20.0)
    yielded = []
    for tick in range(110):
        writer.receive(target(9.0), T + 0.1 * tick)
        yielded.append(writer.must_yield(T + 0.1 * tick))
    assert yielded.index(True) == 104, "contested from the fourth sighting on"


def test_who_does_not_stream_came_second() -> None:
    writer = OtherWriter()
    for k in range(6):
        writer.receive(target(9.0 + 0.1 * k), T + 0.1 * k)
    assert writer.must_yield(T + 0.5)
    writer.forget()
    assert not writer.contested(T + 0.5) and not writer.must_yield(T + 0.5)


@pytest.mark.parametrize("moves", [(0.002, 0.0, 0.0), (0.0, 0.002, 0.0), (0.0, 0.0, 0.002)])
def test_before_we_stream_only_a_target_that_moves_and_is_no_rest_has_a_writer(
    moves: tuple[float, float, float],
) -> None:
    for speed_mps, seen in ((2.0, True), (0.4, False)):
        for steps, foreign in ((moves, seen), ((0.0005, 0.0, 0.0), False)):
            writer = OtherWriter()
            for k in range(6):
                north, east, down = (k * step for step in steps)
                writer.receive(target(speed_mps + north, east, vz=down), T + 0.1 * k)
            assert writer.contested(T + 0.5) is foreign


@pytest.mark.parametrize("mask", [POSITION, 0x0DC0, 0x0DFF])
def test_positions_as_targets_are_foreign_once_we_have_streamed_for_a_second(mask: int) -> None:
    assert is_foreign(streaming(T - 1.1, until_s=T), target(0.0, mask=mask))
    assert not is_foreign(streaming(T - 0.9, until_s=T), target(0.0, mask=mask))
    assert not is_foreign(OtherWriter(), target(9.0, mask=mask))
    stopped = streaming(T - 5.0, until_s=T)
    stopped.sent(None, T)
    assert not is_foreign(stopped, target(0.0, mask=mask))


def test_what_is_no_number_is_nobodys() -> None:
    for at in range(3):
        velocity = [0.0, 0.0, 0.0]
        velocity[at] = math.nan
        assert not is_foreign(streaming(T - 5.0, until_s=T), target(velocity[0], velocity[1], vz=velocity[2]))


@pytest.mark.parametrize("behind_ms", range(10, 90, 10))
def test_a_writer_in_our_rhythm_is_seen_whenever_in_it_it_writes(behind_ms: int) -> None:
    writer = OtherWriter()
    told_ms = range(5, 3000, WANTED_MESSAGES_US[85] // 1000)
    for now_ms in range(3000):
        if now_ms % 100 == 0:
            writer.sent((10.0, 0.0, 0.0), T + now_ms / 1e3)
        if now_ms in told_ms:
            ours = now_ms % 100 < behind_ms
            target = {"type_mask": 0x0DC7, "vx": 10.0 if ours else 0.0, "vy": 0.0 if ours else 5.0, "vz": 0.0}
            writer.receive(Message("POSITION_TARGET_LOCAL_NED", 85, target), T + now_ms / 1e3)
    assert writer.must_yield(T + 3.0)


@pytest.mark.parametrize(("interval_s", "seldom"), [(0.02, False), (0.07, False), (0.1, True), (0.5, True)])
def test_targets_in_the_rhythm_of_the_stream_are_too_seldom(interval_s: float, seldom: bool) -> None:
    writer = OtherWriter()
    for k in range(5):
        assert not writer.seldom_told, "not known yet"
        stopped = {"type_mask": 0x0DC7, "vx": 0.0, "vy": 0.0, "vz": 0.0}
        writer.receive(Message("POSITION_TARGET_LOCAL_NED", 85, stopped), T + interval_s * k)
    assert writer.seldom_told is seldom
