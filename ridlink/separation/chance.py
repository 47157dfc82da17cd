"""Chance constraint: the distance between two reported positions that keeps the true ones apart with a probability.

Source: paper, Eq. 15 to 18. Errors are normal and equal on both horizontal axes, for Remote ID carries one horizontal
error per vehicle: three standard deviations per axis. With standard deviations `s_i`, `s_j` and a true separation `R`
wanted with probability `eta`, three radii hold `P(miss >= R) >= eta`; `ChanceBound` names them. Smaller is better.

Eta is about *one instant*, in which errors are drawn once and the pair then keeps the constraint: about one encounter,
that is. A flight holds as many encounters with fresh errors as `independent_draws` says, and `mission_probability` is
what is left of eta after all of them. If an error lasts for the whole flight, a bias, one draw decides everything: the
probability is eta again, but an unlucky pair then stays unlucky.

Velocities are taken to be exact. A velocity error of `s_w` per axis moves the miss distance by `s_w t` at the time t of
closest approach, exactly as a position error of that size does. A caller that knows it adds it in quadrature to the
bound of its vehicle, `sqrt(bound^2 + (3 s_w t)^2)`. The engine decides anew ten times a second, on fresh reports, and
does not.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ridlink.ranges import Range
from ridlink.separation.gaussian import normal_cdf, normal_quantile
from ridlink.separation.volumes import checked_lengths
from ridlink.words import Named

FloatArray = NDArray[np.float64]

DEFAULT_ETA = 0.999

ETA_RANGE = Range(0.5, 0.999999999)
"""What may be asked for: below one half the exact constraint would take from the airframes, and what a receiver does
beyond six standard deviations, nobody knows. The share of one of many neighbours may lie outside."""


class ChanceBound(Named):
    """How a probability becomes a distance.

    HALFPLANE: the exact one-sided constraint, `Phi^-1(eta) sqrt(s_i^2 + s_j^2)`. A pair that keeps the line of closest
        approach on one side can only be hit from that side. The default.
    COVARIANCE: the ellipse of the relative position, `sqrt(-2 ln(1 - eta)) sqrt(s_i^2 + s_j^2)`. Counts errors to all
        sides although one matters; holds eta for avoidance that may pass on either side.
    CONTOURS: the paper's product of two contours, each of mass `sqrt(eta)`: `sqrt(-2 ln(1 - sqrt(eta))) (s_i + s_j)`.
        Counts each vehicle's worst together with the other's worst.
    """

    HALFPLANE = "halfplane"
    COVARIANCE = "covariance"
    CONTOURS = "contours"


def checked_eta(eta: float) -> float:
    """Eta, checked.

    Raises:
        ValueError: If eta does not lie between 0 and 1, ends excluded.
    """
    if not 0.0 < eta < 1.0:
        raise ValueError(f"eta must lie between 0 and 1, ends excluded, got {eta:g}")
    return eta


def pair_risk(eta: float, neighbours: ArrayLike = 1) -> FloatArray:
    """Risk that each of n pairs may have, so that with probability eta none of them fails: `(1 - eta) / n`.

    Source: the union bound, which holds however the errors of the pairs depend on each other (they do: all share the
    own error). No neighbour counts as one.

    Raises:
        ValueError: If eta is not within (0, 1), or a number of neighbours is negative or not finite.
    """
    count = np.maximum(checked_lengths("neighbours", neighbours), 1.0)
    return np.asarray((1.0 - checked_eta(eta)) / count)


def chance_error_sum(
    own_error_bound_m: ArrayLike,
    error_bound_m: ArrayLike,
    *,
    eta: float = DEFAULT_ETA,
    neighbours: ArrayLike = 1,
    bound: ChanceBound = ChanceBound.HALFPLANE,
) -> FloatArray:
    """Distance [m] to keep in addition to the true separation, so that a pair holds that with probability eta.

    Source: paper Eq. 15 to 18, in the three forms of `ChanceBound`.

    Args:
        own_error_bound_m: Own three-sigma position error per axis.
        error_bound_m: Three-sigma position error per axis of the others; all arguments broadcast.
        eta: Probability, at any one instant, that none of the neighbours comes closer.
        neighbours: Number of neighbours that share the risk.
        bound: Form of the constraint.

    Returns:
        Distances, never negative: below an eta of one half the half-plane would give some of the separation away.

    Raises:
        ValueError: If eta is not within (0, 1), the form is unknown, or a bound or a number of neighbours is negative
            or not finite.
    """
    own = checked_lengths("own_error_bound_m", own_error_bound_m) / 3.0
    other = checked_lengths("error_bound_m", error_bound_m) / 3.0
    # Even a large batch has few different counts, and quantiles are slow.
    risks, position = np.unique(pair_risk(eta, neighbours), return_inverse=True)
    shape = np.shape(neighbours)
    match ChanceBound(bound):
        case ChanceBound.HALFPLANE:
            factor = np.maximum(-normal_quantile(risks), 0.0)[position].reshape(shape)
            return np.asarray(factor * np.hypot(own, other))
        case ChanceBound.COVARIANCE:
            factor = np.sqrt(-2.0 * np.log(risks))[position].reshape(shape)
            return np.asarray(factor * np.hypot(own, other))
        case ChanceBound.CONTOURS:
            outside = -np.expm1(np.log1p(-risks) / 2.0)  # 1 - sqrt(eta), exact for the smallest risks
            factor = np.sqrt(-2.0 * np.log(outside))[position].reshape(shape)
            return np.asarray(factor * (own + other))


def instant_probability(slack_m: ArrayLike, own_error_bound_m: ArrayLike, error_bound_m: ArrayLike) -> FloatArray:
    """Probability that a pair that keeps a distance by its reports truly keeps that distance less `slack_m`.

    This is the half-plane constraint read backwards: what any disc guarantees against errors that are normal with a
    third of their bounds. Without any error it is 1 if the slack is not negative, and 0 otherwise.

    Args:
        slack_m: Distance kept beyond the one that matters, error_sum_m of a disc; may be negative.
        own_error_bound_m: Own three-sigma position error per axis.
        error_bound_m: Three-sigma position error per axis of the others.

    Raises:
        ValueError: If a bound is negative or not finite, or the slack is no number.
    """
    own, other = (
        checked_lengths("own_error_bound_m", own_error_bound_m),
        checked_lengths("error_bound_m", error_bound_m),
    )
    sigma = np.hypot(own, other) / 3.0
    slack = np.asarray(slack_m, dtype=np.float64)
    if np.any(np.isnan(slack)):
        raise ValueError("slack_m must be a number, got nan")
    uncertain = sigma > 0.0
    certain = np.where(slack >= 0.0, 1.0, 0.0)
    return np.where(uncertain, normal_cdf(slack / np.where(uncertain, sigma, 1.0)), certain)


def independent_draws(duration_s: float, correlation_time_s: float) -> float:
    """Number of independent errors that a flight meets: `1 + T/T_c`.

    Args:
        duration_s: Time T in which the pair is in conflict; the whole mission for the most careful figure.
        correlation_time_s: Time T_c after which an error has been forgotten: the step for white errors, ten seconds and
            more for GNSS, infinite for a bias.

    Raises:
        ValueError: If the duration is negative or the correlation time not positive.
    """
    if not (math.isfinite(duration_s) and duration_s >= 0.0):
        raise ValueError(f"duration_s must be finite and not negative, got {duration_s:g}")
    if not correlation_time_s > 0.0:
        raise ValueError(f"correlation_time_s must be positive, got {correlation_time_s:g}")
    return 1.0 + duration_s / correlation_time_s


def mission_probability(eta: float, duration_s: float, correlation_time_s: float) -> float:
    """Probability that no encounter of a mission fails, `eta^(1 + T/T_c)`: one every correlation time.

    Exact for white errors and for a bias; for drifting errors, a lower bound at instants `T_c` apart. To count also
    every instant in between, at which the vehicles decided anew and nothing happened, gives more: a Gauss-Markov error
    stays within the half-plane all the time with about `eta exp(-u phi(u) T/T_c)`, u the quantile of eta.

    Raises:
        ValueError: As `independent_draws`, or if eta is not within (0, 1).
    """
    return float(checked_eta(eta) ** independent_draws(duration_s, correlation_time_s))


def eta_of_mission(probability: float, duration_s: float, correlation_time_s: float) -> float:
    """Eta per instant that a whole mission needs, the inverse of `mission_probability`.

    Raises:
        ValueError: As `mission_probability`.
    """
    return float(checked_eta(probability) ** (1.0 / independent_draws(duration_s, correlation_time_s)))
