"""`--guard` and `--takeoff-aware`: the engine beside an emulated autopilot that flies a mission, over encoded bytes."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from ridlink.engine import Engine, EngineConfig
from ridlink.engine.guard import CHANGED, DO_SET_MODE, EXTERNAL_MODE, FOREIGN_MODE, Guard, Phase
from ridlink.failsafe import STEERING, UNHEARD, State
from ridlink.geodesy import moved
from ridlink.mavlink.codec import CRC_EXTRAS
from ridlink.mavlink.frames import Frame, parse_datagram
from ridlink.own_ship import ARDUPILOT, PX4
from ridlink.traffic.encounter import encounters
from sitl_sim.autopilot import Start
from tests.daemon.emulated import Emulated
from tests.daemon.invariants import ASKED, GUARDING, Observer, messages
from tests.sitl_sim import missions
from tests.sitl_sim.flight import (
    ACCEPTED,
    COMPANION,
    GUIDED,
    HOME,
    PX4_HOLD,
    PX4_MISSION,
    START_NED_M,
    Flight,
    message_of,
)

MISSION = {"px4": PX4_MISSION, "ardupilot": missions.AUTO}
both = pytest.mark.parametrize("flavour", ["px4", "ardupilot"])


class Guarded(Flight):
    """A vehicle in virtual time with a guard beside it."""

    def __init__(self, flavour: str, *, begun: Start = Start.HOLDING, **options: Any) -> None:
        super().__init__(flavour, begun, gnss="white")
        self.engine = Engine(EngineConfig(guard=True, airframe_m=0.6, **options))
        self.observer = Observer(may=ASKED | GUARDING)
        self.intruder: Emulated | None = None
        self.nearest_m = math.inf
        self.phases: list[Phase] = []
        self.lost: set[str] = set()
        self.deaf = False
        self.warnings: list[str] = []
        self.asked: list[int] = []

    def _note(self, outgoing: Any) -> Any:
        for datagram, address in outgoing:
            if address == COMPANION:
                frames = [frame for frame in parse_datagram(datagram, CRC_EXTRAS) if isinstance(frame, Frame)]
                kept = [frame.raw for frame in frames if message_of(frame).name not in self.lost]
                self.engine.receive_vehicle(b"".join(kept), self.now_s, source=COMPANION)
        return super()._note(outgoing)

    @property
    def guard(self) -> Guard:
        assert self.engine.guard is not None
        return self.engine.guard

    def step(self) -> None:
        """A tenth of a second of everything."""
        self.advance(0.1)
        if self.intruder is not None:
            self.intruder.advance(0.1)
            apart = self.intruder.position[:2] - self.world.position_ned_m[0, :2]
            self.nearest_m = min(self.nearest_m, float(np.hypot(*apart)))
            self.engine.receive_remote_id(intruding(self.intruder, self.now_s), self.now_s, source="air")
        output = self.engine.step(self.now_s)
        self.warnings += output.warnings
        for frame in output.to_vehicle:
            self.observer.steerable = True
            self.asked += [m.command for m in self.observer.watch(frame) if m.name == "COMMAND_LONG"]
            if not self.deaf:
                super()._note(self.autopilot.receive(frame, COMPANION, self.now_s))
        if not self.phases or self.phases[-1] is not self.guard.phase:
            self.phases.append(self.guard.phase)

    def until(self, what: Any, patience_s: float = 90.0) -> None:
        for _ in range(round(10 * patience_s)):
            if what():
                return
            self.step()
        raise AssertionError(f"not within {patience_s} s: {self.guard.phase}, {self.engine.rung}, mode {self.mode}")

    def settle(self) -> None:
        """Until it flies north at the speed of its mission."""
        before = [0.0]

        def steady() -> bool:
            before.append(self.velocity[0])
            return before[-1] > 4.0 and abs(before[-1] - before[-2]) < 0.02

        self.until(steady)


def test_a_guard_waits_for_nobodys_request() -> None:
    engine = Engine(EngineConfig(guard=True))
    engine.step(0.0)
    assert (engine.rung.state, engine.rung.reason) == (State.STANDBY, "guard: watching")


def intruding(intruder: Emulated, now_s: float) -> bytes:
    """Its Remote ID about the home of the emulator, which is not that of the other tests."""
    north, east = (float(value) for value in intruder.position[:2])
    latitude, longitude = moved(HOME.latitude_deg, HOME.longitude_deg, north, east)
    return intruder.remote_id(now_s, latitude_deg=latitude, longitude_deg=longitude, altitude_geodetic_m=None)


def on_a_mission(flavour: str, **options: Any) -> Guarded:
    """A vehicle that flies 360 m north, and somebody who crosses its path."""
    flight = Guarded(flavour, **options)
    flight.advance(0.1)
    plan = [missions.item(north=340.0), missions.item(north=360.0)]
    assert missions.upload(flight, missions.planned(flavour, plan)) == 0
    assert missions.start(flight) == 0
    flight.settle()
    return flight


def cross(flight: Guarded) -> None:
    """Somebody who is where the vehicle will be in twelve seconds."""
    north, speed = float(flight.world.position_ned_m[0, 0]), flight.velocity[0]
    flight.intruder = Emulated(9, ned_m=(north + 12.0 * speed, -72.0, -50.0))
    flight.intruder.velocity[1] = 6.0


@pytest.mark.no_cover
@both
def test_a_conflict_on_a_mission_is_resolved_and_mission_and_mode_are_handed_back(flavour: str) -> None:
    flight = on_a_mission(flavour)
    item = flight.last("MISSION_CURRENT").seq
    assert flight.observer.setpoints == [], "nothing is flown while all is clear"
    cross(flight)
    flight.until(lambda: flight.guard.phase is Phase.RESOLVING)
    flown_mps = math.hypot(*flight.velocity[:2])
    flight.step()
    assert flight.engine._last_record is not None
    wanted = flight.engine._last_record.preferred_ned_mps
    assert wanted is not None and math.hypot(*wanted[:2]) <= min(1.05 * flown_mps, 10.0), "no faster than its mission"
    assert flight.mode == EXTERNAL_MODE[PX4 if flavour == "px4" else ARDUPILOT]
    assert flight.guard.found_mode == MISSION[flavour]
    flight.until(lambda: flight.guard.phase is Phase.WATCHING)
    assert flight.mode == MISSION[flavour]
    assert flight.last("MISSION_CURRENT").seq == item
    last = len(missions.planned(flavour, [0, 0])) - 1
    flight.until(lambda: last in missions.reached(flight))
    assert flight.nearest_m > 4.0, "airframes and the error that it states"
    # The way from where it was handed back may lead through the conflict once more.
    assert flight.guard.takeovers <= 2 and flight.guard.phase is Phase.WATCHING
    once = [Phase.WATCHING, Phase.TAKING_OVER, Phase.RESOLVING, Phase.HANDING_BACK]
    assert flight.phases == [*(once * flight.guard.takeovers), Phase.WATCHING]
    assert flight.observer.setpoints[0].vx == 0.0


def test_a_plan_is_judged_at_the_highest_speed_at_which_it_was_flown() -> None:
    """A takeover may find the vehicle while it speeds up. What is free at its speed need not be so at the plan's."""
    flight = on_a_mission("px4")
    flight.until(lambda: flight.velocity[0] > 4.9)
    plan_mps = flight.velocity[0]
    assert flight.set_mode(4, 3) == ACCEPTED
    flight.until(lambda: math.hypot(*flight.velocity[:2]) < 0.2)
    north = float(flight.world.position_ned_m[0, 0])
    flight.intruder = Emulated(9, ned_m=(north + 18.0, 2.0, -50.0))
    assert missions.start(flight) == ACCEPTED
    flight.until(lambda: flight.guard.phase is Phase.RESOLVING)
    assert math.hypot(*flight.velocity[:2]) < 0.8 * plan_mps
    flight.until(lambda: flight.engine.rung.state is State.ENGAGED)
    intruder = flight.intruder.position[:2] - flight.world.position_ned_m[0, :2]
    flight.step()
    record = flight.engine._last_record
    assert record is not None and record.own is not None
    radius_m = math.hypot(*intruder) - record.nearest_margin_m
    straight = encounters(intruder[None], np.array([[-plan_mps, 0.0]]), np.array([radius_m]))
    assert record.resumed_entry_s == pytest.approx(straight.entry_s[0], abs=0.3)
    assert record.resumed_entry_s < record.time_to_violation_s
    flight.until(lambda: flight.guard.phase is Phase.WATCHING)
    assert flight.intruder.position[0] < flight.world.position_ned_m[0, 0], "it is passed"


@pytest.mark.no_cover
def test_a_vehicle_that_brakes_for_a_pause_is_not_led_on() -> None:
    flight = on_a_mission("ardupilot")
    assert flight.command(missions.PAUSE_CONTINUE, 0) == ACCEPTED
    flight.until(lambda: flight.engine.telemetry.mission_paused)
    north = float(flight.world.position_ned_m[0, 0])
    assert math.hypot(*flight.velocity[:2]) > 3.0
    flight.intruder = Emulated(9, ned_m=(north + 80.0, 0.0, -50.0))
    flight.intruder.velocity[0] = -6.0
    flight.until(lambda: flight.guard.phase is Phase.RESOLVING)
    flight.until(lambda: flight.guard.phase is Phase.HOLDING)
    flight.until(lambda: flight.intruder is not None and flight.intruder.position[0] < north - 250.0)
    assert flight.world.position_ned_m[0, 0] == pytest.approx(north, abs=25.0)
    assert math.hypot(*flight.velocity[:2]) < 1.0


@pytest.mark.no_cover
def test_a_mission_that_the_operator_has_paused_stays_so_until_the_operator_chooses_a_mode() -> None:
    """Handed back, AUTO flew on: a change of the mode ends a pause."""
    flight = on_a_mission("ardupilot")
    assert flight.command(missions.PAUSE_CONTINUE, 0) == ACCEPTED
    flight.until(lambda: math.hypot(*flight.velocity[:2]) < 0.2)
    north = float(flight.world.position_ned_m[0, 0])
    flight.intruder = Emulated(9, ned_m=(north, -72.0, -50.0))
    flight.intruder.velocity[1] = 6.0
    flight.until(lambda: flight.guard.phase is Phase.RESOLVING)
    flight.until(lambda: flight.intruder is not None and flight.intruder.position[1] > 150.0)
    assert flight.guard.phase is Phase.HOLDING and flight.mode == GUIDED
    assert flight.engine.counters["pause_kept"] == 1
    assert flight.nearest_m > 4.0
    assert flight.world.position_ned_m[0, 0] == pytest.approx(north, abs=10.0)
    assert math.hypot(*flight.velocity[:2]) < 1.0
    assert flight.set_mode(missions.AUTO) == ACCEPTED
    flight.until(lambda: 2 in missions.reached(flight))
    assert flight.guard.phase is Phase.WATCHING


@both
def test_a_pilot_who_interrupts_has_it_until_the_operator_engages_again(flavour: str) -> None:
    flight = on_a_mission(flavour)
    cross(flight)
    flight.until(lambda: flight.guard.phase is Phase.RESOLVING)
    flight.step()
    pilots = PX4_HOLD if flavour == "px4" else missions.BRAKE
    assert (flight.set_mode(4, 3) if flavour == "px4" else flight.set_mode(missions.BRAKE)) == 0
    flight.until(lambda: flight.guard.phase is Phase.ENDED, 3.0)
    sent = len(flight.observer.setpoints)
    for _ in range(30):
        flight.step()
    assert len(flight.observer.setpoints) == sent
    assert flight.mode == pilots
    assert flight.engine.rung.reason == f"guard: ended: {CHANGED}"
    assert missions.start(flight) == 0
    flight.intruder = None
    cross_again(flight)
    for _ in range(20):
        flight.step()
    assert flight.guard.phase is Phase.ENDED
    engage(flight)
    assert flight.engine.rung.reason == "guard: watching"
    flight.until(lambda: flight.guard.phase is Phase.RESOLVING)
    rung = flight.engine.rung
    engage(flight)
    assert flight.engine.rung is rung, "it is engaged, and goes on"


def test_a_pilots_mode_is_said_not_to_be_taken_over_from() -> None:
    flight = Guarded("px4")
    for mode, said in (((4, 3), ""), ((3, 0), f": {FOREIGN_MODE}"), ((4, 3), "")):
        assert flight.set_mode(*mode) == 0
        flight.until(lambda said=said: flight.engine.rung.reason == f"guard: watching{said}", 3.0)  # type: ignore[misc]


@both
def test_an_autopilot_that_does_not_change_its_mode_is_told_of(flavour: str) -> None:
    flight = on_a_mission(flavour)
    cross(flight)
    flight.until(lambda: flight.guard.phase is Phase.TAKING_OVER)
    flight.deaf = True
    flight.until(lambda: flight.guard.phase is Phase.WATCHING, 6.0)
    flight.until(lambda: bool(flight.warnings), 1.0)
    assert flight.warnings == ["guard: the autopilot does not change its mode"]


def engage(flight: Guarded) -> None:
    """The operator engages the guard."""
    flight.engine.receive_vehicle(
        flight.client.encode("COMMAND_LONG", command=193, target_system=1, target_component=196, param1=1.0),
        flight.now_s, source=COMPANION,
    )  # fmt: skip


def cross_again(flight: Guarded) -> None:
    flight.settle()
    cross(flight)


@pytest.mark.parametrize("lost", [0, 4])
def test_a_clean_stop_in_the_middle_hands_back_whatever_is_lost(lost: int) -> None:
    flight = on_a_mission("px4")
    cross(flight)
    flight.until(lambda: flight.guard.phase is Phase.RESOLVING)
    flight.step()
    last = flight.engine.stop(flight.now_s + 0.1)
    assert [(frame[4] - last[0][4]) % 256 for frame in last] == list(range(len(last))), "a router may drop what it had"
    for k, frame in enumerate(last):
        flight.observer.watch(frame)
        if k < lost:
            continue
        flight._note(flight.autopilot.receive(frame, COMPANION, flight.now_s))
    assert flight.engine.rung.reason == "ended: the mode that the guard found is asked for"
    flight.advance(1.5)
    assert flight.mode == MISSION["px4"]
    assert [message.vx for message in flight.observer.setpoints[-3:]] == [0.0] * 3


@both
def test_a_clean_stop_before_the_mode_is_told_hands_back_as_well(flavour: str) -> None:
    flight = on_a_mission(flavour)
    cross(flight)
    flight.until(lambda: flight.guard.phase is Phase.TAKING_OVER)
    flight.lost = {"HEARTBEAT"}  # once a second, and the next one is still to come
    flight.until(lambda: DO_SET_MODE in flight.asked)
    assert flight.guard.phase is Phase.TAKING_OVER
    for frame in flight.engine.stop(flight.now_s + 0.1):
        flight.observer.watch(frame)
        flight._note(flight.autopilot.receive(frame, COMPANION, flight.now_s))
    flight.advance(1.5)
    assert flight.mode == MISSION[flavour]


@pytest.mark.no_cover
@pytest.mark.parametrize("lost", [{"GLOBAL_POSITION_INT"}, {"HEARTBEAT"}], ids=["own-state", "heartbeat"])
def test_f14_f15_an_ardupilot_that_is_steered_no_more_is_handed_back(lost: set[str]) -> None:
    """It keeps GUIDED and would hover there for ever; a PX4 leaves OFFBOARD by itself."""
    flight = on_a_mission("ardupilot")
    cross(flight)
    flight.until(lambda: flight.guard.phase is Phase.RESOLVING)
    flight.step()
    flight.lost = lost
    flight.until(lambda: flight.engine.rung.state not in STEERING)
    flight.lost = set()
    flight.intruder = None
    flight.until(lambda: flight.guard.phase is Phase.WATCHING, 10.0)
    assert flight.mode == MISSION["ardupilot"]
    assert flight.engine.rung.reason == "guard: watching"


@pytest.mark.no_cover
def test_f15_an_ardupilot_whose_link_is_lost_before_it_tells_the_mode_is_handed_back() -> None:
    flight = on_a_mission("ardupilot")
    cross(flight)
    flight.until(lambda: flight.guard.phase is Phase.TAKING_OVER)
    flight.lost = {"HEARTBEAT"}
    flight.until(lambda: DO_SET_MODE in flight.asked)
    flight.intruder = None
    heard_s = flight.now_s
    flight.until(lambda: flight.now_s > heard_s + 10.0)
    assert flight.mode == EXTERNAL_MODE[ARDUPILOT], "it hovers and waits"
    flight.lost = set()
    flight.until(lambda: flight.mode == MISSION["ardupilot"], 15.0)
    flight.until(lambda: flight.guard.phase is Phase.WATCHING, 3.0)


@pytest.mark.no_cover
def test_an_ardupilot_that_hears_nothing_for_long_is_handed_back_when_it_hears_again() -> None:
    flight = on_a_mission("ardupilot")
    flight.intruder = Emulated(9)
    flight.intruder.velocity[0] = -6.0
    for _ in range(400):
        flight.intruder.position = flight.world.position_ned_m[0] + (
            40.0,
            0.0,
            0.0,
        )  # and comes nearer, wherever it flies
        flight.step()
        flight.deaf |= flight.engine.setpoints.sent > 40
        if flight.deaf and flight.engine.rung.state not in STEERING:
            break
    assert flight.engine.rung.reason == UNHEARD and flight.guard.phase is Phase.RESOLVING
    flight.deaf, flight.intruder = False, None
    flight.until(lambda: flight.mode == MISSION["ardupilot"], 10.0)
    flight.until(lambda: flight.guard.phase is Phase.WATCHING, 3.0)


def test_i3_the_mode_of_another_vehicle_on_the_link_is_left_alone() -> None:
    flight = on_a_mission("px4")
    cross(flight)
    flight.until(lambda: flight.guard.phase is Phase.RESOLVING)
    second, sent = Emulated(2), []
    for k in range(150):  # the first one is silent from now on
        now_s = flight.now_s + 4.0 + 0.1 * k
        flight.engine.receive_vehicle(second.telemetry(now_s), now_s, source=COMPANION)
        sent += [m for frame in flight.engine.step(now_s).to_vehicle for m in messages(frame)]
    assert flight.guard.phase is Phase.ENDED and flight.engine.rung.reason.startswith("guard: ended: another vehicle")
    assert {m.command for m in sent if m.name == "COMMAND_LONG"} <= ASKED
    assert not any(m.name == "SET_POSITION_TARGET_LOCAL_NED" for m in sent)
    assert flight.engine.stop(flight.now_s + 20.0) == []


@pytest.mark.parametrize(("off_m", "interrupts"), [(4.0, False), (0.0, True)])
def test_a_climb_out_is_interrupted_for_a_mid_air_collision_only(off_m: float, interrupts: bool) -> None:
    flight = Guarded("px4", begun=Start.GROUND, takeoff_aware=True, takeoff_height_m=30.0)
    flight.advance(0.1)
    plan = [missions.item(missions.TAKEOFF, height=60.0), missions.item(north=300.0, height=60.0)]
    assert missions.upload(flight, plan) == 0
    assert flight.command(missions.ARM, 1.0) == 0
    assert missions.start(flight) == 0
    flight.until(lambda: flight.height_m > 8.0)
    flight.intruder = Emulated(9, ned_m=(START_NED_M[0] + off_m, -32.0, -20.0))
    flight.intruder.velocity[1] = 8.0
    conflicts = 0
    for _ in range(30):
        flight.step()
        assert flight.engine._last_record is not None
        conflicts += bool(flight.engine._last_record.conflicts)
    assert conflicts > 5 and flight.height_m < 30.0
    assert (flight.guard.takeovers > 0) is interrupts
