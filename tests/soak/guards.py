"""Fleets in virtual time whose autopilots fly missions of their own, with a guard beside each vehicle.

    python -m tests.soak.guards [--flights 150] [--seed 1]

Two to five vehicles, PX4s and ArduPilots, with errors of 2 cm to 3.5 m and up to four waypoints at random places, all
at one height and at once. They hear nothing but each other's guards; in a third of the flights 30 % of that is lost.
Ends with 1 if two vehicles collided or a decision failed. A mission may have no end: the place of another vehicle that
has come to its own end may be too near a waypoint. Such flights are counted.
"""

from __future__ import annotations

import argparse
import math
import random
import sys
from dataclasses import dataclass

from ridlink.avoidance.solver import warm_up
from ridlink.avoidance.types import SolverKind
from ridlink.campaign.statistics import clopper_pearson
from ridlink.engine import Engine, EngineConfig
from ridlink.engine.guard import Phase
from ridlink.geodesy import geodetic_from_ned
from ridlink.mavlink.codec import CRC_EXTRAS, Encoder, Message, decode_message
from ridlink.mavlink.frames import Frame, parse_datagram
from ridlink.scenario import Scenario, VehicleSpec
from sitl_sim.autopilot import Autopilot, FleetNavigation, Start
from sitl_sim.vehicle import TICK_S
from sitl_sim.world import World
from tests.sitl_sim.flight import COMPANION, GROUND_STATION, HOME, SET_MODE, UTC_S
from tests.sitl_sim.missions import AUTO, SPEED, WAYPOINT

HEIGHT_M = 50.0
APART_M = 45.0
"""Starts from each other, and last waypoints from each other."""
FAR_AWAY_M = 1e4
"""North of the goal that the emulator knows of, which is not to be reached: it lands who is at his goal."""
LOSS = 0.3
STEP_S = 0.1
HEARD_STEPS = 10
"""After which the guards have heard of each other, and the missions begin."""
SETTLED_S = 5.0
PATIENCE_S = 150.0
"""Beyond three times what the longest mission would take alone."""
OF_MISSIONS = {40, 46, 47, 51, 77}
"""MISSION_REQUEST, MISSION_ITEM_REACHED, MISSION_ACK, MISSION_REQUEST_INT, COMMAND_ACK."""

Place = tuple[float, float]


@dataclass(frozen=True)
class Planned:
    """One vehicle and its mission: places north and east [m], speed [m/s] if the mission sets one."""

    start: Place
    way: tuple[Place, ...]
    autopilot: str
    speed_mps: float | None
    airframe_m: float
    sigma_m: float

    @property
    def alone_s(self) -> float:
        """How long the mission takes alone, about."""
        return sum(map(math.dist, (self.start, *self.way), self.way)) / (self.speed_mps or 5.0)

    @property
    def spec(self) -> VehicleSpec:
        """The vehicle for the emulator."""
        return VehicleSpec(
            start_ned_m=(*self.start, -HEIGHT_M),
            goal_ned_m=(self.start[0] + FAR_AWAY_M, self.start[1], -HEIGHT_M),
            airframe_m=self.airframe_m,
            sigma_m=self.sigma_m,
            autopilot=self.autopilot,
        )


@dataclass(frozen=True)
class Flown:
    """What a flight came to."""

    vehicles: int
    finished: int
    macs: int
    nearest_m: float
    takeovers: int
    failed: int

    def __str__(self) -> str:
        return (
            f"missions ended {self.finished}/{self.vehicles}, MACs {self.macs}, nearest {self.nearest_m:.1f} m, "
            f"takeovers {self.takeovers}"
        )


def planned(draw: random.Random) -> list[Planned]:
    """A fleet at random."""
    reach_m = draw.choice([60.0, 60.0, 90.0])

    def anywhere() -> Place:
        return draw.uniform(-reach_m, reach_m), draw.uniform(-reach_m, reach_m)

    def apart(count: int) -> list[Place]:
        while True:
            places = [anywhere() for _ in range(count)]
            if all(math.dist(a, b) > APART_M for k, a in enumerate(places) for b in places[:k]):
                return places

    count = draw.choice([2, 2, 3, 4, 5])
    return [
        Planned(
            start,
            (*(anywhere() for _ in range(draw.choice([0, 0, 1, 2, 3]))), end),
            draw.choice(["px4", "ardupilot"]),
            draw.choice([None, 3.0, 5.0, 8.0]),
            draw.choice([0.3, 0.6, 1.0, 2.0]),
            draw.choice([0.02, 0.3, 1.0, 3.5]),
        )
        for start, end in zip(apart(count), apart(count), strict=True)
    ]


class Guarded:
    """A vehicle with its guard, and the ground station that gives it the mission."""

    def __init__(self, world: World, index: int, navigation: FleetNavigation, plan: Planned) -> None:
        self.plan = plan
        self.autopilot = Autopilot(
            world,
            index,
            navigation,
            flavour=plan.autopilot,
            utc_clock=lambda: UTC_S,
            start=Start.HOLDING,
            companion=COMPANION,
        )
        self.engine = Engine(EngineConfig(guard=True, airframe_m=plan.airframe_m, broadcast=True, uas_id=f"G{index}"))
        self._target = {"target_system": index + 1, "target_component": 1}
        self._items = self._planned_items()
        self._station = Encoder(255, 190)
        self._reached: set[int] = set()

    @property
    def is_done(self) -> bool:
        """Whether it has been at its last waypoint, and its guard wants nothing."""
        assert self.engine.guard is not None
        return len(self._items) - 1 in self._reached and self.engine.guard.phase is Phase.WATCHING

    def _planned_items(self) -> list[dict[str, float]]:
        items: list[dict[str, float]] = [] if self.plan.autopilot == "px4" else [{"command": WAYPOINT, "frame": 0}]
        if self.plan.speed_mps is not None:
            items.append({"command": SPEED, "frame": 2, "param1": 1.0, "param2": self.plan.speed_mps})
        for place in self.plan.way:
            latitude, longitude, _ = geodetic_from_ned((*place, 0.0), HOME)
            degrees = {"x": round(float(latitude) * 1e7), "y": round(float(longitude) * 1e7)}
            items.append({"command": WAYPOINT, "frame": 3, "z": HEIGHT_M, **degrees})
        return items

    def hear(self, outgoing: list[tuple[bytes, tuple[str, int]]], now_s: float) -> list[Message]:
        """Take what the autopilot sends; what concerns its mission."""
        heard = []
        for datagram, address in outgoing:
            if address == COMPANION:
                self.engine.receive_vehicle(datagram, now_s, source=COMPANION)
            for frame in parse_datagram(datagram, CRC_EXTRAS):
                if isinstance(frame, Frame) and frame.msgid in OF_MISSIONS:
                    heard.append(decode_message(frame))
        self._reached |= {message.seq for message in heard if message.name == "MISSION_ITEM_REACHED"}
        return heard

    def _ask(self, name: str, now_s: float, **fields: float) -> Message:
        frame = self._station.encode(name, **self._target, **fields)
        return self.hear(self.autopilot.receive(frame, GROUND_STATION, now_s), now_s)[-1]

    def begin(self, now_s: float) -> None:
        """Write the mission and start it."""
        answer = self._ask("MISSION_COUNT", now_s, count=len(self._items))
        while answer.name.startswith("MISSION_REQUEST"):
            item = self._items[answer.seq]
            answer = self._ask("MISSION_ITEM_INT", now_s, seq=answer.seq, autocontinue=1, **item)
        assert (answer.name, answer.type) == ("MISSION_ACK", 0)
        mode = {"param2": 4.0, "param3": 4.0} if self.plan.autopilot == "px4" else {"param2": float(AUTO)}
        assert self._ask("COMMAND_LONG", now_s, command=SET_MODE, param1=1.0, **mode).result == 0

    def step(self, now_s: float) -> list[bytes]:
        """Let the guard decide; what it sends to others."""
        output = self.engine.step(now_s, utc_s=UTC_S + now_s)
        for frame in output.to_vehicle:
            self.hear(self.autopilot.receive(frame, COMPANION, now_s), now_s)
        return [*output.to_air, *output.broadcasts]


def fly(plans: list[Planned], seed: int, loss: float = 0.0) -> Flown:
    """One flight of a fleet; `loss` is the share of what is heard on the air that is lost."""
    draw = random.Random(seed)
    scenario = Scenario("missions", 1e6, tuple(plan.spec for plan in plans))
    world = World(scenario, autopilot="px4", gnss="gauss-markov", seed=seed, airborne=True)
    navigation = FleetNavigation(world, HOME)
    fleet = [Guarded(world, index, navigation, plan) for index, plan in enumerate(plans)]
    now_s, settled_s = 1000.0, 0.0
    patience_s = 3.0 * max(plan.alone_s for plan in plans) + PATIENCE_S
    for step in range(round(patience_s / STEP_S)):
        for _ in range(round(STEP_S / TICK_S)):
            world.step(TICK_S)
            now_s += TICK_S
            navigation.refresh()
            for each in fleet:
                each.hear(each.autopilot.tick(now_s), now_s)
        for each in fleet:
            for datagram in each.step(now_s):
                for other in fleet:
                    if other is not each and draw.random() >= loss:
                        other.engine.receive_remote_id(datagram, now_s, source=each, utc_s=UTC_S + now_s)
        if step == HEARD_STEPS:
            for each in fleet:
                each.begin(now_s)
        settled_s = settled_s + STEP_S if all(each.is_done for each in fleet) else 0.0
        if settled_s >= SETTLED_S:
            break
    verdict = world.verdict()
    return Flown(
        len(fleet),
        sum(each.is_done for each in fleet),
        verdict.macs,
        verdict.min_separation_m or math.inf,
        sum(each.engine.guard.takeovers for each in fleet if each.engine.guard is not None),
        sum(each.engine.counters["decision_failed"] for each in fleet),
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--flights", type=int, default=150)
    parser.add_argument("--seed", type=int, default=1, help="of the first flight")
    asked = parser.parse_args()
    warm_up(SolverKind.HALFPLANE)
    flown = []
    for seed in range(asked.seed, asked.seed + asked.flights):
        draw = random.Random(seed)
        flown.append(fly(planned(draw), seed, draw.choice([0.0, 0.0, LOSS])))
        print(f"seed {seed}: {flown[-1]}", flush=True)
    collided = sum(each.macs > 0 for each in flown)
    _, most = clopper_pearson(collided, len(flown))
    print(
        f"{len(flown)} flights with {sum(each.takeovers for each in flown)} takeovers, {collided} with a MAC "
        f"(at most {most:.1%} with 95 % confidence), "
        f"{sum(each.finished == each.vehicles for each in flown)} with all missions ended, "
        f"nearest {min((each.nearest_m for each in flown), default=math.inf):.1f} m"
    )
    return int(any(each.macs or each.failed for each in flown))


if __name__ == "__main__":
    sys.exit(main())
