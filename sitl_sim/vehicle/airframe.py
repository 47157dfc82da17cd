"""Airframe types from TOML files: their response under each autopilot, and their battery.

The package contains the vehicles of the two measured autopilots and one type for each category of the paper's Table
III. Other files of the same form can be used, too.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from functools import cache
from pathlib import Path
from typing import TypeVar

from ridlink.checked_toml import CheckedTable, read_toml
from ridlink.errors import ConfigError
from ridlink.words import unknown_name
from sitl_sim.vehicle.battery import BatteryType
from sitl_sim.vehicle.models import Ideal, Model, ShapedTarget, VelocityFeedback, made_for_speed

Figures = TypeVar("Figures")

FOLDER = Path(__file__).parent / "airframes"

AIRFRAMES = tuple(sorted(path.stem for path in FOLDER.glob("*.toml")))
"""Types that come with the package: the files of its folder."""

MEASURED = {"px4": "px4-sih-quad", "ardupilot": "ardupilot-quad", "ideal": "px4-sih-quad"}
"""The default type of each autopilot: the one in which it was measured."""


@dataclass(frozen=True, slots=True)
class Airframe:
    """One type.

    Args:
        name: File name without its suffix.
        title: One line of description.
        feedback: Response under PX4; None if unknown.
        shaped: Response under ArduPilot; None if unknown.
        battery: Its battery.
    """

    name: str
    title: str
    feedback: VelocityFeedback | None
    shaped: ShapedTarget | None
    battery: BatteryType

    def model(self, autopilot: str) -> Model:
        """The response model under an autopilot.

        Raises:
            ConfigError: If its file has no model for this autopilot.
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
    """Load a type by its name, or from a file (any name that ends in .toml or has a slash).

    Raises:
        ConfigError: If the name is unknown or the file is wrong; with file, line, key and the right form. One line for
            each mistake, the first as its text, up to four more as `others`.
        OSError: If the file cannot be read.
    """
    path = Path(name_or_path)
    if not (name_or_path.endswith(".toml") or "/" in name_or_path):
        if name_or_path not in AIRFRAMES:
            raise ConfigError(f"{unknown_name('airframe', name_or_path, AIRFRAMES)}, or a .toml file")
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
    """The response model of an airframe under an autopilot, made fast enough for a cruise speed.

    Args:
        autopilot: "ideal", "px4" or "ardupilot".
        speed_mps: Cruise speed.
        airframe: Name or path; None: the type in which the autopilot was measured.

    Raises:
        ConfigError: If the airframe is unknown or has no model for this autopilot.
        ValueError: If there is no such autopilot.
    """
    chosen = load_airframe(airframe or MEASURED.get(autopilot, MEASURED["ideal"]))
    return made_for_speed(chosen.model(autopilot), speed_mps)
