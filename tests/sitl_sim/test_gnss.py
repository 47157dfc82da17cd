"""Position errors: their size, their memory, their independence of the fleet, and what the receiver admits."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import pytest

from sitl_sim.gnss import CORRELATION_TIME_S, ERROR_MODELS, ErrorModel, GnssReceivers

FloatArray = npt.NDArray[np.float64]


def record(receivers: GnssReceivers, reports: int) -> FloatArray:
    """Position errors at successive reports, shape (reports, n, 3)."""
    errors = []
    for _ in range(reports):
        errors.append(receivers.position_error_ned_m.copy())
        receivers.step(receivers.interval_s)
    return np.array(errors)


@pytest.mark.parametrize("model", ERROR_MODELS)
def test_vehicle_k_errs_alike_whatever_the_size_of_the_fleet(model: ErrorModel) -> None:
    small = record(GnssReceivers(model, [3.5] * 3, seed=7), 100)
    large = record(GnssReceivers(model, [3.5] * 40, seed=7), 100)
    assert np.array_equal(small, large[:, :3])
    assert not np.array_equal(small, record(GnssReceivers(model, [3.5] * 3, seed=8), 100))


@pytest.mark.parametrize("model", ERROR_MODELS)
def test_two_vehicles_do_not_share_their_errors(model: ErrorModel) -> None:
    first = GnssReceivers(model, [3.5] * 200, seed=1).position_error_ned_m
    assert abs(np.corrcoef(first[0::2, 0], first[1::2, 0])[0, 1]) < 0.35
    assert len(np.unique(first[:, 0])) == 200


@pytest.mark.parametrize("model", ["white", "gauss-markov", "bias"])
def test_spread_over_the_fleet_is_sigma_per_axis(model: ErrorModel) -> None:
    receivers = GnssReceivers(model, [10.0] * 3000, seed=3)
    receivers.step(5.0)
    spread = receivers.position_error_ned_m.std(axis=0)
    assert spread == pytest.approx([10.0, 10.0, 15.0], rel=0.05)
    assert receivers.velocity_error_ned_mps.std(axis=0) == pytest.approx([0.1] * 3, rel=0.06)


def test_radial_errors_have_the_half_normal_radius_of_the_paper() -> None:
    error = GnssReceivers("white-radial", [10.0] * 4000, seed=3).position_error_ned_m
    radius = np.hypot(error[:, 0], error[:, 1])
    assert radius.mean() == pytest.approx(10.0 * math.sqrt(2.0 / math.pi), rel=0.04)
    assert np.mean(radius < 30.0) == pytest.approx(0.9973, abs=0.003)
    direction = np.arctan2(error[:, 1], error[:, 0])
    assert abs(np.mean(np.cos(direction))) < 0.05
    assert abs(np.corrcoef(radius, np.cos(direction))[0, 1]) < 0.05


def test_memory_of_the_models() -> None:
    def correlation(model: ErrorModel, lag_s: float) -> float:
        receivers = GnssReceivers(model, [3.5] * 2500, seed=5)
        before = receivers.position_error_ned_m[:, 0].copy()
        receivers.step(lag_s)
        return float(np.corrcoef(before, receivers.position_error_ned_m[:, 0])[0, 1])

    assert abs(correlation("white", 0.1)) < 0.06
    assert correlation("gauss-markov", 0.1) > 0.97
    assert correlation("gauss-markov", CORRELATION_TIME_S) == pytest.approx(math.exp(-1.0), abs=0.06)
    assert correlation("bias", 60.0) == pytest.approx(1.0)


@pytest.mark.parametrize("time_constant_s", [3.0, 10.0, 60.0])
def test_autocorrelation_of_gauss_markov_is_its_time_constant(time_constant_s: float) -> None:
    receivers = GnssReceivers("gauss-markov", [3.5] * 3000, seed=5, time_constant_s=time_constant_s, interval_s=1.0)
    errors = record(receivers, 12)[:, :, 0]
    for lag in (1, 5, 10):
        correlation = np.corrcoef(errors[0], errors[lag])[0, 1]
        assert correlation == pytest.approx(math.exp(-lag / time_constant_s), abs=0.06)


def test_errors_are_normal() -> None:
    """Quantiles of the standard normal distribution, of many vehicles after a while."""
    receivers = GnssReceivers("gauss-markov", [2.0] * 8000, seed=9)
    receivers.step(3.0)
    unit = receivers.position_error_ned_m[:, 1] / 2.0
    for share, quantile in ((0.025, -1.95996), (0.1587, -1.0), (0.5, 0.0), (0.8413, 1.0), (0.975, 1.95996)):
        assert np.mean(unit < quantile) == pytest.approx(share, abs=0.012)


@pytest.mark.parametrize("model", ["white", "gauss-markov", "bias"])
@pytest.mark.parametrize("share", [0.0, 0.3, 0.8])
def test_common_share_is_the_correlation_of_neighbours_and_leaves_sigma_alone(model: ErrorModel, share: float) -> None:
    pairs = []
    for seed in range(400):
        receivers = GnssReceivers(model, [5.0, 5.0], seed=seed, common_share=share)
        receivers.step(0.5)
        pairs.append(receivers.position_error_ned_m[:, :2].copy())
    errors = np.array(pairs)
    one, other = errors[:, 0].ravel(), errors[:, 1].ravel()
    assert np.corrcoef(one, other)[0, 1] == pytest.approx(share, abs=0.1)
    assert one.std() == pytest.approx(5.0, rel=0.08)
    # what two neighbours see of each other is what they do not share
    assert (one - other).std() == pytest.approx(5.0 * math.sqrt(2.0 * (1.0 - share)), rel=0.08)


def test_errors_change_only_when_a_report_is_due_however_time_is_cut() -> None:
    fine, coarse = (GnssReceivers("white", [5.0], seed=2, interval_s=0.1) for _ in range(2))
    first = fine.position_error_ned_m.copy()
    for _ in range(4):
        fine.step(0.02)
        assert np.array_equal(fine.position_error_ned_m, first)
    fine.step(0.02)
    assert not np.array_equal(fine.position_error_ned_m, first)
    for _ in range(45):
        fine.step(0.02)
    coarse.step(1.0)
    assert np.array_equal(fine.position_error_ned_m, coarse.position_error_ned_m)


def test_what_the_receiver_admits() -> None:
    receivers = GnssReceivers("gauss-markov", [10.0, 0.0])
    assert receivers.h_acc_m == pytest.approx([10.0, 0.001])
    assert receivers.v_acc_m == pytest.approx([15.0, 0.001])
    assert receivers.bound_3sigma_m == pytest.approx([30.0, 0.0])
    assert receivers.vel_acc_mps[0] == pytest.approx(0.1)
    assert receivers.fix_type.tolist() == [3, 3]


def test_sigma_zero_is_exact() -> None:
    receivers = GnssReceivers("white", [0.0])
    receivers.step(1.0)
    assert not np.any(receivers.position_error_ned_m)
    assert not np.any(receivers.velocity_error_ned_mps)


def test_three_sigma_hold_98_9_percent_of_positions() -> None:
    error = GnssReceivers("white", [4.0] * 6000, seed=11).position_error_ned_m
    assert np.mean(np.hypot(error[:, 0], error[:, 1]) <= 12.0) == pytest.approx(0.9889, abs=0.004)


def test_an_outage_takes_the_fix_and_the_position_drifts_as_the_receiver_admits() -> None:
    receivers = GnssReceivers("bias", [0.3, 0.3], seed=4)
    receivers.set_outage(0, True)
    before = receivers.position_error_ned_m.copy()
    receivers.step(25.0)
    assert receivers.fix_type.tolist() == [0, 3]
    drift_m = (receivers.position_error_ned_m - before)[:, 0]
    assert drift_m == pytest.approx([18.75, 0.0], abs=1e-6)
    assert receivers.bound_3sigma_m[0] > drift_m[0]
    receivers.set_outage(0, False)
    assert receivers.h_acc_m == pytest.approx([0.3, 0.3])


def test_sigma_of_one_vehicle_can_be_changed() -> None:
    receivers = GnssReceivers("white", [1.0, 1.0])
    receivers.set_sigma(1, 50.0)
    assert receivers.bound_3sigma_m == pytest.approx([3.0, 150.0])


@pytest.mark.parametrize(
    "model, sigma_m, interval_s",
    [("pink", [1.0], 0.1), ("white", [-1.0], 0.1), ("white", [math.nan], 0.1), ("white", [1.0], 0.0)],
)
def test_impossible_receivers_are_refused(model: ErrorModel, sigma_m: list[float], interval_s: float) -> None:
    with pytest.raises(ValueError):
        GnssReceivers(model, sigma_m, interval_s=interval_s)


@pytest.mark.parametrize("bad", [{"common_share": 1.5}, {"time_constant_s": 0.0}])
def test_impossible_figures_are_refused(bad: dict[str, float]) -> None:
    with pytest.raises(ValueError):
        GnssReceivers("white", [1.0], **bad)  # type: ignore[arg-type]


def test_a_radial_error_has_nothing_in_common() -> None:
    with pytest.raises(ValueError, match="half-normal"):
        GnssReceivers("white-radial", [1.0], common_share=0.5)


def test_the_estimator_claims_less_than_the_receiver() -> None:
    """Measured on PX4: 0.29 m beside h_acc 0.9 m."""
    assert GnssReceivers("bias", [0.9]).ekf_h_acc_m == pytest.approx([0.29], abs=0.01)
