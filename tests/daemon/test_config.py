"""Configuration: flag over file over default, and every mistake is named with its file, line and key."""

from __future__ import annotations

import math
import os
import re
import tomllib
from dataclasses import fields
from pathlib import Path
from typing import Any

import msgspec
import pytest

from ridlink.avoidance import GradedSettings, RotationSettings, SolverKind
from ridlink.daemon.config import KEY_RANGES, DaemonConfig, as_toml, configured, daemon_config
from ridlink.daemon.config_file import SOLVER_TABLES, FlatConfig, overridden, read_config_file
from ridlink.engine import Goal
from ridlink.errors import ConfigError
from ridlink.links import parse_link_url
from ridlink.separation import Definition

WHOLE = """
vehicle = "udpin:127.0.0.1:14541"
rid = "udpout:127.0.0.1:14651"
goal = [47.39, 8.54, 100]
definition = "candidate1"
cruise = 12
airframe = 1.2
airframe_height = 0.5
vertical = true
vertical_cost = 0.3
vertical_band = 25.0
min_height = 30.0
max_height = 90.0
v_max = 14.0
vz_max = 1.5
a_max = 4.0
vehicle_sysid = 2
uas_id = "FA-1"
standby = true
filter_positions = false
log = "flight.tlog"

[halfplane]
horizon_s = 9.0
response_time_s = 0.5
arrival_deceleration_mps2 = inf

[[obstacle]]
polygon = [[47.391, 8.541], [47.392, 8.541], [47.392, 8.543]]
"""


@pytest.fixture
def write(tmp_path: Path):
    def to_file(text: str) -> Path:
        path = tmp_path / "vehicle.toml"
        path.write_text(text)
        return path

    return to_file


def test_every_key_arrives(write) -> None:
    config = daemon_config(read_config_file(write(WHOLE)))
    engine = config.engine
    assert str(config.vehicle) == "udpin:127.0.0.1:14541"
    assert str(config.remote_id) == "udpout:127.0.0.1:14651"
    assert engine.goal == Goal(47.39, 8.54, 100.0)
    assert engine.definition is Definition.CANDIDATE1
    assert (engine.cruise_mps, engine.airframe_m, engine.vehicle_sysid, engine.uas_id) == (12.0, 1.2, 2, "FA-1")
    assert engine.height_m == 0.5
    vertical = (engine.vertical_avoidance, engine.vertical_cost, engine.vertical_band_m)
    assert (*vertical, engine.min_height_m, engine.max_height_m) == (True, 0.3, 25.0, 30.0, 90.0)
    assert engine.limits.horizontal_mps == 14.0
    assert (engine.limits.vertical_mps, engine.limits.acceleration_mps2) == (1.5, 4.0)
    assert engine.standby and not engine.filter_positions
    assert engine.halfplane.horizon_s == 9.0 and engine.halfplane.response_time_s == 0.5
    assert math.isinf(engine.halfplane.arrival_deceleration_mps2)
    assert engine.obstacles == (((47.391, 8.541), (47.392, 8.541), (47.392, 8.543)),)
    assert config.log == Path("flight.tlog")


def test_printed_configuration_reads_back_as_the_same(write) -> None:
    quoting = """vehicle = 'serial:/dev/tty"0":57600'\nmetrics = "127.0.0.1:9"\noperator_id = 'a"b'"""
    signed = 'signing_key = "k\\"ey"\nsigning_state = "k.state"\nbroadcast = true\nbroadcast_form = "module"'
    control = r'log = "a\u0001\t\u007f.tlog"'
    for text in (WHOLE, "", "goal = [47.0, 8.0]", quoting, signed, control):
        config = daemon_config(read_config_file(write(text)))
        assert daemon_config(read_config_file(write(as_toml(config)))) == config


def test_a_name_that_is_no_text_is_flown_with_but_is_not_printed() -> None:
    config = daemon_config(FlatConfig(log=os.fsdecode(b"flight\xff.tlog")))
    with pytest.raises(ConfigError, match=r"flight\udcff\.tlog is not UTF-8 text"):
        as_toml(config)


def test_a_solver_and_the_constants_of_each(write) -> None:
    text = 'solver = "graded"\nresponse_time = 0.5\n[graded]\nlean_rad = 0.3\n[rotation]\nstep_deg = 5.0'
    engine = daemon_config(read_config_file(write(text))).engine
    assert engine.solver is SolverKind.GRADED
    assert engine.solver_settings == GradedSettings(lean_rad=0.3, response_time_s=0.5)
    assert engine.halfplane.response_time_s == 0.5
    assert engine.rotation == RotationSettings(step_deg=5.0)
    assert daemon_config(read_config_file(write(as_toml(DaemonConfig(engine=engine))))).engine == engine


def test_flag_over_file_over_default(write) -> None:
    flat = read_config_file(write("cruise = 7.0\nairframe = 2.0"))
    config = daemon_config(overridden(flat, {"cruise": 8.0, "airframe": None, "response_time": 0.0}))
    assert config.engine.cruise_mps == 8.0
    assert config.engine.airframe_m == 2.0
    assert config.engine.limits.horizontal_mps == 15.0
    assert config.engine.halfplane.response_time_s == 0.0


WALL = "[[obstacle]]\npolygon = [[47.0, 8.0], [47.1, 8.0], [47.1, 8.1]]\n"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("cruize = 7.0", [":1", "'cruize'", "did you mean 'cruise'"]),
        ("\nv-max = 7.0", [":2", "did you mean 'v_max'"]),
        ("xyzzy = 1", ["known are vehicle, rid, goal"]),
        ("[halfplane]\nhorizon = 7.0", [":2", "'horizon_s'"]),
        ("[[obstacle]]\npoligon = []", [":2", "'polygon'"]),
        ("cruise = nan", [":1", "cruise must be a finite number, not nan"]),
        ("goal = [nan, 8.0]", [":1", "goal must be a finite number"]),
        ("[halfplane]\nhorizon_s = nan", [":2", "horizon_s must be a finite number"]),
        ("[halfplane]\nhorizon_s = inf", ["horizon_s must lie between 0.1 and 60 s, got inf"]),
        ("[[obstacle]]\npolygon = [[47.0, inf]]", ["polygon must be a finite number"]),
        ('cruise = "fast"', [":1", "cruise: expected a number, got text"]),
        ("guard = 3", [":1", "guard: expected true or false, got a whole number"]),
        ("vehicle_sysid = 1.5", [":1", "vehicle_sysid: expected a whole number, got a number"]),
        ("goal = [47.0]", [":1", "[latitude, longitude] or [latitude, longitude, altitude]"]),
        ("goal = 47.0", [":1", "[latitude, longitude]"]),
        (
            "[[obstacle]]\npolygon = [[47.0, 8.0]]\n[[obstacle]]\npolygon = [[47.0, 8.0], [47.0, 8.0, 1.0]]",
            [":4: obstacle 2, vertex 2: expected a list of length 2, got 3"],
        ),
        ('[[obstacle]]\npolygon = [[47.0, "8"]]', [":2: obstacle 1, vertex 1: expected a number, got text"]),
        ("[[obstacle]]\npolygon = 47.0", [":2: obstacle 1: expected a list, got a number"]),
        ("obstacle = 1", [":1", "obstacle: expected a list, got a whole number"]),
        ("obstacle = [1]", [":1: obstacle 1: expected a table, got a whole number"]),
        ("halfplane = 1", [":1", "halfplane: expected a table, got a whole number"]),
        ("cruise = \nairframe = 1.0", [":1: is not TOML", "line 1"]),
        ("\ncruise = ", [":2: is not TOML", "at end of document"]),
        ("\ngoal = [47.0,\n\n", [":3: is not TOML"]),
        ('definition = "candidat2"', ["did you mean 'candidate2'?"]),
        ('solver = "grade"', ["did you mean 'graded'?"]),
        ("[graded]\nlean = 0.1", [":2", "did you mean 'lean_rad'?"]),
        ("[graded]\nlean_rad = nan", [":2", "lean_rad must be a finite number"]),
        ("[rotation]\nstep_deg = 7.0", ["step_deg must divide 360 degrees, got 7"]),
        ('definition = "chance"\neta = 1.0', ["eta", "got 1"]),
        ('chance_bound = "contour"', ["did you mean 'contours'?"]),
        ('accuracy_convention = "1-sigma"', ["accuracy-convention", "did you mean 'one-sigma'?"]),
        ('definition = "xyz"', ["known are snmac, remote-id"]),
        ('vehicle = "udp:127.0.0.1:14540"', ["udpin:127.0.0.1:14540"]),
        ("cruise = 16.0", ["above v-max"]),
        ("v_max = -1.0", ["v-max must lie between 0.01 and 100 m/s, got -1"]),
        ("response_time = -1.0", ["response-time must lie between 0 and 5 s, got -1"]),
        ("goal = [86.0, 8.0]", ["latitude"]),
        ('rid = "udpout:127.0.0.1:14540"', ["rid udpout:127.0.0.1:14540", "vehicle listens on", "another port"]),
        ('rid = "udpin:127.0.0.1:14540"', ["vehicle and rid both listen on udpin:127.0.0.1:14540", "another port"]),
        ('vehicle = "udpin:0.0.0.0:1"\nbroadcast_to = "udpout:localhost:1"', ["broadcast-to", "heard here"]),
        ('broadcast_to = "udpout:127.0.0.1:14651"', ["broadcast-to", "nothing is transmitted", "give broadcast"]),
        ("vehicle_sysid = 256", ["between 1 and 255"]),
    ],
)
def test_f34_mistakes_are_named(write, text: str, words: list[str]) -> None:
    with pytest.raises(ConfigError) as caught:
        daemon_config(read_config_file(write(text)))
    for word in words:
        assert word in str(caught.value)
    assert "\n" not in str(caught.value)


def test_f34_all_mistakes_are_told_at_once_and_none_twice(write) -> None:
    text = 'cruise = "fast"\ncruize = 7.0\ngoal = [nan, nan]\nguard = true\n[halfplane]\nhorizon = 7.0\nwait = 1.0\n'
    with pytest.raises(ConfigError) as caught:
        read_config_file(write(text))
    lines = [str(caught.value), *caught.value.others]
    assert [re.search(r":(\d+): (?:unknown key ')?(\w+)", line).groups() for line in lines] == [
        ("2", "cruize"), ("1", "cruise"), ("3", "goal"), ("6", "horizon"), ("7", "wait"),
    ]  # fmt: skip
    with pytest.raises(ConfigError) as caught:
        read_config_file(write("".join(f"key{number} = 1\n" for number in range(50))))
    assert len(caught.value.others) == 4
    with pytest.raises(ConfigError) as caught:
        read_config_file(write("[[obstacle]]\npoligon = []\n"))
    assert not caught.value.others


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[halfplane]\nsmoothing = 0.4\n[rotation]\nsmoothing = nan", ":4: smoothing must be a finite number"),
        (
            "[halfplane]\nsmoothing = 0.4\n[rotation]\nsmoothing = 7.0",
            ":4: smoothing must lie between 0.01 and 1, got 7",
        ),
        ('[halfplane]\nsmoothing = 0.4\n\nstart_turn_rad = "x"', ":4: start_turn_rad: expected a number, got text"),
        ("[graded]\nfade_s = 5.0\n[rotation]\nfade_s = 5.0", ":4: unknown key 'fade_s'"),
        (WALL + "[[obstacle]]\npolygon = [[47.0, nan]]", ":4: polygon must be a finite number"),
        (WALL + "[[obstacle]]\npolygon = [[47.0, 8.0]]", ":4: obstacle 2 needs"),
        (WALL + "[[obstacle]]\n", ":3: obstacle 2: object missing"),
        ("halfplane = {smoothing = 7.0}", ":1: smoothing must lie between 0.01 and 1, got 7"),
        ("obstacle = [{polygon = [[47.0, 8.0]]}]", ":1: obstacle 1 needs"),
    ],
)
def test_f34_the_line_is_that_of_the_table_with_the_mistake(write, text: str, said: str) -> None:
    path = write(text)
    with pytest.raises(ConfigError) as caught:
        configured(str(path), {})
    assert str(caught.value).startswith(f"{path}{said}")


@pytest.mark.parametrize(
    ("text", "over", "said"),
    [
        ("\ncruise = -1.0", {}, ":2: cruise must lie between 0.01 and 100 m/s, got -1"),
        ('definition = "chance"\neta = 1.0', {}, ":2: eta must lie between 0.5 and 0.999999999, got 1"),
        ("cruise = 9.0\nv_max = -1.0", {}, ":2: v-max must lie between 0.01 and 100 m/s, got -1"),
        ('\nrid = "udp:a:1"', {}, ":2: rid: connection string 'udp:a:1'"),
        ("[halfplane]\nhorizon_s = inf", {}, ":2: horizon_s must lie between 0.1 and 60 s, got inf"),
        ("v_max = 9.0\ncruise = 12.0", {}, ":2: cruise of 12 m/s is above v-max of 9 m/s"),
        ("v_max = 9.0", {"cruise": 12.0}, ":1: cruise of 12 m/s is above v-max of 9 m/s"),
        ("[[obstacle]]\npolygon = [[47.0, 8.0]]", {}, ":2: obstacle 1 needs"),
    ],
)
def test_f34_a_value_out_of_range_is_told_with_its_line(write, text: str, over: dict[str, Any], said: str) -> None:
    path = write(text)
    with pytest.raises(ConfigError) as caught:
        configured(str(path), over)
    assert str(caught.value).startswith(f"{path}{said}")


def test_f34_all_values_out_of_range_are_told_at_once_but_not_what_follows_from_them(write) -> None:
    """Without its v-max, a cruise of 20 m/s is too fast, which is no mistake."""
    text = 'cruise = 20.0\nv_max = -1.0\nsolver = "grade"\neta = 2.0\n[halfplane]\nhorizon_s = 90.0\n'
    path = write(text)
    with pytest.raises(ConfigError) as caught:
        configured(str(path), {"airframe": 40.0})
    lines = [str(caught.value), *caught.value.others]
    assert [line.removeprefix(str(path)).partition(" must")[0] for line in lines] == [
        ":3: unknown solver 'grade': did you mean 'graded'? known are halfplane, graded, rotation",
        ":4: eta", "airframe", ":2: v-max", ":6: horizon_s",
    ]  # fmt: skip
    path.write_text("eta = 2.0\nairframe = 31.0\nv_max = -1.0\na_max = 0\nmin_height = -1\nmax_height = -1.0\n")
    with pytest.raises(ConfigError) as caught:
        configured(str(path), {})
    assert len(caught.value.others) == 4


@pytest.mark.parametrize(
    ("over", "said"),
    [
        ({"v_max": 200.0}, "v-max must lie between 0.01 and 100 m/s, got 200"),
        ({"cruise": 7.0, "a_max": 0.0}, "a-max must lie between 0.1 and 10000 m/s^2, got 0"),
        ({"rid": "udp:a:1"}, "rid: connection string 'udp:a:1'"),
        ({"vertical_cost": -1.0}, "vertical-cost must lie between 0 and 2"),
        ({"v_max": 9.0, "cruise": 12.0}, "cruise of 12 m/s is above v-max of 9 m/s"),
    ],
)
def test_f34_an_option_out_of_range_is_told_by_its_name(write, over: dict[str, Any], said: str) -> None:
    for config_file in (None, str(write("airframe = 0.9"))):
        with pytest.raises(ConfigError) as caught:
            configured(config_file, over)
        assert str(caught.value).startswith(said)


NUMBERS = {key: (key.replace("_", "-"), f"{key} = ", ":2") for key in KEY_RANGES} | {
    f"{table}.{name}": (name, f"[{table}]\n{name} = ", ":3")
    for table, settings in SOLVER_TABLES.items()
    for name in settings.RANGES
}
"""Every number of a configuration: its name in error texts, TOML up to its value, and the line below another."""


def test_every_number_has_a_range_that_holds_its_default() -> None:
    numbers = {item.name for item in msgspec.structs.fields(FlatConfig) if item.type in (int | None, float | None)}
    assert KEY_RANGES.keys() == numbers
    for settings in SOLVER_TABLES.values():
        assert list(settings.RANGES) == [item.name for item in fields(settings)]
        assert all(getattr(settings(), name) in allowed for name, allowed in settings.RANGES.items())
    flat = {key: value for key, value in tomllib.loads(as_toml(DaemonConfig())).items() if key in KEY_RANGES}
    assert flat and all(value in KEY_RANGES[key] for key, value in flat.items())


@pytest.mark.parametrize("number", NUMBERS)
def test_f34_a_number_beyond_either_end_of_its_range_is_refused_with_range_value_and_line(write, number: str) -> None:
    name, text, line = NUMBERS[number]
    table, _, key = number.rpartition(".")
    allowed = SOLVER_TABLES[SolverKind(table)].RANGES[key] if table else KEY_RANGES[key]
    for beyond in (allowed.least - 1, 1e9, -1e9):
        value = f"{int(beyond)}" if isinstance(allowed.least, int) else f"{beyond}"
        path = write(f"standby = true\n{text}{value}")
        with pytest.raises(ConfigError) as caught:
            configured(str(path), {"signing_key": "key"} if "signing" in number else {})
        assert str(caught.value).startswith(f"{path}{line}: {name} must lie between {allowed.least:.12g} and ")
        assert str(caught.value).endswith(f", got {beyond:.12g}")


def test_f34_a_whole_number_that_no_float_holds_is_refused_like_any_other(write) -> None:
    path = write(f"standby = true\nvehicle_sysid = {'1' * 400}")
    with pytest.raises(ConfigError, match=r":2: vehicle-sysid must lie between 1 and 255, got 1+\.\.\.1+$"):
        configured(str(path), {})


def test_what_is_wrong_with_an_option_is_not_blamed_on_the_file(write) -> None:
    with pytest.raises(ConfigError, match=r"^cruise must lie between 0.01 and 100 m/s, got -2$"):
        configured(str(write("cruise = -1.0")), {"cruise": -2.0})
    with pytest.raises(ConfigError, match=r"^cruise must lie between"):
        configured(None, {"cruise": -2.0})
    assert configured(str(write("cruise = -1.0")), {"cruise": 7.0}).engine.cruise_mps == 7.0


def test_a_file_that_is_no_text_and_one_that_is_not_there(tmp_path: Path) -> None:
    (tmp_path / "x.toml").write_bytes(b"\xff\xfe")
    with pytest.raises(ConfigError, match="not UTF-8"):
        read_config_file(tmp_path / "x.toml")
    with pytest.raises(OSError, match="No such file"):
        read_config_file(tmp_path / "none.toml")


def test_defaults_are_those_of_the_documentation() -> None:
    config = daemon_config(FlatConfig())
    assert config == DaemonConfig()
    assert str(config.vehicle) == "udpin:127.0.0.1:14540"
    assert str(config.remote_id) == "udpout:127.0.0.1:14650"
    assert (config.engine.cruise_mps, config.engine.airframe_m) == (10.0, 0.6)
    assert config.engine.definition is Definition.CANDIDATE2


def test_links_may_be_given_as_text_and_the_period_is_bounded() -> None:
    assert DaemonConfig(vehicle="udpin:127.0.0.1:1").vehicle == parse_link_url("udpin:127.0.0.1:1")  # type: ignore[arg-type]
    for period in (0.0, 0.5, math.nan):
        with pytest.raises(ConfigError, match="period"):
            DaemonConfig(period_s=period)


@pytest.mark.parametrize(
    ("keys", "other", "mine"),
    [
        ({"log": "one", "input_log": "./one"}, "log", "input-log"),
        ({"log": "daemon.toml"}, "config", "log"),
        ({"signing_key": "key", "log": "link"}, "signing-key", "log"),
        ({"signing_key": "key", "signing_state": "key"}, "signing-key", "signing-state"),
    ],
)
def test_f34_what_is_written_never_replaces_what_is_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, keys: dict[str, str], other: str, mine: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("link").symlink_to("key")
    with pytest.raises(ConfigError, match=f"^{mine} and {other} name the same file"):
        daemon_config(FlatConfig(**keys), "daemon.toml")


def test_two_recordings_may_both_go_nowhere() -> None:
    config = daemon_config(FlatConfig(log="/dev/null", input_log="/dev/null"))
    assert config.log == config.input_log == Path("/dev/null")


def test_f34_a_device_without_an_end_is_no_configuration() -> None:
    with pytest.raises(ConfigError, match=r"^/dev/zero: is no configuration: longer than 1048576 bytes$"):
        read_config_file("/dev/zero")
