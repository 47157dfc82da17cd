"""Counts in sentences."""

from ridlink.words import counted


def test_one_is_singular_and_everything_else_plural():
    assert [counted(n, "shard") for n in (0, 1, 2, 1200)] == ["0 shards", "1 shard", "2 shards", "1,200 shards"]
    assert counted(1.0, "drone", "g") == "1 drone" and counted(0.5, "drone", "g") == "0.5 drones"
    assert [counted(n, "process", more="processes") for n in (1, 2)] == ["1 process", "2 processes"]
    assert counted(2446, "setpoint", "d") == "2446 setpoints"
