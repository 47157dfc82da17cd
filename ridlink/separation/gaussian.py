"""The error function, the normal distribution and its quantiles over arrays.

numpy has none of them, and the standard library only for single numbers. Nothing else of scipy would be needed here.
"""

from __future__ import annotations

import math
from statistics import NormalDist

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]

_STANDARD = NormalDist()
_erf = np.vectorize(math.erf, otypes=[np.float64])
_erfc = np.vectorize(math.erfc, otypes=[np.float64])
_inverse = np.vectorize(_STANDARD.inv_cdf, otypes=[np.float64])


def erf(x: ArrayLike) -> FloatArray:
    """Error function."""
    return np.asarray(_erf(x))


def normal_cdf(x: ArrayLike) -> FloatArray:
    """Probability that a standard normal variable is at most `x`, exact also where it is tiny."""
    return np.asarray(_erfc(-np.asarray(x, dtype=np.float64) / math.sqrt(2.0)) / 2.0)


def normal_quantile(probability: ArrayLike) -> FloatArray:
    """Value that a standard normal variable does not exceed with a probability; infinite at 0 and 1.

    Raises:
        ValueError: If a probability is not within 0 and 1.
    """
    p = checked_probability(probability)
    inside = (p > 0.0) & (p < 1.0)
    return np.where(inside, _inverse(np.where(inside, p, 0.5)), np.where(p == 0.0, -np.inf, np.inf))


def checked_probability(probability: ArrayLike) -> FloatArray:
    """Probabilities as an array.

    Raises:
        ValueError: If a probability is not within 0 and 1.
    """
    p = np.asarray(probability, dtype=np.float64)
    if not np.all((p >= 0.0) & (p <= 1.0)):
        raise ValueError(f"a probability lies between 0 and 1, got {p[~((p >= 0.0) & (p <= 1.0))].flat[0]:g}")
    return p
