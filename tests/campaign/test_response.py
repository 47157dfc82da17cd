"""Campaigns and the emulator fly the same vehicles."""

import numpy as np
import pytest

from ridlink.campaign.response import Dynamics, Response
from sitl_sim.vehicle import FleetDynamics, model_for_speed


@pytest.mark.parametrize("dynamics", list(Dynamics))
@pytest.mark.parametrize("cruise_mps", [5.0, 10.0, 30.0])
def test_the_emulators_vehicles_fly_alike(dynamics, cruise_mps):
    random = np.random.default_rng(4)
    shape = (3, 2)
    velocity = random.uniform(-5.0, 5.0, (*shape, 2))
    position = np.zeros((*shape, 2))
    response = Response(dynamics, velocity, np.full(shape, cruise_mps))
    model = model_for_speed(dynamics.value, cruise_mps)
    start = np.concatenate([velocity.reshape(6, 2), np.zeros((6, 1))], axis=1)
    fleet = FleetDynamics([model] * 6, np.zeros((6, 3)), start)
    for _ in range(40):
        command = random.uniform(-1.3, 1.3, (*shape, 2)) * cruise_mps
        response.advance(position, velocity, command, 0.1)
        sent = np.concatenate([command.reshape(6, 2), np.zeros((6, 1))], axis=1)
        fleet.step(sent, 0.1, np.ones(6, bool))
        assert velocity.reshape(6, 2) == pytest.approx(fleet.velocity_ned_mps[:, :2], abs=1e-9)
        assert position.reshape(6, 2) == pytest.approx(fleet.position_ned_m[:, :2], abs=1e-7)


def test_worlds_that_are_over_leave_the_others_as_they_are():
    shape = (3, 2)
    velocity, command = np.zeros((*shape, 2)), np.random.default_rng(1).uniform(-9.0, 9.0, (*shape, 2))
    together, alone = Response(Dynamics.PX4, velocity, np.ones(shape)), Response(Dynamics.PX4, velocity, np.ones(shape))
    flown = [(np.zeros((*shape, 2)), np.zeros((*shape, 2))) for _ in range(2)]
    together.advance(*flown[0], command, 1.0)
    alone.advance(*flown[1], command, 0.5)
    kept = np.array([False, True, True])
    alone.keep(kept)
    position, speed = (part[kept] for part in flown[1])
    alone.advance(position, speed, command[kept], 0.5)
    assert np.array_equal(position, flown[0][0][kept])
    assert np.array_equal(speed, flown[0][1][kept])


def test_time_that_is_no_number_of_ticks_is_refused():
    still = np.zeros((1, 1, 2))
    with pytest.raises(ValueError, match=r"multiple of 0\.02"):
        Response(Dynamics.PX4, still, np.ones((1, 1))).advance(still, still, still, 0.03)
