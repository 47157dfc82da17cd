"""Built-in scenarios have the paper's geometry; scenario files are either right or refused in one useful line."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ridlink.checked_toml import MOST_FAULTS
from ridlink.errors import ConfigError
from ridlink.scenario import (
    BUILT_IN,
    ObstacleSpec,
    Scenario,
    VehicleSpec,
    Wind,
    built_in,
    distance_to_polygon,
    load_scenario,
    load_tracks,
    resolve_scenario,
)
from ridlink.scenario.vehicle_keys import VehicleKeys

Write = Callable[[str], Path]

DOCUMENT = Path(__file__).parents[1] / "docs" / "emulator.md"

GOOD = """\
name = "head-on with a tower"
duration_s = 60.0
interval_s = 0.2
[[vehicle]]
start_ned_m = [-200.0, 0.0, -50.0]
goal_ned_m  = [ 200.0, 0.0, -50.0]
speed_mps = 15.4
airframe_m = 0.6
sigma_m = 10.0
cooperative = false
extended = false
[[vehicle]]
start_ned_m = [200, 0, -50]
goal_ned_m  = [-200, 0, -50]
[[obstacle]]
polygon_ne_m = [[-40.0, -40.0], [40.0, -40.0], [40.0, 40.0], [-40.0, 40.0]]
"""


@pytest.fixture
def write(tmp_path: Path) -> Write:
    def write_text(text: str) -> Path:
        path = tmp_path / "scenario.toml"
        path.write_text(text)
        return path

    return write_text


def test_every_key_of_a_file_arrives(write: Write) -> None:
    scenario = load_scenario(write(GOOD))
    assert (scenario.name, scenario.duration_s, scenario.interval_s) == ("head-on with a tower", 60.0, 0.2)
    assert scenario.vehicles[0] == VehicleSpec(
        (-200.0, 0.0, -50.0), (200.0, 0.0, -50.0), 15.4, 0.6, 10.0, cooperative=False, extended=False
    )
    assert scenario.obstacles == (ObstacleSpec(((-40.0, -40.0), (40.0, -40.0), (40.0, 40.0), (-40.0, 40.0))),)


def test_the_file_in_the_documentation_is_one(write: Write) -> None:
    section = DOCUMENT.read_text().split("## Scenario files\n")[1].split("\n## ")[0]
    text = "".join(f"{line[4:]}\n" for line in section.splitlines() if line.startswith("    ") or not line)
    scenario = load_scenario(write(text))
    assert (scenario.name, len(scenario.vehicles), len(scenario.obstacles)) == ("mine", 2, 1)
    first, second = scenario.vehicles
    assert (first.speed_mps, first.airframe_m, first.sigma_m, first.cooperative) == (10.0, 0.6, None, True)
    assert not second.cooperative and not second.extended


def test_what_a_file_does_not_say_has_defaults(write: Write) -> None:
    plain = load_scenario(write(GOOD), speed_mps=7.0).vehicles[1]
    assert (plain.speed_mps, plain.airframe_m, plain.sigma_m) == (7.0, 0.6, None)
    assert plain.cooperative
    assert plain.extended


MISTAKES = [
    pytest.param("sigma_m = 10.0", "sigma_m = nan", r":9: vehicle 1: sigma_m .*finite", id="NaN"),
    pytest.param("sigma_m = 10.0", "sigma_m = -1", r":9: vehicle 1: sigma_m .*at least 0", id="negative sigma"),
    pytest.param("speed_mps = 15.4", "speed_mps = inf", r":7: vehicle 1: speed_mps .*finite", id="infinite"),
    pytest.param("speed_mps = 15.4", "speed_mps = 0", r":7: vehicle 1: speed_mps .*greater than 0", id="zero speed"),
    pytest.param("airframe_m = 0.6", 'airframe_m = "big"', r":8: vehicle 1: airframe_m .*number", id="text"),
    pytest.param("airframe_m = 0.6", "airframe_m = true", r":8: vehicle 1: airframe_m .*number", id="truth for number"),
    pytest.param(
        "extended = false", "extended = 0", r":11: vehicle 1: extended .*true or false", id="number for truth"
    ),
    pytest.param(
        "speed_mps", "speed_mph", r":7: vehicle 1: speed_mph is not known here: .*speed_mps", id="unknown key"
    ),
    pytest.param("speed_mps = 15.4", "speed_mps = 5000", r":7: vehicle 1: speed_mps must be at most 300", id="fast"),
    pytest.param("airframe_m = 0.6", "airframe_m = 600", r":8: vehicle 1: airframe_m must be at most 100", id="large"),
    pytest.param("sigma_m = 10.0", "sigma_m = 1e5", r":9: vehicle 1: sigma_m must be at most 1000", id="lost"),
    pytest.param("sigma_m = 10.0", "interval_s = 100", r":9: vehicle 1: interval_s must be at most 60", id="slow"),
    pytest.param("interval_s = 0.2", "interval_s = 200", r":3: interval_s must be at most 60, not 200", id="all slow"),
    pytest.param("interval_s", "interval", r":3: interval is not known here: .*interval_s", id="unknown top key"),
    pytest.param("duration_s = 60.0\n", "", r"scenario.toml: duration_s is missing", id="missing top key"),
    pytest.param("goal_ned_m  = [-200, 0, -50]\n", "", r":12: vehicle 2: goal_ned_m is missing$", id="missing key"),
    pytest.param(
        "duration_s", "duraton_s", r"duration_s is missing: did you mean it by duraton_s\?", id="misspelt key"
    ),
    pytest.param("[200, 0, -50]", "[200, 0]", r":13: vehicle 2: start_ned_m .*north, east, down", id="two axes"),
    pytest.param("[200, 0, -50]", "[200, 0, 50]", r":13: vehicle 2: start_ned_m .*negative", id="underground"),
    pytest.param("[200, 0, -50]", "[2e9, 0, -50]", r":13: vehicle 2: start_ned_m .*at most", id="off the plane"),
    pytest.param("[200, 0, -50]", "[-199.5, 0, -50]", r"vehicles 1 and 2 start in the same place", id="same place"),
    pytest.param(
        "[200, 0, -50]", "[0, 0, -50]", r"vehicle 2: start_ned_m .*lies in obstacle 1", id="start in obstacle"
    ),
    pytest.param("[-200, 0, -50]", "[40.2, 0, -50]", r"vehicle 2: goal_ned_m .*lies in obstacle 1", id="goal touches"),
    pytest.param("[[obstacle]]", "[obstacle]", r"obstacle must be written as \[\[obstacle\]\]", id="table not list"),
    pytest.param("[-40.0, -40.0], [40.0, -40.0], ", "", r":16: obstacle 1: .*three corners", id="two corners"),
    pytest.param("[40.0, 40.0], [-40.0, 40.0]", "[-40.0, 40.0], [40.0, 40.0]", r":16: .*do not cross", id="bow tie"),
    pytest.param("[40.0, 40.0]", "[40.0, inf]", r":16: obstacle 1: polygon_ne_m .*finite", id="infinite corner"),
    pytest.param("interval_s = 0.2", "interval_s = 1e-9", r":3: interval_s must be at least 0.02", id="no time"),
    pytest.param("sigma_m = 10.0", "interval_s = 1e-9", r":9: vehicle 1: interval_s .*0.02", id="no time for one"),
    pytest.param('"head-on with a tower"', "3", r":1: name must be text", id="name a number"),
    pytest.param('"head-on with a tower"', "head-on", r"is not TOML: .*line 1", id="not TOML"),
]


@pytest.mark.parametrize("right, wrong, message", MISTAKES)
def test_a_mistake_is_named_in_one_line(write: Write, right: str, wrong: str, message: str) -> None:
    assert right in GOOD
    with pytest.raises(ConfigError, match=message) as caught:
        load_scenario(write(GOOD.replace(right, wrong, 1)))
    text = str(caught.value)
    assert "scenario.toml" in text
    assert "\n" not in text


def test_all_mistakes_are_told_at_once_and_nothing_that_follows_from_one(write: Write) -> None:
    text = GOOD.replace("interval_s", "interval").replace("[200, 0, -50]", "[200, 0]")
    text = text.replace("speed_mps = 15.4", "speed_mph = 15.4").replace("airframe_m = 0.6", 'airframe_m = "big"')
    # without ghost it would avoid others, which has no transmitter and no route
    text = text.replace("extended = false", "ghost = 1\ntransmitter_ned_m = [0, 0, 0]")
    with pytest.raises(ConfigError) as caught:
        load_scenario(write(text))
    lines = [line.split("scenario.toml:")[1] for line in (str(caught.value), *caught.value.others)]
    assert [line.split(" is ")[0].split(" must ")[0] for line in lines] == [
        "8: vehicle 1: airframe_m",
        "11: vehicle 1: ghost",
        "7: vehicle 1: speed_mph",
        "14: vehicle 2: start_ned_m",
        "3: interval",
    ]


def test_what_a_key_may_not_say_hides_no_other_mistake(write: Write) -> None:
    text = GOOD.replace("[200, 0, -50]", "[200, 0, 50]").replace("speed_mps = 15.4", "interval_s = 0.0")
    text = text.replace("airframe_m = 0.6", 'autopilot = "inav"')
    event = '\n[[event]]\nat_s = 1.0\nvehicle = 9\nwhat = "nothing"\n'
    with pytest.raises(ConfigError) as caught:
        load_scenario(write(text + event))
    lines = [line.split("scenario.toml:")[1] for line in (str(caught.value), *caught.value.others)]
    assert [line.split(" is ")[0].split(" must ")[0].split(": ", 1)[1] for line in lines] == [
        "vehicle 1: interval_s",
        "vehicle 1: autopilot",
        "vehicle 2: start_ned_m",
        "event 1: vehicle",
        "event 1: what",
    ]


def test_of_a_file_full_of_mistakes_five_are_told(write: Write) -> None:
    with pytest.raises(ConfigError) as caught:
        load_scenario(write(GOOD + "".join(f"key{number} = 1\n" for number in range(50))))
    assert len(caught.value.others) == MOST_FAULTS - 1
    assert "key0 is not known" in str(caught.value) and "key4 is not known" in caught.value.others[-1]


@pytest.mark.parametrize("suffix", ["toml", "geojson"])
@pytest.mark.parametrize("value", ["9" * 5000, "[" * 100_000], ids=["5,000 digits", "brackets without end"])
def test_what_no_parser_can_hold_is_refused_in_one_line(tmp_path: Path, suffix: str, value: str) -> None:
    path = tmp_path / f"scenario.{suffix}"
    path.write_text(f"x = {value}" if suffix == "toml" else value)
    with pytest.raises(ConfigError) as refused:
        resolve_scenario(str(path))
    assert f"scenario.{suffix}" in str(refused.value)
    assert len(str(refused.value)) < 200 and "\n" not in str(refused.value)


def test_a_file_that_is_not_text_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "scenario.toml"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ConfigError, match="UTF-8"):
        load_scenario(path)
    with pytest.raises(FileNotFoundError):
        load_scenario(tmp_path / "none.toml")


def test_an_obstacle_may_have_arms_that_end_in_one_line_and_none_that_lie_upon_each_other(write: Write) -> None:
    square = "[[-40.0, -40.0], [40.0, -40.0], [40.0, 40.0], [-40.0, 40.0]]"
    u = "[[-40, -60], [60, -60], [60, 60], [-40, 60], [-40, 45], [45, 45], [45, -45], [-40, -45]]"
    assert len(load_scenario(write(GOOD.replace(square, u))).obstacles[0].polygon_ne_m) == 8
    upon = "[[0, 0], [40, 0], [40, 40], [20, 40], [20, 0], [10, 0], [10, 10], [0, 10]]"
    with pytest.raises(ConfigError, match="do not cross"):
        load_scenario(write(GOOD.replace(square, upon)))


def test_a_polygon_may_end_with_its_first_corner(write: Write) -> None:
    closed = write(GOOD.replace("[-40.0, 40.0]]", "[-40.0, 40.0], [-40.0, -40.0]]"))
    assert load_scenario(closed).obstacles == load_scenario(write(GOOD)).obstacles


def test_the_mark_that_editors_write_before_utf8_is_no_part_of_the_text(tmp_path: Path) -> None:
    path = tmp_path / "scenario.toml"
    path.write_text(GOOD, encoding="utf-8-sig")
    assert load_scenario(path).name == "head-on with a tower"


def test_names_and_paths_are_told_apart(write: Write) -> None:
    assert resolve_scenario("crossing").name == "crossing"
    path = str(write(GOOD))
    assert resolve_scenario(path).name == "head-on with a tower"
    assert len(resolve_scenario(path, 1).vehicles) == 1
    with pytest.raises(ConfigError, match="2 vehicles"):
        resolve_scenario(path, 3)
    with pytest.raises(ConfigError, match="circle8, square24, head-on, crossing, overtake"):
        resolve_scenario("circle")


def test_what_happens_to_those_who_are_left_out_is_left_out(write: Write) -> None:
    happens = '[[event]]\nat_s = {}\nvehicle = {}\nwhat = "{}"\n'
    events = [(1.0, 2, "link-off"), (2.0, 1, "radio-off"), (3.0, 0, "gnss-outage"), (4.0, 2, "wind")]
    path = str(write(GOOD + "".join(happens.format(*event) for event in events)))
    assert len(resolve_scenario(path).events) == 4
    assert [event.what for event in resolve_scenario(path, 1).events] == ["radio-off", "gnss-outage", "wind"]


@pytest.mark.parametrize("name", list(BUILT_IN))
def test_built_in_scenarios_share_one_altitude_and_scale_with_speed(name: str) -> None:
    scenario, faster = built_in(name), built_in(name, speed_mps=20.0)
    points = [point for v in scenario.vehicles for point in (v.start_ned_m, v.goal_ned_m)]
    assert {point[2] for point in points} == {-50.0}
    assert {v.airframe_m for v in scenario.vehicles} == {0.6}
    assert faster.duration_s == pytest.approx(max(scenario.duration_s / 2.0, 300.0)), "five minutes at least"
    for vehicle in scenario.vehicles:
        way = np.linalg.norm(np.subtract(vehicle.goal_ned_m, vehicle.start_ned_m))
        assert scenario.duration_s > 3.0 * way / vehicle.speed_mps


@pytest.mark.parametrize("count", [None, 1, 2, 5, 24, 250])
def test_circle_has_antipodal_goals_at_100_m(count: int | None) -> None:
    vehicles = built_in("circle8", count).vehicles
    assert len(vehicles) == (count or 8)
    starts = np.array([v.start_ned_m[:2] for v in vehicles])
    goals = np.array([v.goal_ned_m[:2] for v in vehicles])
    assert np.hypot(*starts.T) == pytest.approx([100.0] * len(vehicles))
    assert goals == pytest.approx(-starts)
    assert built_in("circle8").duration_s == pytest.approx(300.0)


def test_square_has_six_a_side_and_an_obstacle_in_the_middle() -> None:
    scenario = built_in("square24")
    starts = np.array([v.start_ned_m[:2] for v in scenario.vehicles])
    goals = np.array([v.goal_ned_m[:2] for v in scenario.vehicles])
    grid = {-250.0, -150.0, -50.0, 50.0, 150.0, 250.0}
    for axis in (0, 1):
        for side in (-300.0, 300.0):
            on_side = starts[:, axis] == side
            assert set(starts[on_side, 1 - axis]) == grid
            assert set(goals[on_side, axis]) == {-side}
            assert np.array_equal(goals[on_side, 1 - axis], starts[on_side, 1 - axis])
    corners = np.array(scenario.obstacles[0].polygon_ne_m)
    assert np.ptp(corners, axis=0) == pytest.approx([80.0, 80.0])
    assert corners.mean(axis=0) == pytest.approx([0.0, 0.0])


def test_pairs_meet_as_their_names_say() -> None:
    def ways(name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        first, second = built_in(name).vehicles
        way = [np.subtract(v.goal_ned_m, v.start_ned_m) for v in (first, second)]
        return way[0], way[1], np.subtract(second.start_ned_m, first.start_ned_m)

    first, second, apart = ways("head-on")
    assert first == pytest.approx(-second)
    assert np.linalg.norm(apart) == pytest.approx(400.0)
    first, second, _ = ways("crossing")
    assert first @ second == pytest.approx(0.0)
    first, second, apart = ways("overtake")
    assert np.cross(first, second) == pytest.approx([0.0, 0.0, 0.0])
    assert first @ apart > 0.0  # the other is ahead, and slower
    assert built_in("overtake").vehicles[0].speed_mps == 2.0 * built_in("overtake").vehicles[1].speed_mps


@pytest.mark.parametrize(
    "name, count, message",
    [
        ("square24", 6, "multiple of 4"),
        ("head-on", 3, "2 vehicles"),
        ("circle8", -1, "-1 vehicles"),
        ("circle8", 3000, "same place"),
    ],
)
def test_a_count_that_does_not_fit_is_refused(name: str, count: int, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        built_in(name, count)


def test_an_empty_sky_is_a_scenario() -> None:
    assert built_in("circle8", 0).vehicles == ()


def test_speeds_that_nobody_can_fly_are_refused() -> None:
    for speed_mps in (0.0, -1.0, float("nan"), float("inf")):
        with pytest.raises(ConfigError):
            built_in("circle8", speed_mps=speed_mps)


@given(north=st.floats(-90.0, 90.0), east=st.floats(-90.0, 90.0))
def test_distance_to_a_square_is_the_known_one(north: float, east: float) -> None:
    square = [[-40.0, -40.0], [40.0, -40.0], [40.0, 40.0], [-40.0, 40.0]]
    expected = np.hypot(max(abs(north) - 40.0, 0.0), max(abs(east) - 40.0, 0.0))
    assert distance_to_polygon([north, east], square) == pytest.approx(expected, abs=1e-9)
    assert distance_to_polygon([north, east], square[::-1]) == pytest.approx(expected, abs=1e-9)


def test_distance_to_a_hollow_polygon_counts_the_hollow_as_outside() -> None:
    u_shape = [
        [0.0, 0.0],
        [30.0, 0.0],
        [30.0, 10.0],
        [10.0, 10.0],
        [10.0, 20.0],
        [30.0, 20.0],
        [30.0, 30.0],
        [0.0, 30.0],
    ]
    assert distance_to_polygon([[20.0, 15.0], [20.0, 5.0], [5.0, 15.0]], u_shape) == pytest.approx([5.0, 0.0, 0.0])


def test_who_is_exactly_south_of_a_corner_is_outside() -> None:
    triangle = [(-34.7, -37.0), (26.6, 30.4), (32.2, -6.9)]
    for _, east in triangle:
        assert distance_to_polygon([-200.0, east], triangle) > 100.0


# --- what goes wrong, ghosts, wind, home ------------------------------------------------------------------------------

EVENTFUL = """\
name = "eventful"
duration_s = 60.0
home = [47.0, 8.0, 400.0]
[wind]
velocity_ne_mps = [3.0, -1.0]
gust_sigma_mps = 1.5
[[vehicle]]
start_ned_m = [-200.0, 0.0, -50.0]
goal_ned_m  = [ 200.0, 0.0, -50.0]
airframe = "category1"
interval_s = 1.0
[[vehicle]]
start_ned_m = [-200.0, 0.0, -50.0]
goal_ned_m  = [ 0.0, 90.0, -50.0]
route_ned_m = [[0.0, 0.0, -50.0], [0.0, 50.0, -60.0]]
ghost = true
transmitter_ned_m = [10.0, 20.0, 0.0]
[[vehicle]]
start_ned_m = [100.0, 0.0, -50.0]
goal_ned_m  = [100.0, 90.0, -50.0]
silent = true
[[event]]
at_s = 20.0
vehicle = 1
what = "gnss-jump"
north_m = 30.0
[[event]]
at_s = 10.0
what = "gnss-outage"
duration_s = 5.0
"""


def test_events_wind_ghosts_and_home_arrive(write: Write) -> None:
    scenario = load_scenario(write(EVENTFUL))
    assert scenario.home_deg_m == (47.0, 8.0, 400.0)
    assert scenario.wind == Wind((3.0, -1.0), 1.5)
    assert [(event.at_s, event.vehicle, event.what) for event in scenario.events] == [
        (10.0, 0, "gnss-outage"),
        (20.0, 1, "gnss-jump"),
    ]
    assert scenario.events[1].figures == {"north_m": 30.0, "east_m": 0.0, "down_m": 0.0, "duration_s": 0.0}
    real, ghost, silent = scenario.vehicles
    assert (real.airframe, real.interval_s, real.cooperative) == ("category1", 1.0, True)
    assert ghost.ghost and not ghost.cooperative and ghost.transmitter_ned_m == (10.0, 20.0, 0.0)
    assert ghost.route_ned_m == ((0.0, 0.0, -50.0), (0.0, 50.0, -60.0))
    assert silent.silent


@pytest.mark.parametrize(
    "old, new, told",
    [
        ('what = "gnss-jump"', 'what = "gnss-jmp"', "scenario.toml:25: event 1: what must be one of gnss-outage"),
        ("north_m = 30.0", "north = 30.0", "scenario.toml:26: event 1: north is not known here"),
        ("north_m = 30.0", "north_m = nan", "event 1: north_m must be a finite number"),
        ("at_s = 10.0", "at_s = -1.0", "scenario.toml:28: event 2: at_s must be at least 0"),
        ("vehicle = 1", "vehicle = 1.5", "event 1: vehicle must be a system id, or 0 for all"),
        ("vehicle = 1", "vehicle = 9", "scenario.toml:24: event 1: vehicle must be at most 3: there is no vehicle 9"),
        ("gust_sigma_mps = 1.5", "gusts = 1.5", "scenario.toml:6: wind: gusts is not known here"),
        ("[wind]", "[[wind]]", "wind must be written as [wind]"),
        ("home = [47.0, 8.0, 400.0]", "home = [97.0, 8.0, 400.0]", "scenario.toml:3: home is no place on Earth"),
        ('airframe = "category1"', 'autopilot = "inav"', "vehicle 1: autopilot must be px4 or ardupilot, not 'inav'"),
        ("ghost = true", "ghost = true\ncooperative = true", "cooperative must be false: a ghost avoids nobody"),
        ("ghost = true\n", "", "vehicle 2: route_ned_m is for vehicles with cooperative = false"),
        ("ghost = true", "cooperative = false", "vehicle 2: transmitter_ned_m is for ghosts"),
        ("[[0.0, 0.0, -50.0], [0.0, 50.0, -60.0]]", "[[0.0, 0.0]]", "route_ned_m must be [north, east, down]"),
        ("[[0.0, 0.0, -50.0], [0.0, 50.0, -60.0]]", "[[0.0, 0.0, 5.0]]", "route_ned_m is not in the air"),
    ],
)
def test_what_is_wrong_with_them_is_told_by_line_and_key(write: Write, old: str, new: str, told: str) -> None:
    path = write(EVENTFUL.replace(old, new, 1))
    with pytest.raises(ConfigError) as refused:
        load_scenario(path)
    assert told in str(refused.value)
    assert str(path) in str(refused.value)


def test_a_vehicle_may_have_an_autopilot_of_its_own(write: Write) -> None:
    own, *others = load_scenario(write(EVENTFUL.replace('airframe = "category1"', 'autopilot = "ardupilot"'))).vehicles
    assert own.autopilot == "ardupilot" and {each.autopilot for each in others} == {None}


def test_both_kinds_of_file_say_the_same_of_a_vehicle(write: Write, geojson: Callable[..., str]) -> None:
    said = {
        "airframe_m": 1.5, "sigma_m": 2.0, "extended": False, "ghost": True, "silent": True, "interval_s": 0.5,
        "airframe": "category1", "autopilot": "ardupilot",
    }  # fmt: skip
    assert said.keys() == VehicleKeys.__annotations__.keys()
    head = 'name = "one"\nduration_s = 9.0\n[[vehicle]]\nstart_ned_m = [0, 0, -50]\ngoal_ned_m = [99, 0, -50]\n'
    lines = "".join(f"{key} = {json.dumps(value)}\n" for key, value in said.items())
    (of_toml,) = load_scenario(write(head + lines)).vehicles
    (of_geojson,) = load_tracks(geojson(track([8.0, 47.0], [8.001, 47.0], **said))).vehicles
    for spec in (of_toml, of_geojson):
        assert {key: getattr(spec, key) for key in said} == said


def test_ghosts_may_be_anywhere_even_in_another_vehicle() -> None:
    real = VehicleSpec((0.0, 0.0, -50.0), (9.0, 0.0, -50.0))
    Scenario("haunted", 9.0, (real, replace(real, ghost=True, cooperative=False)))
    with pytest.raises(ConfigError, match="vehicles 1 and 3 start in the same place"):
        Scenario("crowded", 9.0, (real, replace(real, ghost=True, cooperative=False), real))


# --- tracks -----------------------------------------------------------------------------------------------------------


def track(*points: list[float], **properties: object) -> dict[str, object]:
    geometry = {"type": "LineString", "coordinates": list(points)}
    return {"type": "Feature", "properties": properties, "geometry": geometry}


@pytest.fixture
def geojson(tmp_path: Path) -> Callable[..., str]:
    def write_features(*features: object) -> str:
        path = tmp_path / "tracks.geojson"
        path.write_text(json.dumps({"type": "FeatureCollection", "features": list(features)}))
        return str(path)

    return write_features


def test_tracks_become_vehicles_that_fly_them(geojson: Callable[..., str]) -> None:
    path = geojson(
        track([8.0, 47.0, 500.0], [8.001, 47.0, 520.0], [8.001, 47.001, 500.0], times=[0, 10, 20], operator="somebody"),
        {"type": "Feature", "properties": None, "geometry": {"type": "Point", "coordinates": [8.0, 47.0]}},
        track([8.0, 47.001], [8.001, 47.001], speed_mps=7.0, cooperative=True, sigma_m=2.0),
    )
    scenario = resolve_scenario(path)
    first, second = scenario.vehicles
    assert scenario.name == "tracks" and scenario.home_deg_m is not None
    assert scenario.home_deg_m == pytest.approx((47.0005, 8.0005, 450.0))
    assert first.start_ned_m == pytest.approx((-55.6, -38.0, -50.0), abs=0.3)
    assert first.route_ned_m == (pytest.approx((-55.6, 38.0, -70.0), abs=0.3),)
    assert not first.cooperative and first.speed_mps == pytest.approx((78.6 + 112.9) / 20.0, rel=0.02)
    assert second.cooperative and second.speed_mps == 7.0 and second.goal_ned_m[2] == pytest.approx(-50.0, abs=0.1)
    assert resolve_scenario(path, 1).vehicles == (first,)


@pytest.mark.parametrize("latitude_deg", [-17.0, 0.0])
def test_a_track_may_cross_the_date_line(geojson: Callable[..., str], latitude_deg: float) -> None:
    scenario = load_tracks(geojson(track([179.999, latitude_deg, 500.0], [-179.999, latitude_deg, 500.0])))
    (vehicle,) = scenario.vehicles
    assert scenario.home_deg_m == (latitude_deg, pytest.approx(-180.0), 450.0)
    assert -112.0 < vehicle.start_ned_m[1] < -106.0 and 106.0 < vehicle.goal_ned_m[1] < 112.0


@pytest.mark.parametrize(
    "feature, told",
    [
        (track([8.0, 47.0]), "feature 1: coordinates must list at least two points"),
        (track([8.0, 47.0], [8.0, 47.0]), "feature 1: the track goes nowhere"),
        (track([8.0, 97.0], [8.0, 47.0]), "feature 1: coordinates: [8.0, 97.0] is no place on Earth"),
        (track([8.0, 47.0], [8.0]), "a point is [longitude, latitude, altitude]"),
        (track([8.0, 47.0], [12.0, 47.0]), "km from the middle of the tracks"),
        (track([8.0, 47.0], [8.001, 47.0], speed_mps=-1), "feature 1: speed_mps must be greater than 0"),
        (track([8.0, 47.0], [8.001, 47.0], times=[1]), "times must be seconds, one for each of 2 points"),
        (track([8.0, 47.0], [8.001, 47.0], times=[1, 1]), "times must rise"),
        (track([8.0, 47.0], [10**400, 47.0]), "is not a finite number"),
        (track([8.0, 47.0], [8.001, 47.0], times=[1, 10**400]), "times must be seconds"),
        (track([8.0, 47.0], [8.001, 47.0], sigma_m=10**400), "sigma_m must be a finite number"),
        (
            track([8.0, 47.0], [8.001, 47.0], autopilot="inav"),
            "feature 1: autopilot must be px4 or ardupilot, not 'inav'",
        ),
        (track([8.0, 47.0], [8.001, 47.0], autopilot=7), "feature 1: autopilot must be"),
        (track([8.0, 47.0], [8.001, 47.0], ghost=True, cooperative=True), "feature 1: cooperative must be false"),
        (track([8.0, 47.0], [8.001, 47.0], interval_s=0), "feature 1: interval_s must be at least 0.02, not 0"),
        ({"type": "Feature"}, "has no feature with a LineString"),
    ],
)
def test_tracks_that_cannot_be_flown_are_refused(geojson: Callable[..., str], feature: object, told: str) -> None:
    path = geojson(feature)
    with pytest.raises(ConfigError) as refused:
        load_tracks(path)
    assert told in str(refused.value) and path in str(refused.value)


def test_all_mistakes_of_tracks_are_told_at_once(geojson: Callable[..., str]) -> None:
    def told_of(*features: object) -> list[str]:
        with pytest.raises(ConfigError) as refused:
            load_tracks(geojson(*features))
        return [line.split("geojson: ")[1].split(" must ")[0] for line in (str(refused.value), *refused.value.others)]

    points = [8.0, 47.0], [8.001, 47.0]
    wrong = track(*points, sigma_m=-1, ghost=1), track(*points), track(*points, speed_mps=0)
    assert told_of(*wrong) == ["feature 1: sigma_m", "feature 1: ghost", "feature 3: speed_mps"]
    assert told_of(track(), track(*points), track()) == ["feature 1: coordinates", "feature 3: coordinates"]
    assert len(told_of(*(track() for _ in range(50)))) == MOST_FAULTS


@pytest.mark.parametrize(
    "content, told",
    [(b"{", "tracks.json:1: is not JSON"), (b"[]", "is not a GeoJSON FeatureCollection"), (b"\xff", "is not UTF-8")],
)
def test_what_is_no_geojson_is_refused(tmp_path: Path, content: bytes, told: str) -> None:
    path = tmp_path / "tracks.json"
    path.write_bytes(content)
    with pytest.raises(ConfigError) as refused:
        load_tracks(path)
    assert told in str(refused.value)
