"""``--eta``: one range and one text, in whatever command it is given."""

from __future__ import annotations

import sys

import pytest

from ridlink.cli import main
from ridlink.cli.avoid import avoid
from ridlink.cli.campaign import run
from ridlink.cli.capacity import capacity
from ridlink.cli.whatif import whatif
from ridlink.separation.chance import DEFAULT_ETA, ETA_RANGE
from sitl_sim.cli import demo

COMMANDS = (
    ["avoid", "--standby"], ["campaign", "run", "-o", "/proc/never"], ["capacity"], ["demo"], ["whatif", "/dev/null"]
)  # fmt: skip


@pytest.mark.parametrize("eta", ["0.4999", "1", "0.9999999999", "-1", "nan", "inf"])
@pytest.mark.parametrize("command", COMMANDS, ids=" ".join)
def test_out_of_range_it_is_refused_with_the_same_text(
    command: list[str], eta: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "argv", ["ridlink", *command, "--eta", eta])
    with pytest.raises(SystemExit) as stop:
        main()
    told = f"ridlink: eta must lie between 0.5 and 0.999999999, got {eta}\n"
    assert (stop.value.code, *capsys.readouterr()) == (2, "", told)


def test_help_and_default_are_the_same_everywhere() -> None:
    options = [
        each for command in (avoid, run, capacity, demo, whatif) for each in command.params if each.name == "eta"
    ]
    assert len(options) == 5
    assert {option.help for option in options} == {
        f"Of chance: probability, at any one instant, that no neighbour comes too close.  [default: {DEFAULT_ETA}]"
    }
    assert {option.default for option in options} == {None, DEFAULT_ETA} and DEFAULT_ETA in ETA_RANGE
