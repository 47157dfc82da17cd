"""Airframe types: how one flies under either autopilot, and what its battery holds, from TOML files.

The package ships the two measured autopilots' vehicles and one type for each category of the paper's Table III; any
other file of the same form will do.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cache
from pathlib import Path
from typing import TypeVar

from ridlink.checked_toml import CheckedTable, read_toml
from ridlink.errors import ConfigError
from sitl_sim.vehicle.battery import BatteryType
from sitl_sim.vehicle.models import Ideal, Model, ShapedTarget, VelocityFeedback, made_for_speed

Figures = TypeVar("Figures")

FOLDER = Path(__file__).parent / "airframes"

AIRFRAMES = ("ardupilot-quad", "category1", "category2", "category3", "category4", "px4-sih-quad")
"""Types that come with the package."""

MEASURED = {"px4": "px4-sih-quad", "ardupilot": "ardupilot-quad", "ideal": "px4-sih-quad"}
"""The type that each autopilot flies unless told otherwise: the one in which it was measured."""


@dataclass(frozen=True, slots=True)
class Airframe:
    """One type.

    Args:
        name: File name without its suffix.
        title: One line for people.
        feedback: How it flies under PX4; None: nobody knows.
        shaped: How it flies under ArduPilot; None: nobody knows.
        battery: What it carries.
    """

    name: str
    title: str
    feedback: VelocityFeedback | None
    shaped: ShapedTarget | None
    battery: BatteryType

    def model(self, autopilot: str) -> Model:
        """How it flies under an autopilot.

        Raises:
            ConfigError: If its file does not say.
            ValueError: If there is no such autopilot.
        """
        known: dict[str, Model | None] = {"ideal": Ideal(), "px4": self.feedback, "ardupilot": self.shaped}
        if autopilot not in known:
            raise ValueError(f"unknown autopilot {autopilot!r}: known are {', '.join(known)}")
        model = known[autopilot]
        if model is None:
            table = "feedback" if autopilot == "px4" else "shaped"
            raise ConfigError(
                f"airframe '{self.name}' does not say how it flies under {autopilot}: it has no [{table}]"
            )
        return model


@cache
def load_airframe(name_or_path: str) -> Airframe:
    """A type by its name, or from a file (anything that ends in .toml or has a slash).

    Raises:
        ConfigError: If the name is unknown or the file is wrong: file, line, key, what would be right. One line for
            each mistake, the first as its text, up to four more as `others`.
        OSError: If the file cannot be read.
    """
    path = Path(name_or_path)
    if not (name_or_path.endswith(".toml") or "/" in name_or_path):
        if name_or_path not in AIRFRAMES:
            raise ConfigError(f"unknown airframe '{name_or_path}': known are {', '.join(AIRFRAMES)}, or a .toml file")
        path = FOLDER / f"{name_or_path}.toml"
    top = read_toml(path)
    faults: list[ConfigError] = []
    feedback = _figures(top, "feedback", VelocityFeedback, faults)
    shaped = _figures(top, "shaped", ShapedTarget, faults)
    battery = _figures(top, "battery", BatteryType, faults)
    title = top.read(_title, faults)
    if title is None or faults:
        raise ConfigError(*map(str, faults))
    if battery is None:
        raise top.error("battery", "is missing: cells, capacity_wh, hover_w")
    return Airframe(path.stem, title, feedback, shaped, battery)


def _title(top: CheckedTable) -> str:
    title = top.text("title")
    top.take("source", "")
    top.nothing_else()
    return title


def _figures(top: CheckedTable, name: str, kind: type[Figures], faults: list[ConfigError]) -> Figures | None:
    def figures(table: CheckedTable) -> Figures:
        read = {field.name: table.number(field.name, above=0.0) for field in fields(kind)}  # type: ignore[arg-type]
        table.nothing_else()
        return kind(**read)

    return top.table(name).read(figures, faults) if top.has(name) else None


def model_for_speed(autopilot: str, speed_mps: float, airframe: str | None = None) -> Model:
    """How an autopilot flies an airframe, made fast enough for a cruise speed.

    Args:
        autopilot: "ideal", "px4" or "ardupilot".
        speed_mps: Cruise speed.
        airframe: Name or path; None: the one in which the autopilot was measured.

    Raises:
        ConfigError: If the airframe is unknown or says nothing of this autopilot.
        ValueError: If there is no such autopilot.
    """
    chosen = load_airframe(airframe or MEASURED.get(autopilot, MEASURED["ideal"]))
    return made_for_speed(chosen.model(autopilot), speed_mps)
