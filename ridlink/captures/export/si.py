"""Structured arrays to columns for export: Remote ID in SI units, everything else as in the XML.

Names, order, values and unknowns are those of `ridlink.captures.lines`: the rules of `ridlink.remote_id.convert`, for
whole arrays. Tests compare the two.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from ridlink.captures.fast.tables import Layout, column_of
from ridlink.remote_id import accuracy
from ridlink.remote_id.location import (
    MAX_SPEED_HORIZONTAL_CMPS,
    MAX_SPEED_VERTICAL_CMPS,
    UNKNOWN_DIRECTION_CDEG,
    UNKNOWN_SPEED_HORIZONTAL_CMPS,
    UNKNOWN_SPEED_VERTICAL_CMPS,
)
from ridlink.remote_id.mavlink_fields import MAX_ALTITUDE_M, UNKNOWN_ALTITUDE_M, UNKNOWN_TIMESTAMP_S
from ridlink.remote_id.messages import SeparationFlags
from ridlink.remote_id.quantities import AUTHENTICATION_FIRST_PAGE_LENGTH, SECONDS_PER_HOUR
from ridlink.remote_id.text import display_text


@dataclass(slots=True)
class Column:
    """Values of one field.

    Attributes:
        values: Numbers, or arrays of numbers, one for each message; of texts, a list of ``str`` or ``None``.
        known: Mask of the known numbers; ``None`` if all are.
    """

    values: np.ndarray | list[str | None]
    known: np.ndarray | None = None

    def to_list(self) -> list[Any]:
        """Python values, ``None`` for unknown."""
        if isinstance(self.values, list):
            return self.values
        found: list[Any] = self.values.tolist()
        if self.known is not None:
            for index in np.flatnonzero(~self.known).tolist():
                found[index] = None
        return found


_Convert = Callable[[np.ndarray], Column]


def _payload(rows: np.ndarray) -> Column:
    payloads = zip(rows["payload"], rows["length"].tolist(), strict=True)
    return Column([payload[:length].tobytes().hex() for payload, length in payloads])


def _same(field: str) -> _Convert:
    return lambda rows: Column(rows[field])


def _position(latitude: str, longitude: str, field: str, limit_dege7: int) -> _Convert:
    def convert(rows: np.ndarray) -> Column:
        values = rows[field]
        known = ((rows[latitude] != 0) | (rows[longitude] != 0)) & (values >= -limit_dege7) & (values <= limit_dege7)
        return Column(values / 1e7, known)

    return convert


def _scaled(field: str, divisor: float, lowest: int, highest: int) -> _Convert:
    """Known from ``lowest`` to ``highest``."""

    def convert(rows: np.ndarray) -> Column:
        values = rows[field]
        return Column(values / divisor, (values >= lowest) & (values <= highest))

    return convert


def _direction(rows: np.ndarray) -> Column:
    values = rows["direction"]
    return Column(np.where(values < 36000, values / 100.0, 0.0), values <= 36000)


def _altitude(field: str) -> _Convert:
    def convert(rows: np.ndarray) -> Column:
        values = rows[field].astype(np.float64)
        return Column(values, (values > UNKNOWN_ALTITUDE_M) & (values <= MAX_ALTITUDE_M))

    return convert


def _timestamp(rows: np.ndarray) -> Column:
    values = rows["timestamp"].astype(np.float64)
    return Column(values, (values >= 0.0) & (values <= SECONDS_PER_HOUR))


def _unless_zero(field: str, divisor: float = 1.0) -> _Convert:
    return lambda rows: Column(rows[field] / divisor, rows[field] != 0)


def _commanded(field: str) -> _Convert:
    given = int(SeparationFlags.COMMANDED_VELOCITY_GIVEN)
    return lambda rows: Column(rows[field] / 1e2, rows["flags"] & given != 0)


def _bound(field: str, bound_of: Callable[[int], float | None]) -> _Convert:
    bounds = [bound_of(code) for code in range(256)]
    values = np.array([0.0 if bound is None else bound for bound in bounds])
    known = np.array([bound is not None for bound in bounds])
    return lambda rows: Column(values[rows[field]], known[rows[field]])


def _each_bytes(values: np.ndarray) -> list[bytes]:
    """Bytes of each row of an array of bytes."""
    if values.dtype.kind == "S":
        found: list[bytes] = values.tolist()
        return found
    width = values.shape[1]
    joined = values.tobytes()
    return [joined[at : at + width] for at in range(0, len(joined), width)]


def _texts(values: np.ndarray) -> list[str | None]:
    """Printable texts; each distinct text is made once, since senders repeat themselves."""
    raw = _each_bytes(values)
    shown = {value: display_text(value) for value in set(raw)}
    return [shown[value] for value in raw]


def _text(field: str) -> _Convert:
    return lambda rows: Column(_texts(rows[field]))


def _id_or_mac(rows: np.ndarray) -> Column:
    values = rows["id_or_mac"]
    if not values.any():
        return Column([None] * len(rows))
    raw = _each_bytes(values)
    shown = {value: value.hex() if any(value) else None for value in set(raw)}
    return Column([shown[value] for value in raw])


def _authentication_data(rows: np.ndarray) -> Column:
    found: list[str | None] = []
    for page, value in zip(rows["data_page"].tolist(), _each_bytes(rows["authentication_data"]), strict=True):
        short = page == 0 and not any(value[AUTHENTICATION_FIRST_PAGE_LENGTH:])
        found.append((value[:AUTHENTICATION_FIRST_PAGE_LENGTH] if short else value).hex())
    return Column(found)


def _codes(*fields: str) -> dict[str, _Convert]:
    return {field: _same(field) for field in fields}


def _remote_id() -> dict[str, dict[str, _Convert]]:
    return {
        "OPEN_DRONE_ID_BASIC_ID": {**_codes("id_type", "ua_type"), "uas_id": _text("uas_id")},
        "OPEN_DRONE_ID_LOCATION": {
            "status": _same("status"),
            "direction_deg": _direction,
            "speed_horizontal_mps": _scaled("speed_horizontal", 1e2, 0, MAX_SPEED_HORIZONTAL_CMPS),
            "speed_vertical_mps": _scaled("speed_vertical", 1e2, -MAX_SPEED_VERTICAL_CMPS, MAX_SPEED_VERTICAL_CMPS),
            "latitude_deg": _position("latitude", "longitude", "latitude", 900000000),
            "longitude_deg": _position("latitude", "longitude", "longitude", 1800000000),
            "altitude_barometric_m": _altitude("altitude_barometric"),
            "altitude_geodetic_m": _altitude("altitude_geodetic"),
            "height_m": _altitude("height"),
            **_codes("height_reference", "horizontal_accuracy", "vertical_accuracy", "barometer_accuracy",
                     "speed_accuracy"),
            "horizontal_accuracy_m": _bound("horizontal_accuracy", accuracy.horizontal_bound_m),
            "vertical_accuracy_m": _bound("vertical_accuracy", accuracy.vertical_bound_m),
            "barometer_accuracy_m": _bound("barometer_accuracy", accuracy.vertical_bound_m),
            "speed_accuracy_mps": _bound("speed_accuracy", accuracy.speed_bound_mps),
            "timestamp_s": _timestamp,
            "timestamp_accuracy_s": _bound("timestamp_accuracy", accuracy.time_bound_s),
        },
        "OPEN_DRONE_ID_AUTHENTICATION": {
            **_codes("authentication_type", "data_page", "last_page_index", "length"),
            "timestamp_s": _unless_zero("timestamp"),
            "authentication_data": _authentication_data,
        },
        "OPEN_DRONE_ID_SELF_ID": {"description_type": _same("description_type"), "description": _text("description")},
        "OPEN_DRONE_ID_OPERATOR_ID": {
            "operator_id_type": _same("operator_id_type"),
            "operator_id": _text("operator_id"),
        },
        "OPEN_DRONE_ID_SYSTEM": {
            **_codes("operator_location_type", "classification_type"),
            "operator_latitude_deg": _position("operator_latitude", "operator_longitude", "operator_latitude",
                                               900000000),
            "operator_longitude_deg": _position("operator_latitude", "operator_longitude", "operator_longitude",
                                                1800000000),
            "area_count": _same("area_count"),
            "area_radius_m": lambda rows: Column(rows["area_radius"].astype(np.float64)),
            "area_ceiling_m": _altitude("area_ceiling"),
            "area_floor_m": _altitude("area_floor"),
            **_codes("category_eu", "class_eu"),
            "operator_altitude_geo_m": _altitude("operator_altitude_geo"),
            "timestamp_s": _unless_zero("timestamp"),
        },
        "RIDLINK_SEPARATION": {
            "timestamp_s": _timestamp,
            "horizontal_error_m": _unless_zero("horizontal_error", 1e2),
            "vertical_error_m": _unless_zero("vertical_error", 1e2),
            "velocity_error_mps": _unless_zero("velocity_error", 1e2),
            "airframe_size_m": _unless_zero("airframe_size", 1e2),
            "airframe_height_m": _unless_zero("airframe_height", 1e2),
            "update_interval_s": _unless_zero("update_interval", 1e3),
            "commanded_vx_mps": _commanded("commanded_vx"),
            "commanded_vy_mps": _commanded("commanded_vy"),
            "commanded_vz_mps": _commanded("commanded_vz"),
            "flags": _same("flags"),
        },
    }  # fmt: skip


_NO_VALUE: dict[str, dict[str, tuple[str, float]]] = {
    "OPEN_DRONE_ID_LOCATION": {
        "latitude": ("latitude_deg", 0),
        "longitude": ("longitude_deg", 0),
        "direction": ("direction_deg", UNKNOWN_DIRECTION_CDEG),
        "speed_horizontal": ("speed_horizontal_mps", UNKNOWN_SPEED_HORIZONTAL_CMPS),
        "speed_vertical": ("speed_vertical_mps", UNKNOWN_SPEED_VERTICAL_CMPS),
        "altitude_barometric": ("altitude_barometric_m", UNKNOWN_ALTITUDE_M),
        "altitude_geodetic": ("altitude_geodetic_m", UNKNOWN_ALTITUDE_M),
        "height": ("height_m", UNKNOWN_ALTITUDE_M),
        "timestamp": ("timestamp_s", UNKNOWN_TIMESTAMP_S),
    },
    "OPEN_DRONE_ID_SYSTEM": {
        "operator_latitude": ("operator_latitude_deg", 0),
        "operator_longitude": ("operator_longitude_deg", 0),
        "area_ceiling": ("area_ceiling_m", UNKNOWN_ALTITUDE_M),
        "area_floor": ("area_floor_m", UNKNOWN_ALTITUDE_M),
        "operator_altitude_geo": ("operator_altitude_geo_m", UNKNOWN_ALTITUDE_M),
    },
    "RIDLINK_SEPARATION": {"timestamp": ("timestamp_s", UNKNOWN_TIMESTAMP_S)},
}
"""Fields that can be out of range, in the order in which `convert` reads them: their columns, and what says unknown."""

HAVE_RANGES = frozenset(_NO_VALUE)
"""Messages that have such fields."""


def out_of_range(layout: Layout, rows: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:
    """Fields that `ridlink.remote_id.convert` counts as out of range: ``MESSAGE.field``, and where they are."""
    for field, (name, unknown) in _NO_VALUE.get(layout.name, {}).items():
        with np.errstate(invalid="ignore"):
            known = converters(layout)[name](rows).known
            assert known is not None
            refused = ~known & (rows[field] != unknown)
            if field == "timestamp":
                refused &= ~np.isnan(rows[field])
        yield f"{layout.name}.{field}", refused


@cache
def converters(layout: Layout) -> dict[str, _Convert]:
    """What makes each column of a message, by name and in order."""
    if layout.spec is None:
        return {"msgid": _same("msgid"), "payload": _payload}
    remote_id = _remote_id().get(layout.name)
    if remote_id is not None:
        return {**remote_id, "id_or_mac": _id_or_mac}
    kinds = dict(zip(layout.spec.fields, layout.spec.types, strict=True))
    return {name: (_text if kinds[name] == "char" else _same)(column_of(name)) for name in layout.spec.xml_fields}


def columns_of(layout: Layout, rows: np.ndarray) -> dict[str, Column]:
    """Columns of the messages of one layout, under the names that JSON lines give their fields."""
    with np.errstate(invalid="ignore"):  # signalling NaNs become quiet ones
        return {name: convert(rows) for name, convert in converters(layout).items()}
