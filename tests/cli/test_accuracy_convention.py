"""What an accuracy code is taken for is one choice, the same in every command that judges by it."""

from __future__ import annotations

import json
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from ridlink.analysis.capacity import Airspace
from ridlink.campaign.chance import ErrorModel
from ridlink.campaign_runner.choice import Choice, Conditions
from ridlink.cli import cli
from ridlink.cli.options import ACCURACY_CONVENTION, ACCURACY_CONVENTIONS
from ridlink.engine import EngineConfig
from ridlink.remote_id.accuracy import DEFAULT_CONVENTION, AccuracyConvention
from ridlink.scenario import built_in
from ridlink.separation.definitions import Definition
from ridlink.view.recorded import read_history
from sitl_sim.autopilot import Start
from sitl_sim.demo.daemons import assignments
from sitl_sim.fleet_config import FleetConfig, FleetPorts
from tests.review.recordings import NORTHBOUND, SOUTHBOUND, recorded

CODED_M = {"letter": 12.256, "one-sigma": 30.0, "as-is": 10.0}
"""Three standard deviations of code 10, for a radius below 10 m."""


def option_of(path: str) -> click.Option:
    """The option of a command."""
    command: click.Command | None = cli
    context = click.Context(cli)
    for name in path.split():
        assert isinstance(command, click.Group)
        command = command.get_command(context, name)
    assert command is not None
    [found] = [each for each in command.params if "--accuracy-convention" in each.opts]
    assert isinstance(found, click.Option)
    return found


def test_the_names_are_those_of_the_conventions() -> None:
    assert list(ACCURACY_CONVENTIONS) == list(AccuracyConvention)
    assert EngineConfig().accuracy_convention == DEFAULT_CONVENTION == "letter"


@pytest.mark.parametrize("path", ["demo", "view", "top", "mqtt", "whatif", "report", "campaign run", "capacity"])
def test_every_command_that_judges_takes_the_same_option(path: str) -> None:
    option, of_daemon = option_of(path), option_of("avoid")
    assert isinstance(option.type, click.Choice) and option.default == DEFAULT_CONVENTION
    assert of_daemon.help == f"{option.help}  [default: {option.default}]"
    assert option.help == ACCURACY_CONVENTION


@pytest.fixture
def log(tmp_path: Path) -> Path:
    return recorded(tmp_path / "f.tlog", [NORTHBOUND, SOUTHBOUND], 26.0)


@pytest.mark.parametrize("convention", ACCURACY_CONVENTIONS)
def test_recordings_are_judged_by_it(log: Path, convention: str) -> None:
    def run(*arguments: str) -> str:
        done = CliRunner().invoke(cli, [*arguments, str(log), "--accuracy-convention", convention])
        assert done.exit_code == 0
        return done.stdout

    radius_m = 7.5 + 2.0 * CODED_M[convention] + 2.0
    document = json.loads(run("whatif", "--definition", "odid-accuracy", "--json"))
    assert document["accuracy_convention"] == convention
    assert document["rows"][0]["least_margin_m"] == pytest.approx(6.0 - radius_m, abs=0.2)
    page = log.with_suffix(".html")
    row = json.loads(run("report", "--html", str(page)))
    assert row["margin_m"]["odid-accuracy"] == pytest.approx(6.0 - radius_m, abs=0.2)
    assert f"read by the convention {convention}" in page.read_text()
    _, history, _ = read_history([str(log)], convention=convention)
    assert history.at(100).scene().accuracy_bound_m == pytest.approx([CODED_M[convention]] * 2, abs=1e-3)


@pytest.mark.parametrize("convention", AccuracyConvention)
def test_fleets_are_flown_and_counted_by_it(convention: AccuracyConvention) -> None:
    """An error of 10 m per axis is 30 m of three sigma, 24.5 m for 95 %, and hence the code of 30 m."""
    coded_m = 3.0 * CODED_M[convention]
    choice = Choice(
        ("circle8",), (Definition.ODID_ACCURACY,), (ErrorModel.WHITE,), ("halfplane",),
        conditions=Conditions(accuracy_convention=convention),
    )  # fmt: skip
    [plan] = choice.plans()
    assert plan.accuracy_bound_m == pytest.approx(coded_m, abs=0.01)
    kept = choice.configuration([plan], 1).get("accuracy_convention", DEFAULT_CONVENTION)
    assert kept == convention
    space = Airspace(Definition.ODID_ACCURACY, 10.0, 0.1, 3, convention=convention)
    assert space.radius_m(1.0, 1.0, 10.0, 10.0) == pytest.approx(7.5 + 2.0 * coded_m + 2.0, abs=0.01)
    assigned = assignments(
        built_in("head-on"), Definition.ODID_ACCURACY, FleetConfig(start=Start.HOLDING),
        FleetPorts(vehicles=(1, 2), air=3), accuracy_convention=convention,
    )  # fmt: skip
    assert {each.config.engine.accuracy_convention for each in assigned} == {convention}


def test_a_campaign_under_the_default_says_no_more_than_it_did() -> None:
    """So that one that was begun before there was a choice can be resumed."""
    choice = Choice(("circle8",), ("snmac",), (ErrorModel.WHITE,), ("halfplane",))
    assert "accuracy_convention" not in choice.configuration(choice.plans(), 1)
