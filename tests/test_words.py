"""Counts in sentences, figures of tables, and what was meant."""

import pytest

from ridlink.avoidance.solver import new_solver
from ridlink.captures import open_capture
from ridlink.separation.definitions import Definition
from ridlink.words import Named, counted, did_you_mean, or_dash, unknown_name


def test_one_is_singular_and_everything_else_plural():
    assert [counted(n, "shard") for n in (0, 1, 2, 1200)] == ["0 shards", "1 shard", "2 shards", "1,200 shards"]
    assert counted(1.0, "drone", "g") == "1 drone" and counted(0.5, "drone", "g") == "0.5 drones"
    assert [counted(n, "process", more="processes") for n in (1, 2)] == ["1 process", "2 processes"]
    assert counted(2446, "setpoint", "d") == "2446 setpoints"


def test_a_figure_that_is_unknown_is_a_dash():
    assert [or_dash(value) for value in (None, 0.0, 12.25, float("nan"))] == ["-", "0.0", "12.2", "nan"]
    assert [or_dash(value, ".2g") for value in (None, 0.012)] == ["-", "0.012"]


def test_what_was_meant_is_the_nearest_or_what_ends_so():
    known = ("HEARTBEAT", "LOCAL_POSITION_NED", "OPEN_DRONE_ID_LOCATION", "decode")
    assert did_you_mean("HEARTBEET", known) == ": did you mean 'HEARTBEAT'?"
    assert did_you_mean("LOCATION", known) == ": did you mean 'OPEN_DRONE_ID_LOCATION'?"
    assert did_you_mean("dcode", known) == ": did you mean 'decode'?"
    assert [did_you_mean(word, known) for word in ("", "OPEN", "xyz")] == ["", "", ""]


def test_a_name_that_is_none_of_a_few_is_told_with_those_that_there_are():
    assert unknown_name("colour", "blu", ("red", "blue")) == (
        "unknown colour 'blu': did you mean 'blue'? known are red, blue"
    )
    assert unknown_name("colour", 3, ("red", "blue")) == "unknown colour 3: known are red, blue"


class Colour(Named):
    RED = "red"
    BLUE = "blue"


def test_choices_of_the_library_say_their_names():
    assert Colour("red") is Colour.RED
    with pytest.raises(ValueError, match=r"^unknown Colour None: known are red, blue$"):
        Colour(None)
    with pytest.raises(ValueError, match=r"^unknown SolverKind 'half': did you mean 'halfplane'\? known are half"):
        new_solver("half")
    with pytest.raises(ValueError, match=r"^unknown Definition 'x': known are snmac, remote-id, odid-accuracy, cand"):
        Definition("x")
    with pytest.raises(ValueError, match=r"^unknown CaptureKind 'tlg': did you mean 'tlog'\? known are tlog"):
        open_capture("any.tlog", "tlg")
