"""The picture: who counts as traffic, where, and how many at most."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from msgspec import structs

from ridlink.geodesy import moved
from ridlink.remote_id.report import RemoteIdReport
from ridlink.traffic.own_state import OwnState
from ridlink.traffic.picture import TrafficPicture
from ridlink.traffic.snapshot import Snapshot
from tests.traffic.reports import HERE, OWN, SETTINGS, picture, report, still


def seen(*reports: RemoteIdReport, own: OwnState = OWN, now_s: float = 10.0) -> Snapshot:
    return picture(*reports).snapshot(own, now_s)


def test_arrays_about_the_own_position() -> None:
    snapshot = seen(report(commanded_ned_mps=(-9.0, 1.0, 0.0)), now_s=10.5)
    assert len(snapshot) == 1
    assert snapshot.position_ned_m[0] == pytest.approx((100.0, 0.0, 0.0), abs=0.05)
    assert snapshot.velocity_ned_mps[0].tolist() == [-10.0, 0.0, 0.0]
    assert snapshot.command_ned_mps[0].tolist() == [-9.0, 1.0, 0.0]
    assert snapshot.age_s[0] == pytest.approx(0.5)
    assert snapshot.error_bound_m[0] == 3.0
    assert snapshot.airframe_m[0] == 0.6
    assert snapshot.avoiding.tolist() == [True]
    assert snapshot.widening_m[0] == pytest.approx(0.5 * 5.0 * 0.5**2)


def test_unknowns_leave_as_nan_and_a_blind_speed_grows_the_area() -> None:
    bare = report(
        velocity_ned_mps=None, speed_horizontal_mps=None, horizontal_error_m=None, airframe_size_m=None,
        accuracy_bound_m=None,
    )  # fmt: skip
    snapshot = seen(bare, now_s=12.0)
    for array in (snapshot.error_bound_m, snapshot.airframe_m, snapshot.accuracy_bound_m, snapshot.speed_mps):
        assert math.isnan(array[0])
    assert snapshot.command_ned_mps.shape == (1, 3) and np.isnan(snapshot.command_ned_mps).all()
    assert snapshot.velocity_ned_mps[0].tolist() == [0.0, 0.0, 0.0]
    coasting = 0.5 * 5.0 * 2.0**2
    assert snapshot.widening_m[0] == pytest.approx(2.0 * 30.7 + coasting)
    known = seen(structs.replace(bare, speed_horizontal_mps=4.0), now_s=12.0)
    assert known.widening_m[0] == pytest.approx(8.0 + coasting)


def test_nobody() -> None:
    snapshot = seen()
    assert len(snapshot) == 0
    assert snapshot.position_ned_m.shape == (0, 3)


def test_on_the_ground_is_no_traffic() -> None:
    assert len(seen(report(status=1))) == 0


@pytest.mark.parametrize(
    ("fields", "counts"),
    [
        ({"altitude_geodetic_m": 587.0 + 60.0}, False),
        ({"altitude_geodetic_m": 587.0 - 60.0}, False),
        ({"altitude_geodetic_m": 587.0 + 19.0}, True),
        ({"altitude_geodetic_m": 587.0 + 60.0, "vertical_error_m": None}, True),
        ({"altitude_geodetic_m": 587.0 + 60.0, "vertical_error_m": 50.0}, True),
        ({"altitude_geodetic_m": None, "altitude_barometric_m": 900.0}, True),
        ({"altitude_geodetic_m": 587.0 + 60.0, "airframe_height_m": None}, True),
        ({"altitude_geodetic_m": 587.0 + 60.0, "climb_mps": None}, True),
        ({"altitude_geodetic_m": 587.0 + 60.0, "climb_mps": -4.0}, False),
        ({"altitude_geodetic_m": 587.0 + 60.0, "climb_mps": -6.0}, True),
        ({"altitude_geodetic_m": 587.0 + 60.0, "climb_mps": -30.0}, True),
        ({"altitude_geodetic_m": 587.0 + 60.0, "climb_mps": 9.0}, False),
        ({"altitude_geodetic_m": 587.0 - 60.0, "climb_mps": 9.0}, True),
        ({"altitude_geodetic_m": 587.0 + 30.0, "airframe_height_m": 20.0}, True),
        ({"altitude_geodetic_m": None, "height_m": 200.0, "height_reference": 0}, True),
    ],
)
def test_f19_other_altitudes_count_only_if_they_are_known_to_be_other(fields: dict[str, object], counts: bool) -> None:
    assert len(seen(report(**fields))) == counts


def test_without_an_own_ellipsoidal_altitude_everybody_is_at_our_height() -> None:
    snapshot = seen(report(altitude_geodetic_m=900.0), own=replace(OWN, altitude_ellipsoid_m=None))
    assert len(snapshot) == 1
    assert abs(snapshot.position_ned_m[0, 2]) < 0.01


@pytest.mark.parametrize("fields", [{"altitude_ellipsoid_m": None}, {"vertical_error_bound_m": None}])
def test_an_own_height_that_is_not_known_opens_no_gate(fields: dict[str, object]) -> None:
    above = report(altitude_geodetic_m=900.0)
    assert len(seen(above)) == 0
    assert len(seen(above, own=replace(OWN, **fields))) == 1  # type: ignore[arg-type]
    unknown_airframe = picture(above, settings=replace(SETTINGS, own_height_m=None))
    assert len(unknown_airframe.snapshot(OWN, 10.0)) == 1


def test_those_who_fly_far_above_are_handed_out_where_they_are_wanted() -> None:
    made = picture(report(5), report(6, altitude_geodetic_m=700.0), settings=replace(SETTINGS, all_heights=True))
    snapshot = made.snapshot(OWN, 10.0)
    assert [track.report.source[0] for track in snapshot.tracks] == [5, 6]
    assert snapshot.apart.tolist() == [False, True]
    assert snapshot.above_m == pytest.approx([0.0, 113.0])
    assert snapshot.vertical_bound_m == pytest.approx([10.3, 10.3])
    assert made.counters["other_altitude"] == 1


def test_f05_the_senders_age_counts_if_it_is_plausible() -> None:
    for utc_s, age in ((3700.0 + 0.3, 0.3), (7299.9, 0.0), (100.0 + 4.0, 4.0), (100.0 + 6.0, 0.0), (0.0, 0.0)):
        made = picture()
        made.receive("rid", report(), utc_s=utc_s)
        assert made.snapshot(OWN, 10.0).age_s[0] == pytest.approx(age)
    assert made.counters["timestamp_implausible"] == 1
    made.receive("rid", report(sysid=6, timestamp_s=None), utc_s=5.0)
    assert made.counters["timestamp_implausible"] == 1


@pytest.mark.parametrize(("age_s", "plausible"), [(-2.0, False), (-0.9, True), (4.9, True), (5.1, False)])
def test_f05_what_age_of_a_sender_is_plausible(age_s: float, plausible: bool) -> None:
    made = picture()
    made.receive("rid", report(timestamp_s=100.0), utc_s=100.0 + age_s)
    assert made.counters["timestamp_implausible"] == (not plausible)
    (track,) = made.tracks.values()
    assert track.trusted_clock is plausible
    assert track.measured_at_s == pytest.approx(10.0 - (max(age_s, 0.0) if plausible else 0.0))


def test_f05_a_track_from_before_our_clock_was_right_is_believed_as_soon_as_it_agrees() -> None:
    made = picture()
    made.receive("rid", report(north=100.0))
    made.receive("rid", report(north=98.0, timestamp_s=100.2, received_at_s=10.2), utc_s=100.25)
    made.receive("rid", report(north=99.0, timestamp_s=100.1, received_at_s=10.3), utc_s=100.35)
    assert len(made) == 1, "a late datagram is no second vehicle"
    assert made.counters["report_older"] == 1
    made.receive("rid", report(north=97.0, timestamp_s=100.3, received_at_s=10.4))
    (track,) = made.tracks.values()
    assert not track.trusted_clock, "as of its last report"


def test_f05_a_forged_report_from_the_near_future_does_not_make_the_true_ones_look_late() -> None:
    made = picture()
    made.receive("rid", report(north=100.0), utc_s=100.0)
    made.receive("rid", report(north=104.0, timestamp_s=101.9, received_at_s=10.05), utc_s=100.05)
    for k in range(1, 6):
        true = report(north=100.0 - k, timestamp_s=100.0 + 0.1 * k, received_at_s=10.0 + 0.1 * k)
        made.receive("rid", true, utc_s=100.0 + 0.1 * k)
    assert made.counters["report_older"] == 0
    assert min(track.metres_to(report(north=95.0)) for track in made.tracks.values()) == pytest.approx(0.0, abs=0.01)


def test_f09_own_echo_is_our_identity_at_our_place() -> None:
    here, elsewhere = report(north=10.0), report(north=200.0)
    for one, echo in ((here, True), (elsewhere, False)):
        made = picture()
        made.receive("rid", one, own_sysid=5)
        assert (len(made) == 0) is echo
        assert made.counters["own_echo" if echo else "own_id_elsewhere"] == 1
    relayed = structs.replace(here, source=(9, 236), id_or_mac=b"US1")
    made = picture()
    made.receive("vehicle", relayed, own_sysid=9)
    assert len(made) == 1, "our system id on relayed data is the receiver's, not the sender's"
    made.receive("vehicle", relayed, own_sysid=9, own_names={b"US1"})
    assert made.counters["own_echo"] == 1
    made = picture(own=None)
    made.receive("rid", here, own_sysid=5)
    assert len(made) == 0
    made.receive("rid", structs.replace(elsewhere, horizontal_error_m=None), own_sysid=6)
    assert len(made) == 1


def test_f09_a_name_that_is_told_late_takes_the_track_of_the_echo_with_it() -> None:
    made = picture()
    here = structs.replace(report(north=5.0), source=(9, 236), id_or_mac=b"MAC")
    made.receive("vehicle", here, own_names={b"US1"})
    assert len(made) == 1
    named = structs.replace(here, uas_id=b"US1", timestamp_s=100.1, received_at_s=10.1)
    made.receive("vehicle", named, own_names={b"US1"})
    assert len(made) == 0 and made.counters["own_echo"] == 1


def test_f09_who_came_from_elsewhere_is_no_echo_whatever_it_is_called_then() -> None:
    made = picture()
    flown(made, report(north=100.0), 90.0)
    made.receive("rid", report(north=9.0, timestamp_s=109.0, received_at_s=19.0), own_sysid=5)
    (track,) = made.tracks.values()
    assert track.seen_elsewhere and track.received_at_s == 19.0 and not made.counters["own_echo"]


def test_f09_another_name_under_our_system_id_is_another_vehicle() -> None:
    for uas_id, own_names, echo in ((b"US2", {b"US1"}, False), (b"US2", set(), True), (None, {b"US1"}, True)):
        made = picture()
        made.receive("rid", report(north=5.0, uas_id=uas_id), own_sysid=5, own_names=own_names)
        assert made.counters["own_echo"] == echo and len(made) == (not echo)


def flown(made: TrafficPicture, one: RemoteIdReport, metres: float, *, utc: bool = False, **fields: object) -> None:
    """Reports of a vehicle that comes so far south, ten a second, each 0.1 s after the other."""
    for k in range(round(metres)):
        latitude, longitude = moved(one.latitude_deg or 0.0, one.longitude_deg or 0.0, -k, 0.0)
        now_s = 10.0 + 0.1 * k
        late = structs.replace(one, latitude_deg=latitude, longitude_deg=longitude, timestamp_s=100.0 + 0.1 * k)
        made.receive(
            "rid", structs.replace(late, received_at_s=now_s), utc_s=100.0 + 0.1 * k if utc else None, **fields
        )


def test_f09_an_intruder_under_our_identity_is_no_echo_when_it_comes_near() -> None:
    made = picture()
    flown(made, report(north=100.0), 90.0, own_sysid=5)
    (track,) = made.tracks.values()
    assert track.received_at_s == pytest.approx(18.9)
    made.receive("rid", report(north=1.0, timestamp_s=109.0, received_at_s=19.0), own_sysid=5)
    assert made.counters["own_echo"] == 1 and len(made) == 1, "what is nearer to us than to it is our own"


def test_f09_while_nobody_knows_where_we_are_nothing_is_said_of_where_our_identity_is() -> None:
    made = picture()
    flown(made, report(north=300.0), 20.0, own_sysid=5)
    (intruder,) = made.tracks.values()
    made.forget_own_state()
    echo = report(north=30.0, timestamp_s=102.0, received_at_s=12.0)
    made.receive("rid", structs.replace(echo, source=(6, 1)), own_sysid=6)
    assert made.counters["own_echo"] == 1 and made.counters["own_id_elsewhere"] == 20 and len(made) == 1
    made.receive("rid", report(north=280.0, timestamp_s=102.0, received_at_s=12.0), own_sysid=5)
    assert intruder.received_at_s == 12.0, "who was seen elsewhere is somebody else all the same"


def test_f08_two_vehicles_with_one_identity_are_two_tracks() -> None:
    made = picture()
    for k in range(20):
        when = {"timestamp_s": 100.0 + 0.1 * k, "received_at_s": 10.0 + 0.1 * k}
        made.receive("rid", report(north=300.0 - k, **when))
        made.receive("rid", still(north=-200.0, **{name: value + 0.05 for name, value in when.items()}))
    snapshot = made.snapshot(OWN, 12.0)
    assert sorted(snapshot.position_ned_m[:, 0]) == pytest.approx([-200.0, 281.0], abs=2.0)
    assert made.counters["identity_doubtful"] == 1


@pytest.mark.parametrize("forged_first", [True, False])
@pytest.mark.parametrize("ahead_s", [10.0, 600.0, 1700.0])
def test_f05_a_forged_time_ahead_does_not_freeze_the_true_track(forged_first: bool, ahead_s: float) -> None:
    made = picture()
    forgery = report(north=100.0, timestamp_s=100.0 + ahead_s, received_at_s=10.0)
    if forged_first:
        made.receive("rid", forgery, utc_s=100.0)
    flown(made, report(north=100.0), 10.0, utc=True)
    made.receive("rid", structs.replace(forgery, received_at_s=11.0), utc_s=101.0)
    made.receive("rid", report(north=90.0, timestamp_s=101.1, received_at_s=11.1), utc_s=101.1)
    assert any(
        track.received_at_s == 11.1 and track.metres_to(report(north=90.0)) < 0.1 for track in made.tracks.values()
    )
    assert len(made) == 2


def test_a_replay_from_elsewhere_is_old_and_no_other_vehicle() -> None:
    made = picture(report(timestamp_s=100.0))
    made.receive("rid", report(north=400.0, timestamp_s=80.0, received_at_s=10.1))
    made.receive("rid", report(north=400.0, timestamp_s=100.0, received_at_s=10.2))
    assert len(made) == 1
    assert (made.counters["report_older"], made.counters["report_repeated"]) == (1, 1)


def test_f08_one_identity_cannot_fill_the_picture_and_who_is_heard_keeps_its_place() -> None:
    made = picture()
    for k in range(50):
        when = {"timestamp_s": 100.0 + 0.1 * k, "received_at_s": 10.0 + 0.1 * k}
        made.receive("rid", still(north=100.0, **when))
        made.receive("rid", still(north=1000.0 * (k + 1), **{name: value + 0.05 for name, value in when.items()}))
    assert len(made) == 4
    assert any(
        track.metres_to(report(north=100.0)) < 1.0 and track.received_at_s > 14.8 for track in made.tracks.values()
    )
    assert made.counters["track_refused"] > 0


def test_f08_of_two_that_a_report_may_be_the_next_word_of_it_moves_the_nearer() -> None:
    made = picture(still(north=100.0), still(north=160.0, timestamp_s=100.1, received_at_s=10.1))
    assert len(made) == 2
    made.receive("rid", still(north=145.0, timestamp_s=102.0, received_at_s=12.0))
    moved_to = [track.report.timestamp_s for track in made.tracks.values()]
    assert moved_to == [100.0, 102.0]


def four_far_away() -> TrafficPicture:
    made = picture()
    for k in range(4):
        made.receive("rid", still(north=1000.0 * (k + 1), timestamp_s=100.0 + 0.1 * k, received_at_s=10.0 + 0.1 * k))
    made.snapshot(OWN, 10.4)
    return made


def test_f08_of_four_under_one_identity_the_least_urgent_gives_way_to_a_more_urgent_fifth() -> None:
    made = four_far_away()
    made.receive("rid", still(north=5000.0, timestamp_s=100.5, received_at_s=10.5))
    assert made.counters["track_refused"] == 1
    made.receive("rid", still(north=60.0, timestamp_s=100.5, received_at_s=10.5))
    places = sorted(round(track.metres_to(still(north=0.0)), -1) for track in made.tracks.values())
    assert places == [60, 1000, 2000, 3000] and made.counters["track_displaced"] == 1


def test_f08_who_has_long_been_in_conflict_gives_way_to_nobody() -> None:
    made = four_far_away()
    for track in made.tracks.values():
        track.in_conflict, track.began_at_s = True, 5.0
    made.receive("rid", still(north=60.0, timestamp_s=100.5, received_at_s=10.5))
    assert (made.counters["track_refused"], made.counters["track_displaced"]) == (1, 0)


def test_who_fell_silent_gives_way_to_the_next_vehicle_with_its_identity() -> None:
    made = picture()
    for k in range(4):
        made.receive("rid", still(north=1000.0 * (k + 1), timestamp_s=100.0 + 0.1 * k, received_at_s=10.0 + 0.1 * k))
    made.receive("rid", still(north=-1000.0, timestamp_s=101.0, received_at_s=11.0))
    assert made.counters["track_refused"] == 1
    made.receive("rid", still(north=-1000.0, timestamp_s=103.5, received_at_s=13.5))
    places = sorted(round(track.metres_to(still(north=0.0)), -1) for track in made.tracks.values())
    assert places == [1000.0, 2000.0, 3000.0, 4000.0]
    assert min(track.received_at_s for track in made.tracks.values()) == 10.1, "the first was silent for longest"


def test_an_echo_with_unknown_or_absurd_error_has_a_bounded_gate() -> None:
    made = picture()
    made.receive("rid", report(north=60.0, horizontal_error_m=None), own_sysid=5)
    assert made.counters["own_echo"] == 1
    made.receive("rid", report(north=500.0, horizontal_error_m=655.35), own_sysid=5)
    assert made.counters["own_id_elsewhere"] == 1


def test_the_same_sender_on_two_links_is_two_tracks() -> None:
    made = picture(report())
    made.receive("vehicle", report())
    assert len(made) == 2


def test_repeats_and_nonsense_are_counted() -> None:
    made = picture(report(), report(received_at_s=11.0), report(timestamp_s=99.0), report(sysid=6, latitude_deg=None))
    assert made.counters["report_repeated"] == 1
    assert made.counters["report_older"] == 1
    assert made.counters["report_without_position"] == 1
    made.receive("rid", report(timestamp_s=101.0, received_at_s=11.0, horizontal_error_m=655.35))
    assert made.counters["position_unusable"] == 1


def test_f10_silent_tracks_are_dropped() -> None:
    made = picture(report())
    made.drop_silent(14.9)
    assert len(made) == 1
    made.drop_silent(15.1)
    assert len(made) == 0
    assert made.counters["track_lost"] == 1


def test_f12_a_full_picture_gives_up_whoever_matters_least() -> None:
    small = replace(SETTINGS, max_tracks=3)
    made = picture(*(report(sysid=k, north=100.0 * k) for k in (1, 2, 3)), settings=small)
    made.snapshot(OWN, 10.0)
    made.receive("rid", report(sysid=9, north=1000.0))
    assert made.counters["track_refused"] == 1
    made.receive("rid", report(sysid=8, north=50.0))
    assert sorted(key[1] for key in made.tracks) == [1, 2, 8]
    made.receive("rid", report(sysid=7, north=60.0))
    assert sorted(key[1] for key in made.tracks) == [1, 7, 8]
    made.drop_silent(20.0)
    made.receive("rid", report(sysid=4, received_at_s=20.0))
    assert len(made) == 1


def test_f12_who_left_meanwhile_is_not_given_up_once_more() -> None:
    small = replace(SETTINGS, max_tracks=3)
    made = picture(*(report(sysid=k, north=100.0 * k) for k in (1, 2, 3)), settings=small)
    made.snapshot(OWN, 10.0)
    made.receive("rid", report(sysid=7, north=50.0))  # instead of the third; the second is next
    del made.tracks[next(key for key in made.tracks if key[1] == 2)]
    made.receive("rid", report(sysid=8, north=60.0))
    made.receive("rid", report(sysid=9, north=40.0))
    assert sorted(key[1] for key in made.tracks) == [7, 8, 9]
    made.receive("rid", report(sysid=6, north=30.0))  # until the next look, nobody is left to judge
    assert sorted(key[1] for key in made.tracks) == [7, 8, 9]
    assert made.counters["track_evicted"] == 2 and made.counters["track_refused"] == 1


def test_f12_a_flood_of_identities_does_not_displace_a_real_threat() -> None:
    small = replace(SETTINGS, max_tracks=50)
    made = picture(report(sysid=200, north=80.0), settings=small)
    for k in range(500):
        ghost = report(sysid=k % 100, north=300.0 + k, id_or_mac=b"ghost%d" % k)
        made.receive("rid", ghost)
        if k % 100 == 99:
            assert len(made.snapshot(OWN, 10.0)) == 50
    assert any(key[1] == 200 for key in made.tracks)
    assert len(made) == 50


@pytest.mark.parametrize("fields", [{"status": 1}, {"altitude_geodetic_m": 900.0}], ids=["ground", "height"])
def test_f12_those_who_are_no_traffic_hold_no_room_against_those_who_are(fields: dict[str, object]) -> None:
    """However near they say they are: nobody avoids them, so a flood of them would cost its sender nothing."""
    small = replace(SETTINGS, max_tracks=50)
    ghosts = [report(sysid=k, north=1.0, **fields) for k in range(1, 60)]
    made = picture(*ghosts, settings=small)
    assert len(made.snapshot(OWN, 10.0)) == 0 and len(made) == 50
    made.receive("rid", report(sysid=200, north=400.0))
    assert [track.key[1] for track in made.snapshot(OWN, 10.0).tracks] == [200]
    for ghost in ghosts[:40]:
        made.receive("rid", structs.replace(ghost, source=(ghost.source[0] + 100, 1)))
    assert [track.key[1] for track in made.snapshot(OWN, 10.0).tracks] == [200] and len(made) == 50
    everywhere = picture(*ghosts, settings=replace(small, all_heights=True))
    everywhere.snapshot(OWN, 10.0)
    everywhere.receive("rid", report(sysid=200, north=400.0))
    assert any(key[1] == 200 for key in everywhere.tracks) is (fields == {"status": 1}), "who may climb counts them"


def test_who_has_landed_is_in_conflict_with_nobody() -> None:
    made = picture(report())
    (track,) = made.tracks.values()
    track.in_conflict = True
    made.receive("rid", report(status=1, timestamp_s=101.0, received_at_s=11.0))
    made.snapshot(OWN, 11.0)
    assert not track.in_conflict and not track.expired(16.0) and track.expired(16.1)


def test_f12_whoever_is_where_we_are_is_more_urgent_than_all_others() -> None:
    made = picture(report(sysid=1), settings=replace(SETTINGS, max_tracks=1))
    made.snapshot(OWN, 10.0)
    made.receive("rid", report(sysid=2, latitude_deg=HERE[0], longitude_deg=HERE[1]))
    assert [track.key[1] for track in made.snapshot(OWN, 10.0).tracks] == [2]
    made.receive("rid", report(sysid=3, north=20.0))
    assert [track.key[1] for track in made.snapshot(OWN, 10.0).tracks] == [2]
    assert made.counters["track_refused"] == 1


def test_a_full_picture_that_was_never_looked_at_refuses() -> None:
    made = picture(report(sysid=1), report(sysid=2), settings=replace(SETTINGS, max_tracks=1), own=None)
    assert len(made) == 1
    assert made.counters["track_refused"] == 1


def test_the_solver_gets_the_most_urgent_only() -> None:
    few = replace(SETTINGS, max_considered=2)
    made = picture(*(report(sysid=k, north=100.0 * k) for k in (3, 1, 2)), settings=few)
    snapshot = made.snapshot(OWN, 10.0)
    assert [track.key[1] for track in snapshot.tracks] == [1, 2]
    assert made.counters["not_considered"] == 1
