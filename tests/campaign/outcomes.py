"""Outcomes of flights beside each other."""

from dataclasses import fields

import numpy as np

from ridlink.campaign.worlds import Outcomes


def assert_same_rows(first: Outcomes, second: Outcomes):
    for item in fields(Outcomes):
        assert np.array_equal(getattr(first, item.name), getattr(second, item.name)), item.name
