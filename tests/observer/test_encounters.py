"""Encounters open before they happen, keep their closest approach, and close."""

from __future__ import annotations

from dataclasses import replace

import pytest
from msgspec import structs

from ridlink.observer import Encounter, EncounterLog, Phase, Sky
from ridlink.remote_id.messages import Location, RemoteIdMessage
from ridlink.separation.definitions import Definition
from tests.observer.flights import HOME, Flyer, frames

NORTHBOUND = Flyer(1, (-200.0, 0.0), (10.0, 0.0), b"ALPHA")
SOUTHBOUND = Flyer(2, (200.0, 6.0), (-10.0, 0.0), b"BRAVO")


def watched(flyers: list[Flyer], until_s: float, log: EncounterLog) -> list[tuple[float, Phase, Encounter]]:
    sky = Sky(origin=HOME)
    changes = []
    heard = list(frames(flyers, until_s))
    for step in range(round(until_s * 10)):
        now_s = round(0.1 * step, 6)
        for time_s, frame in heard:
            if time_s == now_s:
                sky.receive(frame, time_s)
        sky.forget_silent(now_s)
        changes += [(now_s, phase, encounter) for phase, encounter in log.step(sky.at(now_s))]
    return changes


def test_a_pass_is_one_encounter_with_its_closest_approach() -> None:
    log = EncounterLog(also=[Definition.SNMAC, Definition.REMOTE_ID])
    changes = watched([NORTHBOUND, SOUTHBOUND], 40.0, log)
    assert [phase for _, phase, _ in changes if phase is not Phase.UPDATE] == [Phase.OPEN, Phase.CLOSE]
    [(closed_at_s, encounter)] = [(at, one) for at, phase, one in changes if phase is Phase.CLOSE]
    assert encounter.pair == ("ALPHA", "BRAVO")
    assert encounter.opened_s < 1.0
    assert encounter.closest_m == pytest.approx(6.0, abs=0.1)
    assert encounter.closest_s == pytest.approx(20.0, abs=0.05)
    assert encounter.margin_m[Definition.SNMAC] == pytest.approx(6.0 - 15.0, abs=0.1)
    assert encounter.margin_m[Definition.CANDIDATE2] == pytest.approx(6.0 - 23.6, abs=0.2)
    assert encounter.margin_m[Definition.REMOTE_ID] < encounter.margin_m[Definition.CANDIDATE2]
    assert encounter.inside_s[Definition.CANDIDATE2] == pytest.approx(2 * (23.6**2 - 36) ** 0.5 / 20.0, abs=0.2)
    assert closed_at_s == encounter.closed_s
    assert not encounter.collided and not encounter.moved


def test_a_collision_between_two_instants_is_seen() -> None:
    crossing = replace(SOUTHBOUND, start_ne_m=(200.03, 0.1), velocity_ne_mps=(-40.0, 0.0))
    log = EncounterLog()
    [closed] = [one for _, phase, one in watched([NORTHBOUND, crossing], 30.0, log) if phase is Phase.CLOSE]
    assert closed.closest_m == pytest.approx(0.1, abs=0.05)
    assert closed.collided


class Turning(Flyer):
    """Turns right after ten seconds."""

    def at(self, time_s: float) -> tuple[float, float]:
        north, east = super().at(time_s)
        return north, east + max(0.0, time_s - 10.0) * 3.0

    def velocity(self, time_s: float) -> tuple[float, float]:
        return (self.velocity_ne_mps[0], 3.0 if time_s >= 10.0 else 0.0)


class Climbing(Flyer):
    """Says after five seconds that it flies 200 m higher."""

    def messages(self, time_s: float) -> list[RemoteIdMessage]:
        above_m = 200.0 if time_s >= 5.0 else 0.0
        return [
            structs.replace(said, altitude_geodetic_m=self.altitude_m + above_m) if isinstance(said, Location) else said
            for said in super().messages(time_s)
        ]


def test_who_turned_is_named_and_the_approach_is_followed_to_its_end() -> None:
    turning = Turning(2, (200.0, 6.0), (-10.0, 0.0), b"BRAVO")
    log = EncounterLog()
    [closed] = [one for _, phase, one in watched([NORTHBOUND, turning], 35.0, log) if phase is Phase.CLOSE]
    miss_m = 36.0 * 20.0 / (20.0**2 + 3.0**2) ** 0.5
    assert closed.closest_m == pytest.approx(miss_m, abs=0.2)
    assert closed.moved == ("BRAVO",)


def test_known_heights_apart_are_no_encounter() -> None:
    assert not watched([NORTHBOUND, replace(SOUTHBOUND, altitude_m=700.0)], 30.0, EncounterLog())


def test_an_identity_that_is_heard_late_does_not_end_an_encounter() -> None:
    late = replace(NORTHBOUND, identity_from_s=3.0)
    changes = watched([late, SOUTHBOUND], 40.0, EncounterLog())
    assert [phase for _, phase, _ in changes if phase is not Phase.UPDATE] == [Phase.OPEN, Phase.CLOSE]
    assert changes[-1][2].pair == ("ALPHA", "BRAVO")


def test_an_aircraft_that_turns_out_to_be_another_met_nobody() -> None:
    shadow = replace(NORTHBOUND, sysid=200, start_ne_m=(-201.0, 0.0), identity_from_s=3.0)
    changes = watched([NORTHBOUND, shadow, SOUTHBOUND], 40.0, EncounterLog())
    closed = [one for _, phase, one in changes if phase is Phase.CLOSE]
    assert [one.pair for one in closed if not one.mistaken] == [("ALPHA", "BRAVO")]
    assert len(closed) == 3, "with itself, and the same encounter twice"


def test_whoever_climbs_out_of_the_way_is_not_met_below() -> None:
    climbing = Climbing(2, (200.0, 6.0), (-10.0, 0.0), b"BRAVO")
    log = EncounterLog()
    changes = watched([NORTHBOUND, climbing], 40.0, log)
    [closed] = [one for _, phase, one in changes if phase is Phase.CLOSE]
    assert closed.closest_m > 100.0 and not closed.collided


def test_silence_shorter_than_allowed_is_bridged_and_not_counted_as_encounter() -> None:
    log = EncounterLog(gone_after_s=5.0)
    sky = Sky(origin=HOME)
    phases = []
    for step, (time_s, frame) in enumerate(frames([NORTHBOUND, SOUTHBOUND], 20.0)):
        if not 8.0 < time_s < 11.0:
            sky.receive(frame, time_s)
        if step % 6 == 5:
            phases += [phase for phase, _ in log.step(sky.at(time_s, missed=3.0))]
    assert [phase for phase in phases if phase is not Phase.UPDATE] == [Phase.OPEN]
    [encounter] = log.close()
    assert encounter.closed_s == pytest.approx(19.9)


def test_parallel_flight_outside_the_discs_is_no_encounter() -> None:
    beside = Flyer(2, (-200.0, 60.0), (10.0, 0.0))
    assert not watched([NORTHBOUND, beside], 20.0, EncounterLog())


def test_an_aircraft_that_falls_silent_closes_its_encounter() -> None:
    log = EncounterLog()
    sky = Sky(origin=HOME, forget_after_s=5.0)
    for time_s, frame in frames([NORTHBOUND, SOUTHBOUND], 5.0):
        sky.receive(frame, time_s)
    assert [phase for phase, _ in log.step(sky.at(5.0))] == [Phase.OPEN]
    sky.forget_silent(20.0)
    assert [phase for phase, _ in log.step(sky.at(20.0))] == [Phase.CLOSE]
    assert not log.open


def test_the_end_of_a_recording_closes_what_is_open() -> None:
    log = EncounterLog()
    watched([NORTHBOUND, SOUTHBOUND], 15.0, log)
    [encounter] = log.close()
    assert encounter.closed_s == pytest.approx(14.9)
    assert encounter.closest_m == pytest.approx(102.0, abs=1.0)


def test_f12_of_too_many_encounters_those_that_come_first_are_followed() -> None:
    """A crowd stands close together; later two others fly at each other, and meet sooner than any two of the crowd."""
    crowd = [Flyer(10 + k, (0.0, 40.0 * k), (0.0, 0.2 * (-1) ** k), b"CROWD%d" % k) for k in range(12)]
    fast = [Flyer(1, (-2000.0, -900.0), (60.0, 0.0), b"ALPHA"), Flyer(2, (2000.0, -900.0), (-60.0, 0.0), b"BRAVO")]
    everybody = EncounterLog()
    watched([*crowd, *fast], 20.0, everybody)
    assert len(everybody.open) > 3
    log, open_now = EncounterLog(most=3), set[tuple[str, str]]()
    for _, phase, encounter in watched([*crowd, *fast], 33.0, log):
        pair = encounter.pair
        if phase is Phase.OPEN:
            open_now.add(pair)
        elif phase is Phase.CLOSE:
            open_now.remove(pair)
    assert len(log.open) == len(open_now) == 3
    assert ("ALPHA", "BRAVO") in open_now


def test_f12_a_crowd_of_ghosts_takes_no_more_memory_than_there_is_for_encounters() -> None:
    ghosts = [
        Flyer(1, (3.0 * k, 0.0), (1.0, 0.0), id_or_mac=b"%020d" % k, extended=False, compid=236) for k in range(60)
    ]
    log = EncounterLog(most=100)
    changes = watched(ghosts, 1.0, log)
    assert len(log.open) == 100
    assert not [one for _, phase, one in changes if phase is Phase.CLOSE], "those that are followed stay"
