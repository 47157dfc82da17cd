"""The configuration of a daemon: made from the keys of a file and of the command line, and written back to a file."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator, Mapping
from dataclasses import asdict, astuple, dataclass, field, replace
from enum import StrEnum
from pathlib import Path
from typing import Any

import msgspec

from ridlink.avoidance.settings import HalfplaneSettings
from ridlink.avoidance.types import SolverKind
from ridlink.checked_toml import MOST_FAULTS, KeyFault
from ridlink.daemon.config_file import SOLVER_TABLES, FlatConfig, config_text, line_of, overridden, read_config_text
from ridlink.engine import EngineConfig, Goal
from ridlink.errors import ConfigError
from ridlink.links import LinkUrl, SigningOptions, parse_link_url, refuse_to_speak_to_oneself
from ridlink.links.signing_options import LINK_ID_RANGE
from ridlink.metrics import parse_metrics_address
from ridlink.own_ship.broadcast import Form
from ridlink.ranges import Range
from ridlink.remote_id.accuracy import AccuracyConvention
from ridlink.separation.chance import ChanceBound
from ridlink.separation.definitions import Definition
from ridlink.setpoint import VelocityLimits
from ridlink.words import unknown_name

DEFAULT_VEHICLE = "udpin:127.0.0.1:14540"
DEFAULT_REMOTE_ID = "udpout:127.0.0.1:14650"
CONTROL_PERIOD_S = 0.1

ENGINE_KEYS = {
    "standby": "standby",
    "definition": "definition",
    "eta": "eta",
    "chance_bound": "chance_bound",
    "accuracy_convention": "accuracy_convention",
    "solver": "solver",
    "cruise": "cruise_mps",
    "airframe": "airframe_m",
    "airframe_height": "airframe_height_m",
    "vertical": "vertical_avoidance",
    "vertical_cost": "vertical_cost",
    "vertical_band": "vertical_band_m",
    "min_height": "min_height_m",
    "max_height": "max_height_m",
    "vehicle_sysid": "vehicle_sysid",
    "uas_id": "uas_id",
    "filter_positions": "filter_positions",
    "guard": "guard",
    "takeoff_aware": "takeoff_aware",
    "takeoff_height": "takeoff_height_m",
    "allow_v1": "allow_v1",
    "broadcast": "broadcast",
    "broadcast_form": "broadcast_form",
    "operator_id": "operator_id",
    "dry_run": "dry_run",
}
"""Keys whose values are fields of `EngineConfig`, unchanged, and the names of these fields."""

LIMIT_KEYS = {"v_max": "horizontal_mps", "vz_max": "vertical_mps", "a_max": "acceleration_mps2"}
"""The same for `setpoint.VelocityLimits`."""

KEY_RANGES: dict[str, Range] = {
    **{key: EngineConfig.RANGES[name] for key, name in ENGINE_KEYS.items() if name in EngineConfig.RANGES},
    **{key: VelocityLimits.RANGES[name] for key, name in LIMIT_KEYS.items()},
    "response_time": HalfplaneSettings.RANGES["response_time_s"],
    "signing_link_id": LINK_ID_RANGE,
}
"""Ranges of the keys whose values are numbers. Those of tables stand with the settings of the solvers."""

NAMES: dict[str, type[StrEnum]] = {
    "definition": Definition,
    "chance_bound": ChanceBound,
    "accuracy_convention": AccuracyConvention,
    "solver": SolverKind,
    "broadcast_form": Form,
}
"""Keys whose values are names, and the names that are allowed."""


@dataclass(frozen=True, slots=True)
class DaemonConfig:
    """One daemon.

    Args:
        vehicle: Link to the autopilot.
        remote_id: Link on which the Remote ID of others is received.
        engine: Configuration of the engine; `broadcast_to` decides its `broadcast_apart`.
        broadcast_to: Link on which the own Remote ID is transmitted; None: the link `remote_id`.
        signing: How the vehicle link is signed; None: it is not signed.
        metrics: Host and port where Prometheus metrics are served; None: nowhere.
        log: Recording of everything received and sent, a .tlog; None for none.
        input_log: Recording from which the decisions can be replayed, see `input_log`; None for none.
        period_s: Time between decisions. The study of vehicle response is valid for 0.1 s.

    Raises:
        ConfigError: If the period is out of its range, a connection string is invalid, two links would talk to each
            other, or a link to transmit on is given and nothing is transmitted.
    """

    vehicle: LinkUrl = field(default_factory=lambda: parse_link_url(DEFAULT_VEHICLE))
    remote_id: LinkUrl = field(default_factory=lambda: parse_link_url(DEFAULT_REMOTE_ID))
    engine: EngineConfig = field(default_factory=EngineConfig)
    broadcast_to: LinkUrl | None = None
    signing: SigningOptions | None = None
    metrics: tuple[str, int] | None = None
    log: Path | None = None
    input_log: Path | None = None
    period_s: float = CONTROL_PERIOD_S

    def __post_init__(self) -> None:
        for name in ("vehicle", "remote_id"):  # a connection string is accepted in place of a link
            value = getattr(self, name)
            if isinstance(value, str):
                object.__setattr__(self, name, parse_link_url(value))
        refuse_to_speak_to_oneself({"vehicle": self.vehicle, "rid": self.remote_id, "broadcast-to": self.broadcast_to})
        if self.broadcast_to is not None and not self.engine.broadcast:
            raise ConfigError("broadcast-to says where to transmit, and nothing is transmitted: give broadcast, too")
        apart = self.broadcast_to is not None
        if apart is not self.engine.broadcast_apart:
            object.__setattr__(self, "engine", replace(self.engine, broadcast_apart=apart))
        if not 0.02 <= self.period_s <= 0.25:
            raise ConfigError(f"period must lie between 0.02 and 0.25 s, got {self.period_s}")


def daemon_config(flat: FlatConfig, config_file: str | None = None) -> DaemonConfig:
    """The configuration that the keys of a file describe.

    Args:
        flat: The keys.
        config_file: The file they were read from, which must not be written to.

    Raises:
        ConfigError: If a value is out of range, or two keys name one file; the text names it.
    """
    _refuse_one_file_for_two({
        "config": config_file,
        "signing-key": flat.signing_key,
        "signing-state": flat.signing_state,
        "log": flat.log,
        "input-log": flat.input_log,
    })  # fmt: skip

    given = {key: value for key, value in msgspec.structs.asdict(flat).items() if value is not None}
    for key, kind in NAMES.items():
        if key in given:
            given[key] = _named(kind, key.replace("_", "-"), given[key])
    for key, allowed in KEY_RANGES.items():
        if key in given:
            allowed.check(key.replace("_", "-"), given[key])
    tables = {table: dict(given.get(table, {})) for table in SOLVER_TABLES}
    if flat.response_time is not None:
        for table in (SolverKind.HALFPLANE, SolverKind.GRADED):
            tables[table]["response_time_s"] = flat.response_time
    default = EngineConfig()
    try:
        engine = EngineConfig(
            goal=None if flat.goal is None else Goal(*flat.goal),
            limits=replace(default.limits, **{name: given[key] for key, name in LIMIT_KEYS.items() if key in given}),
            obstacles=tuple(tuple(table.polygon) for table in flat.obstacle or ()),
            **{name: given[key] for key, name in ENGINE_KEYS.items() if key in given},
            **{table: replace(getattr(default, table), **constants) for table, constants in tables.items()},
        )
    except ConfigError:
        raise
    except ValueError as error:
        raise ConfigError(str(error)) from error
    return DaemonConfig(
        vehicle=parse_link_url(given.get("vehicle", DEFAULT_VEHICLE)),
        remote_id=parse_link_url(given.get("rid", DEFAULT_REMOTE_ID)),
        engine=engine,
        broadcast_to=None if flat.broadcast_to is None else parse_link_url(flat.broadcast_to),
        signing=SigningOptions.of(flat.signing_key, flat.require_signature, flat.signing_link_id, flat.signing_state),
        metrics=None if flat.metrics is None else parse_metrics_address(flat.metrics),
        log=None if flat.log is None else Path(flat.log),
        input_log=None if flat.input_log is None else Path(flat.input_log),
    )


def configured(config_file: str | None, over: Mapping[str, Any]) -> DaemonConfig:
    """The configuration of a file, if there is one, with the options that override it.

    Args:
        config_file: TOML; None for none.
        over: Options by key, None if not given.

    Raises:
        ConfigError: As `daemon_config`; the text names the line of the file, or the option. Up to four more mistakes,
            if none follows from another, as `others`.
        OSError: If the file cannot be read.
    """
    text = "" if config_file is None else config_text(config_file)
    flat = FlatConfig() if config_file is None else read_config_text(text, config_file)
    faults: list[str] = []
    while len(faults) < MOST_FAULTS:
        try:
            config = daemon_config(overridden(flat, over), config_file)
        except ConfigError as error:
            if faults and not isinstance(error, KeyFault):
                break  # it may follow from what was taken out
            told, without = _placed(error, flat, over, config_file, text)
            faults.append(told)
            if without is None:
                break
            flat, over = without
        else:
            if not faults:
                return config
            break
    raise ConfigError(*faults)


def _placed(
    error: ConfigError, flat: FlatConfig, over: Mapping[str, Any], config_file: str | None, text: str
) -> tuple[str, tuple[FlatConfig, Mapping[str, Any]] | None]:
    """The error text with line or option, and the configuration without the key at fault; None if it is unknown."""
    for table, key, others in _without_each(flat):
        if _complaint(overridden(others, over), config_file) != str(error):
            line = line_of(text, key, table)
            if key == "obstacle" and (named := re.match(r"obstacle (\d+)", str(error))):
                line = line_of(text, "polygon", key, int(named[1]))
            return f"{config_file}{line}: {_with_name(key, error)}", (others, over)
    for key in (name for name, value in over.items() if value is not None):
        remaining = {**over, key: None}
        if _complaint(overridden(flat, remaining), config_file) != str(error):
            return _with_name(key.replace("_", "-"), error), (flat, remaining)
    return str(error), None


def _with_name(key: str, error: ConfigError) -> str:
    """The error text, with the name of the key or option in front if the text does not contain it."""
    named = re.search(rf"\b{re.sub('[-_]', '[-_]', key)}\b", str(error))
    return str(error) if named else f"{key}: {error}"


def _without_each(flat: FlatConfig) -> Iterator[tuple[str, str, FlatConfig]]:
    """Each key that is given, with its table ("": the top), and the configuration without it."""
    for key, value in msgspec.structs.asdict(flat).items():
        if isinstance(value, dict):
            for inner in value:
                others = {name: number for name, number in value.items() if name != inner}
                yield key, inner, msgspec.structs.replace(flat, **{key: others})
        elif value is not None:
            yield "", key, msgspec.structs.replace(flat, **{key: None})


def _complaint(flat: FlatConfig, config_file: str | None) -> str:
    """The error text for a configuration, empty if it is valid."""
    try:
        daemon_config(flat, config_file)
    except ConfigError as error:
        return str(error)
    return ""


def _refuse_one_file_for_two(files: Mapping[str, str | None]) -> None:
    """Refuse one file for two uses: an output would replace an input, and two recordings would destroy each other."""
    seen: dict[str, str] = {}
    for key, name in files.items():
        if name is None or (os.path.exists(name) and not os.path.isfile(name)):  # for example /dev/null, or a pipe
            continue
        other = seen.setdefault(os.path.realpath(name), key)
        if other != key:
            raise ConfigError(f"{key} and {other} name the same file, {name}: give {key} one of its own")


def _named(kind: type[StrEnum], what: str, name: str) -> StrEnum:
    """The member of that name.

    Raises:
        KeyFault: If there is none; the text lists the names that are allowed.
    """
    try:
        return kind(name)
    except ValueError:
        raise KeyFault(unknown_name(what, name, kind), what) from None


def as_toml(config: DaemonConfig) -> str:
    """The whole configuration, with defaults, as a file that `config_file.read_config_file` accepts.

    Raises:
        ConfigError: If a name is not UTF-8, as those of files need not be, but TOML is.
    """
    engine, signing, metrics = config.engine, config.signing, config.metrics
    values: dict[str, Any] = {
        "vehicle": str(config.vehicle),
        "rid": str(config.remote_id),
        "goal": None if engine.goal is None else [each for each in astuple(engine.goal)[:3] if each is not None],
        **{key: getattr(engine, name) for key, name in ENGINE_KEYS.items()},
        "operator_id": engine.operator_id or None,
        **{key: getattr(engine.limits, name) for key, name in LIMIT_KEYS.items()},
        "broadcast_to": None if config.broadcast_to is None else str(config.broadcast_to),
        "signing_key": None if signing is None else str(signing.key_file),
        "require_signature": None if signing is None else signing.required,
        "signing_link_id": None if signing is None else signing.link_id,
        "signing_state": None if signing is None else str(signing.state),
        "metrics": None if metrics is None else f"{metrics[0]}:{metrics[1]}",
        "log": None if config.log is None else str(config.log),
        "input_log": None if config.input_log is None else str(config.input_log),
    }
    lines = [f"{key} = {_toml(value)}" for key, value in values.items() if value is not None]
    for table in SOLVER_TABLES:
        lines += ["", f"[{table}]"]
        lines += [f"{key} = {_toml(value)}" for key, value in asdict(getattr(engine, table)).items()]
    for polygon in engine.obstacles:
        lines += ["", "[[obstacle]]", f"polygon = {_toml(polygon)}"]
    return "\n".join(lines) + "\n"


def _toml(value: Any) -> str:
    """A value in TOML: as in JSON, except for numbers that JSON lacks and the one character that TOML alone escapes."""
    if isinstance(value, float):
        return str(value)
    try:
        return msgspec.json.encode(value).decode().replace("\x7f", "\\u007f")
    except UnicodeEncodeError:
        raise ConfigError(f"{value} is not UTF-8 text, and a configuration is: give it another name") from None
