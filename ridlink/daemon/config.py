"""What a daemon is told: its configuration, from the keys that a file and flags give, and back to a file."""

from __future__ import annotations

import difflib
import os
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields, replace
from enum import StrEnum
from pathlib import Path
from typing import Any, TypeVar

import msgspec

from ridlink.avoidance.types import SolverKind
from ridlink.daemon.config_file import SOLVER_TABLES, FlatConfig, config_text, line_of, overridden, read_config_text
from ridlink.engine import EngineConfig, Goal
from ridlink.errors import ConfigError
from ridlink.links import LinkUrl, SigningOptions, parse_link_url, refuse_to_speak_to_oneself
from ridlink.metrics import parse_metrics_address
from ridlink.own_ship.broadcast import Form
from ridlink.remote_id.accuracy import AccuracyConvention
from ridlink.separation.chance import ChanceBound
from ridlink.separation.definitions import Definition
from ridlink.setpoint import VelocityLimits

DEFAULT_VEHICLE = "udpin:127.0.0.1:14540"
DEFAULT_REMOTE_ID = "udpout:127.0.0.1:14650"
CONTROL_PERIOD_S = 0.1

Name = TypeVar("Name", bound=StrEnum)


@dataclass(frozen=True, slots=True)
class DaemonConfig:
    """One daemon.

    Args:
        vehicle: Link to the autopilot.
        remote_id: Link on which the Remote ID of others is heard.
        engine: What the engine is told.
        broadcast_to: Link on which the own Remote ID is transmitted; None: the one on which others are heard.
        signing: How the vehicle link is signed; None: not at all.
        metrics: Host and port where Prometheus metrics are served; None: nowhere.
        log: Recording of everything received and sent, a .tlog; None for none.
        input_log: Recording from which the flight can be decided again, see `input_log`; None for none.
        period_s: Time between decisions. The response study holds for 0.1 s.
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
        for name in ("vehicle", "remote_id"):  # a connection string is as good as what it names
            value = getattr(self, name)
            if isinstance(value, str):
                object.__setattr__(self, name, parse_link_url(value))
        refuse_to_speak_to_oneself({"vehicle": self.vehicle, "rid": self.remote_id, "broadcast-to": self.broadcast_to})
        if not 0.02 <= self.period_s <= 0.25:
            raise ConfigError(f"period must lie between 0.02 and 0.25 s, got {self.period_s}")


def daemon_config(flat: FlatConfig, config_file: str | None = None) -> DaemonConfig:
    """The configuration that the keys describe.

    Args:
        flat: The keys.
        config_file: Where they were read, which nothing may be written to.

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

    def or_default(value: Any, default: Any) -> Any:
        return default if value is None else value

    engine = EngineConfig()
    limits = engine.limits
    halfplane, graded = dict(flat.halfplane or {}), dict(flat.graded or {})
    if flat.response_time is not None:
        halfplane["response_time_s"] = graded["response_time_s"] = flat.response_time
    try:
        engine = EngineConfig(
            goal=None if flat.goal is None else Goal(*flat.goal),
            standby=or_default(flat.standby, False),
            definition=_named(Definition, "definition", or_default(flat.definition, engine.definition)),
            eta=or_default(flat.eta, engine.eta),
            chance_bound=_named(ChanceBound, "chance-bound", or_default(flat.chance_bound, engine.chance_bound)),
            accuracy_convention=_named(
                AccuracyConvention,
                "accuracy-convention",
                or_default(flat.accuracy_convention, engine.accuracy_convention),
            ),
            cruise_mps=or_default(flat.cruise, engine.cruise_mps),
            airframe_m=or_default(flat.airframe, engine.airframe_m),
            airframe_height_m=flat.airframe_height,
            limits=VelocityLimits(
                or_default(flat.v_max, limits.horizontal_mps),
                or_default(flat.vz_max, limits.vertical_mps),
                or_default(flat.a_max, limits.acceleration_mps2),
            ),
            solver=_named(SolverKind, "solver", or_default(flat.solver, engine.solver)),
            halfplane=replace(engine.halfplane, **halfplane),
            graded=replace(engine.graded, **graded),
            rotation=replace(engine.rotation, **(flat.rotation or {})),
            obstacles=tuple(tuple(table.polygon) for table in flat.obstacle or ()),
            vertical_avoidance=or_default(flat.vertical, engine.vertical_avoidance),
            vertical_cost=or_default(flat.vertical_cost, engine.vertical_cost),
            vertical_band_m=or_default(flat.vertical_band, engine.vertical_band_m),
            min_height_m=or_default(flat.min_height, engine.min_height_m),
            max_height_m=or_default(flat.max_height, engine.max_height_m),
            vehicle_sysid=flat.vehicle_sysid,
            uas_id=flat.uas_id,
            filter_positions=or_default(flat.filter_positions, engine.filter_positions),
            guard=or_default(flat.guard, engine.guard),
            takeoff_aware=or_default(flat.takeoff_aware, engine.takeoff_aware),
            takeoff_height_m=or_default(flat.takeoff_height, engine.takeoff_height_m),
            allow_v1=or_default(flat.allow_v1, engine.allow_v1),
            broadcast=or_default(flat.broadcast, engine.broadcast),
            broadcast_form=_named(Form, "broadcast-form", or_default(flat.broadcast_form, engine.broadcast_form)),
            operator_id=or_default(flat.operator_id, engine.operator_id),
            dry_run=or_default(flat.dry_run, engine.dry_run),
        )
    except ConfigError:
        raise
    except ValueError as error:
        raise ConfigError(str(error)) from error
    return DaemonConfig(
        vehicle=parse_link_url(or_default(flat.vehicle, DEFAULT_VEHICLE)),
        remote_id=parse_link_url(or_default(flat.rid, DEFAULT_REMOTE_ID)),
        engine=engine,
        broadcast_to=None if flat.broadcast_to is None else parse_link_url(flat.broadcast_to),
        signing=SigningOptions.of(flat.signing_key, flat.require_signature, flat.signing_link_id, flat.signing_state),
        metrics=None if flat.metrics is None else parse_metrics_address(flat.metrics),
        log=None if flat.log is None else Path(flat.log),
        input_log=None if flat.input_log is None else Path(flat.input_log),
    )


def configured(config_file: str | None, over: Mapping[str, Any]) -> DaemonConfig:
    """The configuration of a file, if there is one, and of the options that win over it.

    Args:
        config_file: TOML; None for none.
        over: Options by key, None where one is not given.

    Raises:
        ConfigError: As `daemon_config`; the text names the line of the file that it is about.
        OSError: If the file cannot be read.
    """
    if config_file is None:
        return daemon_config(overridden(FlatConfig(), over))
    text = config_text(config_file)
    flat = read_config_text(text, config_file)
    try:
        return daemon_config(overridden(flat, over), config_file)
    except ConfigError as error:
        for key, others in _without_each(flat):
            if _complaint(overridden(others, over), config_file) != str(error):
                named = re.search(rf"\b{key.replace('_', '[-_]')}\b", str(error))
                what = "" if named else f"{key}: "
                raise ConfigError(f"{config_file}{line_of(text, key)}: {what}{error}") from error
        raise


def _without_each(flat: FlatConfig) -> Iterator[tuple[str, FlatConfig]]:
    """Each key that is given, those of solvers' tables too, and the configuration without it."""
    for key, value in msgspec.structs.asdict(flat).items():
        if isinstance(value, dict):
            for inner in value:
                others = {name: number for name, number in value.items() if name != inner}
                yield inner, msgspec.structs.replace(flat, **{key: others})
        elif value is not None:
            yield key, msgspec.structs.replace(flat, **{key: None})


def _complaint(flat: FlatConfig, config_file: str) -> str:
    """What is wrong with a configuration, empty if nothing is."""
    try:
        daemon_config(flat, config_file)
    except ConfigError as error:
        return str(error)
    return ""


def _refuse_one_file_for_two(files: Mapping[str, str | None]) -> None:
    """What is written would replace what is read, and two recordings in one file are none."""
    seen: dict[str, str] = {}
    for key, name in files.items():
        if name is None or (os.path.exists(name) and not os.path.isfile(name)):  # as /dev/null, or a pipe
            continue
        other = seen.setdefault(os.path.realpath(name), key)
        if other != key:
            raise ConfigError(f"{key} and {other} name the same file, {name}: give {key} one of its own")


def _named(kind: type[Name], what: str, name: str) -> Name:
    """The member of that name.

    Raises:
        ConfigError: If there is none; the text says which there are.
    """
    try:
        return kind(name)
    except ValueError:
        near = difflib.get_close_matches(name, [str(member) for member in kind], n=1)
        hint = f"did you mean {near[0]!r}? " if near else ""
        raise ConfigError(f"unknown {what} {name!r}: {hint}known are {', '.join(kind)}") from None


def as_toml(config: DaemonConfig) -> str:
    """The whole configuration as a file that `config_file.read_config_file` takes, defaults included."""
    engine = config.engine
    lines = [
        f'vehicle = "{config.vehicle}"',
        f'rid = "{config.remote_id}"',
        f'definition = "{engine.definition}"',
        f"eta = {engine.eta}",
        f'chance_bound = "{engine.chance_bound}"',
        f'accuracy_convention = "{engine.accuracy_convention}"',
        f'solver = "{engine.solver}"',
        f"cruise = {engine.cruise_mps}",
        f"airframe = {engine.airframe_m}",
        f"v_max = {engine.limits.horizontal_mps}",
        f"vz_max = {engine.limits.vertical_mps}",
        f"a_max = {engine.limits.acceleration_mps2}",
        f"vertical = {str(engine.vertical_avoidance).lower()}",
        f"vertical_cost = {engine.vertical_cost}",
        f"vertical_band = {engine.vertical_band_m}",
        f"min_height = {engine.min_height_m}",
        f"max_height = {engine.max_height_m}",
        f"standby = {str(engine.standby).lower()}",
        f"filter_positions = {str(engine.filter_positions).lower()}",
        f"guard = {str(engine.guard).lower()}",
        f"takeoff_aware = {str(engine.takeoff_aware).lower()}",
        f"takeoff_height = {engine.takeoff_height_m}",
        f"allow_v1 = {str(engine.allow_v1).lower()}",
        f"dry_run = {str(engine.dry_run).lower()}",
        f"broadcast = {str(engine.broadcast).lower()}",
        f'broadcast_form = "{engine.broadcast_form}"',
    ]
    if engine.goal is not None:
        altitude = [] if engine.goal.altitude_m is None else [engine.goal.altitude_m]
        lines.append(f"goal = {[engine.goal.latitude_deg, engine.goal.longitude_deg, *altitude]}")
    if engine.vehicle_sysid is not None:
        lines.append(f"vehicle_sysid = {engine.vehicle_sysid}")
    if engine.uas_id is not None:
        lines.append(f"uas_id = {_quoted(engine.uas_id)}")
    if engine.operator_id:
        lines.append(f"operator_id = {_quoted(engine.operator_id)}")
    if config.broadcast_to is not None:
        lines.append(f'broadcast_to = "{config.broadcast_to}"')
    if config.signing is not None:
        lines += [
            f"signing_key = {_quoted(str(config.signing.key_file))}",
            f"require_signature = {str(config.signing.required).lower()}",
            f"signing_link_id = {config.signing.link_id}",
            f"signing_state = {_quoted(str(config.signing.state))}",
        ]
    if config.metrics is not None:
        lines.append(f'metrics = "{config.metrics[0]}:{config.metrics[1]}"')
    if engine.airframe_height_m is not None:
        lines.append(f"airframe_height = {engine.airframe_height_m}")
    if config.log is not None:
        lines.append(f"log = {_quoted(str(config.log))}")
    if config.input_log is not None:
        lines.append(f"input_log = {_quoted(str(config.input_log))}")
    for table_name in SOLVER_TABLES:
        settings = getattr(engine, table_name)
        lines += ["", f"[{table_name}]"]
        lines += [f"{item.name} = {getattr(settings, item.name)}" for item in fields(settings)]
    for polygon in engine.obstacles:
        lines += ["", "[[obstacle]]", f"polygon = {[list(vertex) for vertex in polygon]}"]
    return "\n".join(lines) + "\n"


def _quoted(text: str) -> str:
    """A TOML basic string: JSON's escapes are TOML's."""
    return msgspec.json.encode(text).decode()
