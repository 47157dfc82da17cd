"""The response models against the step responses that were measured on real autopilots.

Tolerances: t63 within 15 %, displacement within 20 % or 0.5 m, stopping distance within 20 %. Every measured row is
here; rows that a model misses carry their own tolerance and the reason.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sitl_sim.vehicle import MODELS, TICK_S, FleetDynamics, VelocityFeedback, model_for_speed

FloatArray = npt.NDArray[np.float64]
Velocity = tuple[float, float, float]

NORTH, EAST, DOWN = 0, 1, 2
SETTLE_S = 9.0
"""How long the measured runs held each setpoint."""


@dataclass(frozen=True)
class Response:
    """Velocity and displacement every tick after the change of the setpoint."""

    velocity: FloatArray
    moved: FloatArray

    def t63_s(self, axis: int, to_mps: float) -> float:
        """When 63 % of the way from the velocity at the step to ``to_mps`` has been made."""
        start = self.velocity[0, axis]
        share = (self.velocity[:, axis] - start) / (to_mps - start)
        return float(np.argmax(share >= 0.63)) * TICK_S

    def moved_at(self, *seconds: float) -> FloatArray:
        return self.moved[[round(second / TICK_S) for second in seconds]]


def respond(autopilot: str, before: Velocity, after: Velocity, duration_s: float = SETTLE_S) -> Response:
    """Hold one setpoint for as long as the measured runs did, then change it."""
    fleet = FleetDynamics([autopilot], [[0.0, 0.0, -100.0]])
    fleet.step([before], SETTLE_S if any(before) else 0.0, [True])
    start = fleet.position_ned_m.copy()
    velocity, moved = [fleet.velocity_ned_mps[0].copy()], [np.zeros(3)]
    for _ in range(round(duration_s / TICK_S)):
        fleet.step([after], TICK_S, [True])
        velocity.append(fleet.velocity_ned_mps[0].copy())
        moved.append((fleet.position_ned_m - start)[0])
    return Response(np.array(velocity), np.array(moved))


# name, setpoint before and after, axis and its target, measured t63 of ArduPilot and PX4 (None: clipped, see limits)
STEPS = [
    ("0 -> 2", (0, 0, 0), (2, 0, 0), NORTH, 2.0, 0.87, 0.97),
    ("0 -> 5", (0, 0, 0), (5, 0, 0), NORTH, 5.0, 1.60, 0.96),
    ("0 -> 10", (0, 0, 0), (10, 0, 0), NORTH, 10.0, 2.92, 1.36),
    ("5 -> 0", (5, 0, 0), (0, 0, 0), NORTH, 0.0, 1.61, 0.76),
    ("10 -> 0", (10, 0, 0), (0, 0, 0), NORTH, 0.0, 2.95, 0.88),
    ("-5 -> 5", (-5, 0, 0), (5, 0, 0), NORTH, 5.0, 2.86, 1.02),
    ("90 degree turn", (5, 0, 0), (0, 5, 0), EAST, 5.0, 2.15, 0.87),
    ("dodge 3 west", (0, 0, 0), (0, -3, 0), EAST, -3.0, 1.04, 1.32),
    ("up 1", (0, 0, 0), (0, 0, -1), DOWN, -1.0, 0.79, 0.38),
    ("up 3", (0, 0, 0), (0, 0, -3), DOWN, -3.0, 1.99, 0.31),
    ("down 1", (0, 0, 0), (0, 0, 1), DOWN, 1.0, 0.81, 0.31),
    ("down 3", (0, 0, 0), (0, 0, 3), DOWN, 3.0, 1.85, None),
]

T63_TOLERANCE = {
    # the measured dodge came later than 0 -> 2 and 0 -> 5 in the same aircraft; a model linear below its tilt limit
    # answers all three alike, and follows the two that agree
    ("px4", "dodge 3 west"): 0.35,
    # 0.10 s of difference; up 3 with the same gains is met exactly
    ("px4", "up 1"): 0.30,
    # the measured step exceeded its own acceleration limit (2.7 m/s^2 against 1.0): gravity helps
    ("ardupilot", "down 3"): 0.17,
}


STEPS_OF_EACH = [
    pytest.param(autopilot, *row[:5], measured_s, id=f"{autopilot} {row[0]}")
    for row in STEPS
    for autopilot, measured_s in (("ardupilot", row[5]), ("px4", row[6]))
    if measured_s is not None
]


@pytest.mark.parametrize("autopilot, name, before, after, axis, to_mps, measured_s", STEPS_OF_EACH)
def test_time_to_63_percent_is_as_measured(
    autopilot: str,
    name: str,
    before: Velocity,
    after: Velocity,
    axis: int,
    to_mps: float,
    measured_s: float,
) -> None:
    modelled_s = respond(autopilot, before, after).t63_s(axis, to_mps)
    assert modelled_s == pytest.approx(measured_s, rel=T63_TOLERANCE.get((autopilot, name), 0.15))


# metres against the old path 1, 2, 3, 4, 5 s after the step
DISPLACEMENTS = [
    ("dodge 3 west", (0, 0, 0), (0, -3, 0), (0.5, 3.0, 5.9, 9.0, 11.9), (0.5, 2.3, 4.3, 6.5, 8.7)),
    ("0 -> 5", (0, 0, 0), (5, 0, 0), (0.6, 3.4, 8.0, 13.0, 18.1), (1.6, 5.1, 8.9, 13.0, 16.2)),
    ("90 degree turn", (5, 0, 0), (0, 5, 0), (0.6, 3.4, 8.8, 15.6, 22.7), (2.5, 7.8, 13.5, 19.5, 25.7)),
    ("up 1", (0, 0, 0), (0, 0, -1), (0.3, 1.4, 2.4, 3.4, 4.4), (0.7, 1.7, 2.6, 3.5, 4.5)),
    ("up 3", (0, 0, 0), (0, 0, -3), (0.3, 1.7, 4.2, 7.2, 10.2), (1.9, 4.6, 7.4, 10.3, 13.2)),
]


@pytest.mark.parametrize("autopilot", ["ardupilot", "px4"])
@pytest.mark.parametrize(
    "name, before, after, ardupilot_m, px4_m", DISPLACEMENTS, ids=[row[0] for row in DISPLACEMENTS]
)
def test_displacement_against_the_old_path_is_as_measured(
    autopilot: str,
    name: str,
    before: Velocity,
    after: Velocity,
    ardupilot_m: tuple[float, ...],
    px4_m: tuple[float, ...],
) -> None:
    seconds = np.arange(1.0, 6.0)
    response = respond(autopilot, before, after)
    old_path = response.velocity[0] * seconds[:, None]
    modelled_m = np.linalg.norm(response.moved_at(*seconds) - old_path, axis=1)
    measured_m = np.array(ardupilot_m if autopilot == "ardupilot" else px4_m)
    # the same late dodge as above: the model is ahead of the aircraft by 0.6 m after 1 s and by 1.8 m after 5 s
    relative, absolute = (0.30, 1.0) if (autopilot, name) == ("px4", "dodge 3 west") else (0.20, 0.5)
    assert np.all(np.abs(modelled_m - measured_m) <= np.maximum(relative * measured_m, absolute)), modelled_m


@pytest.mark.parametrize(
    "autopilot, from_mps, measured_m",
    [
        ("ardupilot", 2.0, 1.8),
        ("ardupilot", 3.0, 3.0),
        ("ardupilot", 5.0, 7.0),
        ("ardupilot", 10.0, 23.8),
        ("px4", 2.0, 3.6),
        ("px4", 5.0, 8.8),  # measured between 7.9 and 9.7
        # within the 9 s that were recorded; given 25 s the model creeps on to 20.8 m while its integrator unwinds
        ("px4", 10.0, 17.2),
    ],
)
def test_stopping_distance_is_as_measured(autopilot: str, from_mps: float, measured_m: float) -> None:
    stop = respond(autopilot, (from_mps, 0.0, 0.0), (0.0, 0.0, 0.0))
    assert stop.moved[-1, NORTH] == pytest.approx(measured_m, rel=0.20)


def test_px4_is_short_of_its_setpoint_for_seconds_and_ardupilot_is_not() -> None:
    px4, ardupilot = (respond(name, (0, 0, 0), (5, 0, 0)).velocity[-1, NORTH] / 5.0 for name in ("px4", "ardupilot"))
    assert px4 == pytest.approx(0.88, abs=0.05)  # measured 0.88 as the mean of the last 2 s
    assert ardupilot == pytest.approx(1.0, abs=0.005)


def test_first_second_of_ardupilot_does_not_depend_on_the_step() -> None:
    moved = [respond("ardupilot", (0, 0, 0), (speed, 0, 0), 1.0).moved[-1, NORTH] for speed in (3.0, 5.0, 10.0)]
    assert moved == pytest.approx([0.55] * 3, abs=0.08)  # measured 0.55 m whatever the step: jerk-limited


@pytest.mark.parametrize(
    "autopilot, command, axis, limit_mps",
    [
        ("px4", (0.0, 0.0, 3.0), DOWN, 1.5),  # MPC_Z_VEL_MAX_DN
        ("px4", (0.0, 0.0, -9.0), DOWN, -3.0),
        ("px4", (15.0, 0.0, 0.0), NORTH, 9.9),  # measured 10.0: tilt against drag before the clip at 12
        ("ardupilot", (15.0, 0.0, 0.0), NORTH, 10.2),  # measured: lean angle at its limit
        ("ideal", (100.0, 0.0, 0.0), NORTH, 60.0),
    ],
)
def test_limits_of_speed_hold(autopilot: str, command: Velocity, axis: int, limit_mps: float) -> None:
    reached = respond(autopilot, (0.0, 0.0, 0.0), command, 30.0).velocity[-1, axis]
    assert reached == pytest.approx(limit_mps, rel=0.03)


def test_ideal_vehicle_flies_the_command_at_once() -> None:
    response = respond("ideal", (0.0, 0.0, 0.0), (3.0, -4.0, 1.0), 0.1)
    assert response.velocity[1] == pytest.approx([3.0, -4.0, 1.0])


def test_a_fleet_of_different_autopilots_flies_like_each_alone() -> None:
    names = ["px4", "ideal", "ardupilot", "px4"]
    commands = np.array([[5.0, 0, 0], [0, 5.0, 0], [-3.0, 1, -1], [0, 0, 1.0]])
    together = FleetDynamics(names, np.zeros((4, 3)))
    together.step(commands, 3.0, [True] * 4)
    for index, name in enumerate(names):
        alone = FleetDynamics([name], np.zeros((1, 3)))
        alone.step(commands[index : index + 1], 3.0, [True])
        assert together.position_ned_m[index] == pytest.approx(alone.position_ned_m[0], abs=1e-12)


def test_who_is_not_airborne_stands_still_and_starts_afresh() -> None:
    fleet = FleetDynamics(["px4", "ardupilot"], np.zeros((2, 3)))
    fleet.step([[5.0, 0, 0]] * 2, 4.0, [True, True])
    stood_at = fleet.position_ned_m.copy()
    fleet.step([[5.0, 0, 0]] * 2, 1.0, [False, False])
    assert np.array_equal(fleet.position_ned_m, stood_at)
    assert not np.any(fleet.velocity_ned_mps)
    fleet.step([[0.0, 0, 0]] * 2, 1.0, [True, True])
    assert fleet.position_ned_m == pytest.approx(stood_at, abs=1e-9)


@pytest.mark.parametrize("autopilot", list(MODELS))
def test_reset_to_a_steady_flight_goes_on_steadily(autopilot: str) -> None:
    fleet = FleetDynamics([autopilot, autopilot], np.zeros((2, 3)))
    fleet.reset(1, [10.0, 20.0, -30.0], [4.0, 3.0, 0.0])
    fleet.step([[0.0, 0, 0], [4.0, 3.0, 0.0]], 2.0, [True, True])
    assert fleet.position_ned_m[1] == pytest.approx([18.0, 26.0, -30.0], abs=1e-6)
    assert not np.any(fleet.position_ned_m[0])


def test_a_faster_cruise_than_measured_is_reachable() -> None:
    model = model_for_speed("px4", 30.0)
    assert isinstance(model, VelocityFeedback)
    fleet = FleetDynamics([model], np.zeros((1, 3)))
    fleet.step([[30.0, 0.0, 0.0]], 30.0, [True])
    assert fleet.velocity_ned_mps[0, NORTH] > 27.0


@pytest.mark.parametrize(
    "bad", [{"dt_s": 0.03}, {"dt_s": -0.02}, {"command_velocity_ned_mps": [[float("nan"), 0.0, 0.0]]}]
)
def test_impossible_steps_are_refused(bad: dict[str, object]) -> None:
    fleet = FleetDynamics(["px4"], np.zeros((1, 3)))
    good: dict[str, object] = {"command_velocity_ned_mps": [[1.0, 0, 0]], "dt_s": 0.02, "airborne": [True]}
    with pytest.raises(ValueError):
        fleet.step(**(good | bad))  # type: ignore[arg-type]


def test_unknown_autopilot_names_the_known_ones() -> None:
    with pytest.raises(ValueError, match="ideal, px4, ardupilot"):
        FleetDynamics(["betaflight"], np.zeros((1, 3)))


@settings(max_examples=25, deadline=None)
@given(
    autopilot=st.sampled_from(sorted(MODELS)),
    commands=st.lists(st.tuples(*[st.floats(-200.0, 200.0)] * 3), min_size=1, max_size=6),
)
def test_whatever_is_commanded_the_motion_stays_bounded_and_continuous(
    autopilot: str, commands: list[Velocity]
) -> None:
    fleet = FleetDynamics([autopilot], np.zeros((1, 3)))
    for command in commands:
        for _ in range(10):
            before = fleet.position_ned_m.copy()
            fleet.step([command], TICK_S, [True])
            assert np.all(np.isfinite(fleet.position_ned_m))
            assert np.linalg.norm(fleet.velocity_ned_mps) <= MODELS[autopilot].speed_limit_mps * 1.2 + 10.0
            assert np.linalg.norm(fleet.position_ned_m - before) <= 80.0 * TICK_S
