"""What a daemon is told: one TOML file, overridden by flags, over defaults.

    vehicle = "udpin:127.0.0.1:14540"
    rid = "udpout:127.0.0.1:14650"
    goal = [47.39, 8.54, 100.0]        # degrees, degrees, metres above mean sea level (may be left out)
    definition = "candidate2"
    cruise = 10.0

    solver = "halfplane"

    [halfplane]                        # constants of that solver; likewise [graded], [rotation]
    response_time_s = 1.0

    [[obstacle]]                       # static, never entered
    polygon = [[47.391, 8.541], [47.392, 8.541], [47.392, 8.543]]

A key that is not known is an error, for a misspelt key must not pass as a default; so is a number that is none.
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, TypeVar

import msgspec

from ridlink.avoidance.settings import GradedSettings, RotationSettings
from ridlink.avoidance.types import HalfplaneSettings, SolverKind
from ridlink.checked_toml import parse_toml
from ridlink.engine import EngineConfig, Goal
from ridlink.errors import ConfigError
from ridlink.links import LinkUrl, SigningOptions, parse_link_url
from ridlink.metrics import parse_metrics_address
from ridlink.own_ship.broadcast import Form
from ridlink.separation.chance import ChanceBound
from ridlink.separation.definitions import Definition
from ridlink.setpoint import VelocityLimits

DEFAULT_VEHICLE = "udpin:127.0.0.1:14540"
DEFAULT_REMOTE_ID = "udpout:127.0.0.1:14650"
CONTROL_PERIOD_S = 0.1

SOLVER_TABLES = {
    SolverKind.HALFPLANE: HalfplaneSettings,
    SolverKind.GRADED: GradedSettings,
    SolverKind.ROTATION: RotationSettings,
}
"""Tables of a file, by the name of the solver whose constants they hold."""

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
        if not 0.02 <= self.period_s <= 0.25:
            raise ConfigError(f"period must lie between 0.02 and 0.25 s, got {self.period_s}")


class ObstacleTable(msgspec.Struct, forbid_unknown_fields=True, kw_only=True, frozen=True):
    """One [[obstacle]]."""

    polygon: list[tuple[float, float]]


class FlatConfig(msgspec.Struct, kw_only=True, frozen=True):
    """The keys of a file, which are those of the command line with underscores; None where a key is not given."""

    vehicle: str | None = None
    rid: str | None = None
    goal: Annotated[list[float], msgspec.Meta(min_length=2, max_length=3)] | None = None
    standby: bool | None = None
    definition: str | None = None
    eta: float | None = None
    chance_bound: str | None = None
    solver: str | None = None
    cruise: float | None = None
    airframe: float | None = None
    airframe_height: float | None = None
    v_max: float | None = None
    vz_max: float | None = None
    a_max: float | None = None
    response_time: float | None = None
    vertical: bool | None = None
    vertical_cost: float | None = None
    vertical_band: float | None = None
    min_height: float | None = None
    max_height: float | None = None
    vehicle_sysid: int | None = None
    uas_id: str | None = None
    filter_positions: bool | None = None
    log: str | None = None
    input_log: str | None = None
    guard: bool | None = None
    takeoff_aware: bool | None = None
    takeoff_height: float | None = None
    allow_v1: bool | None = None
    broadcast: bool | None = None
    broadcast_to: str | None = None
    broadcast_form: str | None = None
    operator_id: str | None = None
    signing_key: str | None = None
    require_signature: bool | None = None
    signing_link_id: int | None = None
    signing_state: str | None = None
    metrics: str | None = None
    dry_run: bool | None = None
    halfplane: dict[str, float] | None = None
    graded: dict[str, float] | None = None
    rotation: dict[str, float] | None = None
    obstacle: list[ObstacleTable] | None = None


def _line_of(text: str, key: str) -> str:
    """ ":line" of a key or table in a TOML text, empty if it cannot be told."""
    pattern = re.compile(rf"\s*(?:\[+\s*)?[\"']?{re.escape(key)}[\"']?\s*(?:=|\])")
    for number, line in enumerate(text.splitlines(), start=1):
        if pattern.match(line):
            return f":{number}"
    return ""


def _refuse_unknown(given: Mapping[str, Any], known: list[str], where: str, text: str) -> None:
    for key in given:
        if key not in known:
            near = difflib.get_close_matches(key.replace("-", "_"), known, n=1)
            hint = f"did you mean {near[0]!r}?" if near else f"known are {', '.join(known)}"
            raise ConfigError(f"{where}{_line_of(text, key)}: unknown key {key!r}: {hint}")


def _refuse_not_finite(value: Any, key: str, where: str, text: str) -> None:
    if isinstance(value, float) and not math.isfinite(value):
        raise ConfigError(f"{where}{_line_of(text, key)}: {key} must be a finite number, not {value}")
    if isinstance(value, dict):
        for name, inner in value.items():
            # Infinite means "stops at once" to the solver, and only there.
            if key not in SOLVER_TABLES or inner != math.inf:
                _refuse_not_finite(inner, name, where, text)
    if isinstance(value, list):
        for inner in value:
            _refuse_not_finite(inner, key, where, text)


def read_config_file(path: str | Path) -> FlatConfig:
    """Keys of a configuration file.

    Raises:
        ConfigError: If it is not TOML, has an unknown key, or a value of the wrong kind; the text names file, line and
            key.
        OSError: If it cannot be read.
    """
    where = str(path)
    try:
        text = Path(path).read_bytes().decode("utf-8")
    except UnicodeDecodeError as error:
        raise ConfigError(f"{where}: is not UTF-8 text: {error.reason}") from error
    return read_config_text(text, where)


def read_config_text(text: str, where: str) -> FlatConfig:
    """Keys of a configuration.

    Args:
        text: TOML.
        where: Whence it comes, for error texts.

    Raises:
        ConfigError: As `read_config_file`.
    """
    document = parse_toml(text, where)
    known = [item.name for item in msgspec.structs.fields(FlatConfig)]
    _refuse_unknown(document, known, where, text)
    for table_name, settings in SOLVER_TABLES.items():
        if isinstance(document.get(table_name), dict):
            _refuse_unknown(document[table_name], [item.name for item in fields(settings)], where, text)
    for table in document.get("obstacle", []) if isinstance(document.get("obstacle"), list) else []:
        if isinstance(table, dict):
            _refuse_unknown(table, ["polygon"], where, text)
    for key, value in document.items():
        _refuse_not_finite(value, key, where, text)
        try:
            msgspec.convert({key: value}, FlatConfig)
        except msgspec.ValidationError as error:
            raise ConfigError(f"{where}{_line_of(text, key)}: {_explained(key, error)}") from error
    return msgspec.convert(document, FlatConfig)


def _explained(key: str, error: Exception) -> str:
    if key == "goal":
        return "goal must be [latitude, longitude] or [latitude, longitude, altitude]"
    return f"{key}: {str(error).partition(' - at')[0]}"


def overridden(flat: FlatConfig, over: Mapping[str, Any]) -> FlatConfig:
    """The same with every value that is not None put in its place: flag over file over default."""
    return msgspec.structs.replace(flat, **{key: value for key, value in over.items() if value is not None})


def daemon_config(flat: FlatConfig) -> DaemonConfig:
    """The configuration that the keys describe.

    Raises:
        ConfigError: If a value is out of range; the text names it.
    """

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
    """The whole configuration as a file that `read_config_file` takes, defaults included."""
    engine = config.engine
    lines = [
        f'vehicle = "{config.vehicle}"',
        f'rid = "{config.remote_id}"',
        f'definition = "{engine.definition}"',
        f"eta = {engine.eta}",
        f'chance_bound = "{engine.chance_bound}"',
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
