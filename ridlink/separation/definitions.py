"""Separation definitions: reports of two vehicles -> radius of the disc that must stay empty, metres.

Source: paper, section VI-B and Table IV (its figures are diameters of a pair; ours are radii, see `volumes`). Unknown
is NaN and becomes the standard's upper bound, never zero: 40 m of error, 7.5 m of airframe, 30.7 m/s of speed. Values
come from strangers, so they are clamped here, and none of them raises an error.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ridlink.separation.chance import DEFAULT_ETA, ChanceBound, chance_error_sum
from ridlink.separation.reference import (
    AIRFRAME_CAP_M,
    ERROR_CAP_M,
    LONGEST_INTERVAL_S,
    MAX_AIRFRAME_M,
    MIN_AIRFRAME_M,
    REPORT_INTERVAL_S,
    SNMAC_PAIR_RADIUS_M,
    SPEED_CAP_MPS,
    UNKNOWN_ERROR_BOUND_M,
    UNKNOWN_SPEED_MPS,
)
from ridlink.words import Named

FloatArray = NDArray[np.float64]


class Definition(Named):
    """Which fields of a report size the disc of a pair.

    Beside each stands the probability that a pair that never enters the disc by its reports holds at one instant, if
    errors are normal with a third of the reported bounds on either axis. A mission of T seconds draws `1 + T/T_c` such
    instants; T_c is how long errors last. Beside each stands also what is left after an hour in conflict with T_c =
    10 s, 361 draws (`chance.mission_probability`). The solver's own buffer comes on top and is not counted.

    SNMAC: a fixed radius of 15 m. Guarantees nothing about position errors: two vehicles that keep it by their reports
        may collide once the errors add up to more than 15 m less the airframes. With airframes of 3.8 m and 10 m of
        error on either axis of each, that is one encounter in five, and after an hour nothing is left.
    REMOTE_ID: the worst of everything that standard Remote ID allows, 40 m of error and 7.5 m of airframe each. Keeps
        airframes apart for any error within 40 m, at the largest price in airspace. Of normal errors of 10 m it holds
        all but one in a hundred million, and an hour as well.
    ODID_ACCURACY: largest airframe, and the error bound behind the accuracy code that standard Remote ID already
        carries. As good as the code, which is coarse and often filled with an unscaled one-sigma figure.
    CANDIDATE1: largest airframe, reported three-sigma error. Keeps airframes apart while both errors are within their
        reported bounds (98.9 % of positions each, for errors normal on both axes). Since errors seldom point at each
        other, airframes are apart at least 99.86 % of the time for any two errors, 99.998 % for two equal ones; 61 %
        and 99.6 % of hours.
    CANDIDATE2: reported airframe, reported three-sigma error. The same statement with the true size of both airframes.
    CHANCE: reported airframe, and the least distance that keeps airframes apart with probability eta, for all
        neighbours together: see `chance`. Eta is per instant: at 0.999 seven such hours in ten pass; for what a mission
        needs to hold 0.999 see `chance.eta_of_mission`. An unknown error counts as normal, three sigma of 40 m.
    """

    SNMAC = "snmac"
    REMOTE_ID = "remote-id"
    ODID_ACCURACY = "odid-accuracy"
    CANDIDATE1 = "candidate1"
    CANDIDATE2 = "candidate2"
    CHANCE = "chance"


@dataclass(frozen=True, slots=True)
class Reported:
    """What one vehicle or many report that sizes a disc; NaN, or what is left out, is unknown.

    All four broadcast against each other.

    Attributes:
        airframe_m: Airframe sizes (diameters).
        error_bound_m: Three-sigma position errors per axis, as in RIDLINK_SEPARATION.
        accuracy_bound_m: Three-sigma errors as far as the accuracy code of standard Remote ID tells them.
        speed_mps: Ground speeds.
    """

    airframe_m: ArrayLike = math.nan
    error_bound_m: ArrayLike = math.nan
    accuracy_bound_m: ArrayLike = math.nan
    speed_mps: ArrayLike = math.nan

    def __getitem__(self, index: Any) -> Reported:
        """Some of the vehicles, or the same along other axes: each of the four, indexed as an array."""
        own = (self.airframe_m, self.error_bound_m, self.accuracy_bound_m, self.speed_mps)
        return Reported(*(np.asarray(values)[index] for values in own))


@dataclass(frozen=True, slots=True)
class Discs:
    """Discs of one vehicle against n others, part by part.

    Attributes:
        airframe_m: Part that keeps airframes apart, never less than the MAC radius of the pair, shape (...).
        error_sum_m: Part for the localization errors of both, eps_i + eps_j, shape (...).
        displacement_m: Part for the distances that both fly between two reports, shape (...).
    """

    airframe_m: FloatArray
    error_sum_m: FloatArray
    displacement_m: FloatArray

    @property
    def radius_m(self) -> FloatArray:
        """Radius of the pair's disc, R_ij, shape (...)."""
        return self.airframe_m + self.error_sum_m + self.displacement_m


def bounded_airframe(airframe_m: ArrayLike) -> FloatArray:
    """Airframe size [m] between 0.1 and 30; unknown (NaN) and meaningless (zero, negative) sizes become 7.5."""
    size = np.asarray(airframe_m, dtype=np.float64)
    known = np.where(size > 0.0, size, MAX_AIRFRAME_M)
    return np.asarray(np.clip(known, MIN_AIRFRAME_M, AIRFRAME_CAP_M))


def bounded_error(error_bound_m: ArrayLike) -> FloatArray:
    """Error bound [m] between 0 and 185; unknown (NaN) and meaningless (negative) bounds become 40."""
    bound = np.asarray(error_bound_m, dtype=np.float64)
    known = np.where(bound >= 0.0, bound, UNKNOWN_ERROR_BOUND_M)
    return np.asarray(np.minimum(known, ERROR_CAP_M))


def bounded_speed(speed_mps: ArrayLike) -> FloatArray:
    """Ground speed [m/s] between 0 and 254.25; unknown (NaN) and meaningless (negative) speeds become 30.7."""
    speed = np.asarray(speed_mps, dtype=np.float64)
    known = np.where(speed >= 0.0, speed, UNKNOWN_SPEED_MPS)
    return np.asarray(np.minimum(known, SPEED_CAP_MPS))


def bounded_interval(interval_s: ArrayLike) -> FloatArray:
    """Time between reports, as measured, that sizes a disc: between 0.1 and 1 s."""
    return np.asarray(np.clip(np.asarray(interval_s, dtype=np.float64), REPORT_INTERVAL_S, LONGEST_INTERVAL_S))


def separation_discs(
    definition: Definition,
    own: Reported,
    others: Reported,
    *,
    interval_s: ArrayLike = REPORT_INTERVAL_S,
    eta: float = DEFAULT_ETA,
    neighbours: ArrayLike = 1,
    bound: ChanceBound = ChanceBound.HALFPLANE,
) -> Discs:
    """Discs of one vehicle, or of many, against others, under one definition.

    Source: paper Eq. 7 to 9 and Table IV; Eq. 15 to 18 for `CHANCE`. Everything broadcasts against everything. The
    radius is never below the MAC radius of the pair, never NaN, and grows with every size, error, speed and interval.

    Args:
        definition: Which fields count; see `Definition` for what each guarantees.
        own: Reports of the one vehicle; for a batch, with an axis for the others.
        others: Reports of the others, shape (n,).
        interval_s: Time between two reports, one for all or shape (n,).
        eta: For `CHANCE` only: probability, at any one instant, that no neighbour comes closer than it may.
        neighbours: For `CHANCE` only: number of neighbours that share the risk, usually n.
        bound: For `CHANCE` only: form of the constraint.

    Returns:
        Discs with the broadcast shape.

    Raises:
        ValueError: If an interval is negative or not finite, shapes do not broadcast, or a name is unknown; for
            `CHANCE` also if eta is not within (0, 1) or a number of neighbours is negative or not finite.
    """
    definition = Definition(definition)
    interval = np.asarray(interval_s, dtype=np.float64)
    allowed = np.isfinite(interval) & (interval >= 0.0)
    if not np.all(allowed):
        raise ValueError(f"interval_s must be finite and not negative, got {interval[~allowed].flat[0]:g}")
    # Every definition answers in the same shape, whichever fields it uses.
    sizes = (own.airframe_m, own.error_bound_m, own.accuracy_bound_m, own.speed_mps,
             others.airframe_m, others.error_bound_m, others.accuracy_bound_m, others.speed_mps)  # fmt: skip
    try:
        shape = np.broadcast_shapes(*map(np.shape, (*sizes, interval, neighbours)))
    except ValueError:
        names = [f"{whose}.{field.name}" for whose in ("own", "others") for field in fields(Reported)]
        given = zip((*names, "interval_s", "neighbours"), (*sizes, interval, neighbours), strict=True)
        shapes = ", ".join(f"{name} {np.shape(values)}" for name, values in given if np.shape(values))
        raise ValueError(f"shapes do not broadcast: {shapes}") from None

    def filled(values: ArrayLike) -> FloatArray:
        part = np.asarray(values)
        return part if part.shape == shape else np.broadcast_to(part, shape).copy()

    airframe = filled((bounded_airframe(own.airframe_m) + bounded_airframe(others.airframe_m)) / 2.0)
    if definition is Definition.SNMAC:
        return Discs(np.maximum(airframe, SNMAC_PAIR_RADIUS_M), np.zeros(shape), np.zeros(shape))
    displacement = filled(interval * (bounded_speed(own.speed_mps) + bounded_speed(others.speed_mps)))
    own_error, error = bounded_error(own.error_bound_m), bounded_error(others.error_bound_m)
    match definition:
        case Definition.REMOTE_ID:
            errors = np.full(shape, 2.0 * UNKNOWN_ERROR_BOUND_M)
            return Discs(np.maximum(airframe, MAX_AIRFRAME_M), errors, displacement)
        case Definition.ODID_ACCURACY:
            coded = filled(bounded_error(own.accuracy_bound_m) + bounded_error(others.accuracy_bound_m))
            return Discs(np.maximum(airframe, MAX_AIRFRAME_M), coded, displacement)
        case Definition.CANDIDATE1:
            return Discs(np.maximum(airframe, MAX_AIRFRAME_M), filled(own_error + error), displacement)
        case Definition.CANDIDATE2:
            return Discs(airframe, filled(own_error + error), displacement)
        case _:  # Definition.CHANCE
            kept = chance_error_sum(own_error, error, eta=eta, neighbours=neighbours, bound=bound)
            return Discs(airframe, filled(kept), displacement)
