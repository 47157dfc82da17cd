"""What an engine is told, checked before it flies."""

from __future__ import annotations

import math
from typing import Any

import pytest

from ridlink.avoidance import SolverKind
from ridlink.engine import EngineConfig, Goal
from ridlink.errors import ConfigError
from ridlink.separation import Definition
from ridlink.setpoint import VelocityLimits

PLOT = ((47.0, 8.0), (47.1, 8.0), (47.0, 8.1))


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"cruise_mps": 16.0}, "v-max"),
        ({"cruise_mps": 0.0}, "cruise"),
        ({"cruise_mps": math.nan}, "cruise"),
        ({"airframe_m": 0.0}, "airframe"),
        ({"airframe_m": math.inf}, "airframe"),
        ({"airframe_height_m": 0.0}, "airframe-height"),
        ({"vertical_band_m": 0.0}, "vertical-band"),
        ({"vertical_cost": math.nan}, "vertical-cost"),
        ({"min_height_m": 120.0}, "max-height"),
        ({"vehicle_sysid": 0}, "vehicle-sysid"),
        ({"goal": Goal(math.nan, 0.0)}, "finite"),
        ({"goal": Goal(10.0, 181.0)}, "longitude"),
        ({"goal": Goal(10.0, 8.0, 30_000.0)}, "altitude"),
        ({"uas_id": "123456789012345678901"}, "uas-id"),
        ({"uas_id": ""}, "uas-id"),
        ({"obstacles": (((47.0, 8.0), (47.1, 8.0), (47.0, 8.0)),)}, "distinct"),
        ({"obstacles": (PLOT, ((47.0, 8.0), (147.1, 8.0), (47.0, 8.1)))}, "^obstacle 2, vertex 2: 147.1, 8 is no"),
        ({"obstacles": (PLOT, ((47.0, 8.0), (47.1, 188.0), (47.0, 8.1)))}, "^obstacle 2, vertex 2: 47.1, 188 is no"),
        ({"obstacles": (PLOT, ())}, "^obstacle 2 has no vertices"),
        ({"definition": "candidate"}, "definition must be one of snmac, .*, got 'candidate'"),
        ({"chance_bound": "none"}, "chance-bound must be one of"),
        ({"accuracy_convention": "two-sigma"}, "accuracy-convention must be one of letter"),
        ({"solver": "half"}, "solver must be one of halfplane"),
        ({"broadcast_form": None}, "broadcast-form must be one of air"),
    ],
)
def test_configuration_is_refused_in_words(options: dict[str, Any], text: str) -> None:
    with pytest.raises(ConfigError, match=text):
        EngineConfig(**options)


def test_a_choice_may_be_given_by_its_name() -> None:
    config = EngineConfig(definition="candidate1", solver="graded")  # type: ignore[arg-type]
    assert config.definition is Definition.CANDIDATE1 and config.solver is SolverKind.GRADED
    assert config.solver_settings is config.graded


def test_cruise_above_the_default_limit_is_possible_with_a_higher_limit() -> None:
    assert EngineConfig(cruise_mps=20.0, limits=VelocityLimits(horizontal_mps=20.0)).cruise_mps == 20.0
