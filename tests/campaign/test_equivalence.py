"""One flight, two drivers: the campaign's kernels, and engines that hear and say nothing but MAVLink.

A run is flown by the kernels. At every instant each vehicle's engine gets the bytes that its autopilot and the others
would have sent, in memory, and its setpoint is held against the velocity that the kernels chose from the same picture.
The engines fly nothing themselves: else the first rounded centimetre would make two different flights of one.

The way to the goal is flown by the true position in a campaign, so each engine is told a goal that is off by its error.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from ridlink.avoidance.settings import HalfplaneSettings
from ridlink.campaign.chance import ErrorModel
from ridlink.campaign.flight import fly
from ridlink.campaign.plan import IDEAL_HALFPLANES, Plan
from ridlink.campaign.scene import Scene, circle
from ridlink.campaign.worlds import Instant
from ridlink.engine import Engine, EngineConfig, Goal
from ridlink.geodesy import moved
from ridlink.separation import Definition
from ridlink.setpoint import VelocityLimits
from tests.daemon.emulated import HOME, Emulated
from tests.daemon.invariants import messages

SIGMA_M, AIRFRAME_M, SPEED_MPS = 3.0, 0.6, 10.0
"""Three sigma are whole decimetres, an airframe whole centimetres: what is rounded are places and velocities."""

LIMITS = VelocityLimits(horizontal_mps=20.0, acceleration_mps2=1e4)
"""The last step before the wire limits how fast a setpoint may change; a campaign has no such step."""


class Pair:
    """A vehicle's voice and its engine."""

    def __init__(self, number: int, plan: Plan) -> None:
        self.vehicle = Emulated(number + 1, error_m=3.0 * SIGMA_M, airframe_m=AIRFRAME_M)
        self.engine = Engine(
            EngineConfig(
                goal=Goal(HOME.latitude_deg, HOME.longitude_deg), definition=plan.definition, cruise_mps=SPEED_MPS,
                airframe_m=AIRFRAME_M, limits=LIMITS, vehicle_sysid=number + 1, filter_positions=False,
                halfplane=plan.settings,
            )
        )  # fmt: skip


def differences_of(plan: Plan, run: int) -> np.ndarray:
    """Engine's setpoint less the kernels' command, at every decision of a run [m/s]."""
    pairs = [Pair(k, plan) for k in range(len(plan.scene))]
    differences: list[float] = []

    def watch(instant: Instant) -> None:
        present = np.flatnonzero(instant.present[0]).tolist()
        heard = {}
        for k in present:
            vehicle = pairs[k].vehicle
            vehicle.position[:2], vehicle.velocity[:2] = instant.reported_ne_m[0, k], instant.velocity_ne_mps[0, k]
            command = (*last[k].tolist(), 0.0)
            heard[k] = vehicle.remote_id(instant.now_s, command=command)
        for k in present:
            engine = pairs[k].engine
            engine.receive_vehicle(pairs[k].vehicle.telemetry(instant.now_s), instant.now_s, source="autopilot")
            for other in present:
                if other != k:
                    engine.receive_remote_id(heard[other], instant.now_s, source="air")
            goal = plan.scene.goal_ne_m[k] + instant.reported_ne_m[0, k] - instant.position_ne_m[0, k]
            engine.goal = Goal(*moved(HOME.latitude_deg, HOME.longitude_deg, *goal.tolist()))
            # What was sent last is what the vehicle was told last, in both.
            engine.setpoints.velocity = (*last[k].tolist(), 0.0)
            output = engine.step(instant.now_s)
            (setpoint,) = (
                message
                for frame in output.to_vehicle
                for message in messages(frame)
                if message.name == "SET_POSITION_TARGET_LOCAL_NED"
            )
            sent = np.array([setpoint.vx, setpoint.vy])
            if instant.now_s > 0.05:  # the stream begins with a stop
                differences.append(math.hypot(*(sent - instant.command_ne_mps[0, k])))
        last[:] = instant.command_ne_mps[0]

    last = np.zeros((len(plan.scene), 2))
    course = plan.scene.goal_ne_m - plan.scene.start_ne_m
    last[:] = SPEED_MPS * course / np.hypot(*course.T)[:, None]
    fly(plan, range(run, run + 1), watch=watch)
    return np.array(differences)


def scene(flown: Scene) -> Scene:
    count = len(flown)
    return replace(flown, speed_mps=np.full(count, SPEED_MPS), airframe_m=np.full(count, AIRFRAME_M))


def plan_of(dynamics: str, definition: Definition = Definition.CANDIDATE2, count: int = 6) -> Plan:
    settings = IDEAL_HALFPLANES if dynamics == "ideal" else HalfplaneSettings()
    return Plan(scene(circle(count)), definition, settings, ErrorModel.GAUSS_MARKOV, SIGMA_M, dynamics=dynamics)


@pytest.mark.parametrize("dynamics", ["ideal", "px4", "ardupilot"])
def test_setpoints_of_engines_are_those_of_the_kernels_but_for_what_the_wire_rounds(dynamics: str) -> None:
    off = differences_of(plan_of(dynamics), 0)
    assert len(off) > 800
    assert np.median(off) < 0.003, "a centimetre per second is what velocities are rounded to"
    assert np.percentile(off, 90) < 0.01
    assert np.mean(off > 0.1) < 0.05, "where a side is chosen by a hair, the choice lasts"


def main() -> None:
    """What quantisation costs in the circle of eight, for the documentation."""
    for dynamics in ("ideal", "px4", "ardupilot"):
        for definition in (Definition.CANDIDATE2, Definition.CHANCE):
            off = np.concatenate([differences_of(plan_of(dynamics, definition, 8), run) for run in range(8)])
            shares = "/".join(f"{np.percentile(off, share):.4f}" for share in (50, 90, 99, 100))
            print(f"{dynamics} {definition}: {len(off)} setpoints, 50/90/99/100 % {shares} m/s, "
                  f"above 0.1 m/s {np.mean(off > 0.1):.2%}", flush=True)  # fmt: skip


if __name__ == "__main__":
    main()
