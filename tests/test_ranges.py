"""Ranges: what lies in them, how they are told."""

from __future__ import annotations

import math

import pytest

from ridlink.errors import ConfigError
from ridlink.ranges import Range

SHARE, BRAKING = Range(0.0, 1.0), Range(0.1, 100.0, "m/s^2", or_infinite=True)


def test_both_ends_are_in_it_and_nothing_beyond() -> None:
    for value in (0.0, 0.5, 1.0):
        SHARE.check("share", value)
    for value in (math.nextafter(0.0, -1.0), math.nextafter(1.0, 2.0), math.inf, -math.inf, math.nan):
        with pytest.raises(ConfigError, match=r"^share must lie between 0 and 1, got "):
            SHARE.check("share", value)


def test_infinity_is_in_it_where_it_means_no_limit() -> None:
    BRAKING.check("braking", math.inf)
    for value in (-math.inf, math.nan, 101.0):
        with pytest.raises(ConfigError, match=r"between 0.1 and 100 m/s\^2 or be infinite, got "):
            BRAKING.check("braking", value)


def test_documents_tell_it_in_few_words() -> None:
    told = (str(SHARE), str(BRAKING), str(Range(0.5, 0.999999999)), str(Range(1, 255)))
    assert told == ("0 to 1", "0.1 to 100 m/s^2 or inf", "0.5 to 0.999999999", "1 to 255")
