"""Counts in sentences, and what was meant."""

from ridlink.words import counted, did_you_mean


def test_one_is_singular_and_everything_else_plural():
    assert [counted(n, "shard") for n in (0, 1, 2, 1200)] == ["0 shards", "1 shard", "2 shards", "1,200 shards"]
    assert counted(1.0, "drone", "g") == "1 drone" and counted(0.5, "drone", "g") == "0.5 drones"
    assert [counted(n, "process", more="processes") for n in (1, 2)] == ["1 process", "2 processes"]
    assert counted(2446, "setpoint", "d") == "2446 setpoints"


def test_what_was_meant_is_the_nearest_or_what_ends_so():
    known = ("HEARTBEAT", "LOCAL_POSITION_NED", "OPEN_DRONE_ID_LOCATION", "decode")
    assert did_you_mean("HEARTBEET", known) == ": did you mean 'HEARTBEAT'?"
    assert did_you_mean("LOCATION", known) == ": did you mean 'OPEN_DRONE_ID_LOCATION'?"
    assert did_you_mean("dcode", known) == ": did you mean 'decode'?"
    assert [did_you_mean(word, known) for word in ("", "OPEN", "xyz")] == ["", "", ""]
