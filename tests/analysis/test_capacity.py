"""The gas model against closed forms and against a simulation that knows nothing of it."""

import math

import numpy as np
import pytest

from ridlink.analysis.capacity import Airspace, capacities, gas_model, simulate_gas, students_t
from ridlink.separation.definitions import Definition


def airspace(definition=Definition.SNMAC, sigma_m=10.0, interval_s=0.1, category=3, eta=0.999):
    return Airspace(definition, sigma_m, interval_s, category, eta)


def mean_relative_speed(one_mps, other_mps):
    """Over all headings: `2/pi (v1 + v2) E(k)`, `k^2 = 4 v1 v2 / (v1 + v2)^2`, the complete elliptic integral of the
    second kind by the arithmetic-geometric mean (Abramowitz and Stegun 17.6)."""
    a, b = 1.0, abs(one_mps - other_mps) / (one_mps + other_mps)
    c_2, power, total = 1.0 - b * b, 0.5, 0.0
    while c_2 > 1e-15:
        total += power * c_2
        a, b, c = (a + b) / 2.0, math.sqrt(a * b), (a - b) / 2.0
        c_2, power = c * c, 2.0 * power
    return 2.0 / math.pi * (one_mps + other_mps) * math.pi / (2.0 * a) * (1.0 - total)


def test_a_fixed_disc_has_the_closed_form_of_a_gas():
    """R does not depend on speeds, so that a flight hour has 2 n R E[w]."""
    gas = gas_model(airspace())
    assert mean_relative_speed(10.0, 10.0 + 1e-9) == pytest.approx(40.0 / math.pi, rel=1e-6)
    speeds = airspace().speed.quantile((np.arange(40) + 0.5) / 40)
    expected = np.mean([[mean_relative_speed(v, w + 1e-9) for v in speeds] for w in speeds])
    assert gas.radius_m == 15.0
    assert gas.relative_speed_mps == pytest.approx(expected, rel=2e-3)
    assert gas.swept_m2ps == pytest.approx(2.0 * 15.0 * gas.relative_speed_mps)
    assert gas.conflicts_per_flight_hour(2.0) == pytest.approx(2.0 * gas.conflicts_per_flight_hour(1.0))
    assert gas.conflicts_per_km2_hour(2.0) == pytest.approx(gas.conflicts_per_flight_hour(2.0))
    assert gas.macs_per_flight_hour(1.0) == pytest.approx(gas.conflicts_per_flight_hour(1.0) * 3.8 / 15.0)


def test_as_many_fit_as_in_the_densest_packing():
    gas = gas_model(airspace())
    cell_m2 = math.sqrt(3.0) / 2.0 * 15.0**2
    assert gas.packed_per_km2 == pytest.approx(1e6 / cell_m2)
    assert gas.conflicts_per_flight_hour(gas.density_per_km2(1.0)) == pytest.approx(1.0)
    assert gas.density_per_km2(1e9) == gas.packed_per_km2


@pytest.mark.parametrize(
    ("definition", "category", "interval_s", "density"),
    [("snmac", 3, 0.1, 100.0), ("candidate2", 1, 1.0, 40.0), ("chance", 4, 0.1, 5.0), ("remote-id", 2, 0.5, 80.0)],
)
def test_what_is_simulated_is_what_the_formula_says(definition, category, interval_s, density):
    found = airspace(Definition(definition), 10.0, interval_s, category)
    said = gas_model(found).conflicts_per_flight_hour(density)
    simulated = simulate_gas(found, density, np.random.default_rng(11), worlds=120)
    low, high = simulated.ci95
    half = (high - low) / 2.0
    assert half < 0.1 * said
    # three standard errors: a wrong factor of any kind is further away
    assert abs(simulated.conflicts_per_flight_hour - said) < 1.55 * half
    assert simulated.radius_quantile_m >= gas_model(found).radius_m - 1e-9


def test_a_larger_error_a_longer_interval_and_a_faster_category_leave_less_room():
    def room(**changed):
        return gas_model(airspace(Definition.CANDIDATE2, **changed)).density_per_km2(1.0)

    assert room(sigma_m=1.9) > room(sigma_m=3.5) > room(sigma_m=10.0)
    assert room(interval_s=0.1) > room(interval_s=1.0) > room(interval_s=3.0)
    assert room(category=2) > room(category=1) > room(category=3) > room(category=4)
    order = ("snmac", "chance", "candidate2", "candidate1", "odid-accuracy", "remote-id")
    rooms = [gas_model(airspace(Definition(name))).density_per_km2(1.0) for name in order]
    assert rooms == sorted(rooms, reverse=True)


def test_what_is_no_airspace_is_refused():
    with pytest.raises(ValueError, match="sigma_m must be finite"):
        airspace(sigma_m=-1.0)
    with pytest.raises(ValueError, match="category must be one of 1, 2, 3, 4, got 5"):
        airspace(category=5)
    with pytest.raises(ValueError, match="density_per_km2"):
        simulate_gas(airspace(), 0.0, np.random.default_rng(1))
    with pytest.raises(ValueError, match="worlds"):
        simulate_gas(airspace(), 1.0, np.random.default_rng(1), worlds=1)
    with pytest.raises(ValueError, match=r"no room for 200 vehicles 90.6 m apart \(remote-id\): at most 141 fit"):
        list(capacities([airspace(Definition.REMOTE_ID)], 200.0, 1.0, 1, 2))


def test_no_conflict_in_few_worlds_is_no_proof_of_none():
    """The spread of nothing is nothing; the interval was a point that did not hold the formula's rate."""
    rare, density = airspace(), 0.001
    simulated = simulate_gas(rare, density, np.random.default_rng(1), worlds=2)
    low, high = simulated.ci95
    assert (simulated.conflicts, low) == (0, 0.0)
    assert gas_model(rare).conflicts_per_flight_hour(density) < high < 1.0


def test_so_few_worlds_have_no_interval_and_six_have_one_as_wide_as_it_must_be():
    """1.96 standard errors of two worlds hold the rate in 69 % of the cases, of six in 88 %."""
    assert simulate_gas(airspace(), 1.0, np.random.default_rng(1), worlds=5).ci95 is None
    wide = airspace(Definition.CANDIDATE2)
    said, random = gas_model(wide).conflicts_per_flight_hour(1.0), np.random.default_rng(3)
    intervals = [simulate_gas(wide, 1.0, random, worlds=6).ci95 for _ in range(200)]
    assert 0.91 < np.mean([low <= said <= high for low, high in intervals]) < 0.99


@pytest.mark.parametrize(("freedom", "printed"), [(5, 2.571), (10, 2.228), (30, 2.042), (120, 1.980)])
def test_students_t_as_tabulated(freedom, printed):
    assert students_t(freedom) == pytest.approx(printed, rel=2e-3)
