"""Tables for other programs: CSV and Parquet, one file a message or one file of joined rows.

If a sender could make a CSV cell begin with ``= + - @``, the cell gets an apostrophe in front, so that a spreadsheet
reads it as text and not as a formula. Texts are printable ASCII already, and file names are names of the dialect.
"""

from __future__ import annotations

import csv
import importlib
import io
from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from ridlink.captures.export.chosen import chosen_rows, pack_records
from ridlink.captures.export.fields import Fields, fields_of_records
from ridlink.captures.export.join import COLUMNS
from ridlink.captures.export.selection import Selection
from ridlink.captures.export.si import Column, columns_of
from ridlink.captures.fast.block import Block, empty_words, structured
from ridlink.captures.fast.tables import layouts, slot_of
from ridlink.captures.lines import exact_seconds
from ridlink.errors import MissingExtraError

ROWS_PER_GROUP = 16_384
JOINED_ROWS_PER_GROUP = 4096
"""Fewer than usual, since these rows wait as dictionaries."""

FORMULA_STARTS = ("=", "+", "-", "@")

KNOTS_PER_MPS = 3600.0 / 1852.0
FEET_PER_M = 1.0 / 0.3048


def tables_of_block(block: Block, selection: Selection) -> Iterator[tuple[str, dict[str, Column]]]:
    """Selected messages of a block, as columns by message: ``t, transport, src, seq, offset``, then the fields.

    ``t`` is microseconds since 1970. A field that is itself called so, as ``seq`` often is, has ``_field`` behind it.
    """
    for layout, entries, rows in chosen_rows(block, selection):
        times = block.times[entries].astype(np.int64)
        sources = zip(rows["sysid"].tolist(), rows["compid"].tolist(), strict=True)
        columns = {
            "t": Column(times, times >= 0),
            "transport": Column([block.transport] * len(rows)),
            "src": Column([f"{sysid}/{compid}" for sysid, compid in sources]),
            "seq": Column(rows["seq"]),
            "offset": Column(rows["offset"]),
        }
        yield layout.name, columns | {_named(field): column for field, column in columns_of(layout, rows).items()}
    packed = [record for _, records in pack_records(block, selection) for record in records]
    yield from tables_of_messages(fields_of_records(packed))


def tables_of_messages(messages: Iterable[Fields]) -> Iterator[tuple[str, dict[str, Column]]]:
    """The same of single messages."""
    by_name: dict[str, list[Fields]] = {}
    for message in messages:
        by_name.setdefault(message.name, []).append(message)
    for name, found in by_name.items():
        heads: dict[str, list[Any]] = {
            "t": [message.time_us for message in found],
            "transport": [message.transport for message in found],
            "src": [message.source for message in found],
            "seq": [message.seq for message in found],
            "offset": [message.offset for message in found],
        }
        fields = {_named(field): [message.fields[field] for message in found] for field in found[0].fields}
        like = columns_of(layouts()[slot_of()[name]], structured(slot_of()[name], empty_words(slot_of()[name], 0)))
        yield (
            name,
            {
                **{column: _column(values, _HEAD_TYPES[column]) for column, values in heads.items()},
                **{
                    column: _column(values, None if isinstance(kind.values, list) else kind.values.dtype)
                    for (column, values), kind in zip(fields.items(), like.values(), strict=True)
                },
            },
        )


_HEAD_TYPES: dict[str, np.dtype[Any] | None] = {
    "t": np.dtype(np.int64), "transport": None, "src": None, "seq": np.dtype(np.uint8), "offset": np.dtype(np.int64),
}  # fmt: skip


def _named(field: str) -> str:
    """Name of the column of a field."""
    return f"{field}_field" if field in _HEAD_TYPES else field


def _column(values: list[Any], kind: np.dtype[Any] | None) -> Column:
    """Values as a column; of numbers, unknown ones are 0 and marked."""
    if kind is None:
        return Column(values)
    known = np.array([value is not None for value in values])
    return Column(np.array([0 if value is None else value for value in values], kind), known)


# --- CSV ---


def neutral(text: str | None) -> str | None:
    """The text, changed so that no spreadsheet reads it as a formula."""
    return f"'{text}" if text is not None and text.startswith(FORMULA_STARTS) else text


def _csv_cells(column: Column) -> list[Any]:
    found = column.to_list()
    if isinstance(column.values, list):
        return [neutral(text) for text in found]
    if column.values.ndim > 1:
        return [f"[{','.join(map(str, values))}]" for values in found]
    if column.values.dtype.kind == "f":
        return [None if value != value else value for value in found]
    return found


class CsvFolder(ExitStack):
    """CSV files in a folder, one a message."""

    def __init__(self, folder: Path) -> None:
        super().__init__()
        self._folder = folder
        self._writers: dict[str, Any] = {}

    def write(self, name: str, columns: dict[str, Column]) -> None:
        """Add rows to the table of a message."""
        if name not in self._writers:
            path = self._folder / f"{name}.csv"
            stream = self.enter_context(path.open("w", encoding="utf-8", newline=""))
            self._writers[name] = csv.writer(stream, lineterminator="\n")
            self._writers[name].writerow(columns)
        cells = {column: _csv_cells(values) for column, values in columns.items()}
        cells["t"] = [None if t is None else exact_seconds(t) for t in cells["t"]]
        self._writers[name].writerows(zip(*cells.values(), strict=True))

    def finish(self) -> list[str]:
        """Complete all files; their names."""
        self.close()
        return sorted(f"{name}.csv" for name in self._writers)


def write_joined_csv(rows: Iterable[dict[str, Any]], out: BinaryIO) -> int:
    """Joined rows as one CSV; how many."""
    text = io.TextIOWrapper(out, encoding="utf-8", newline="", write_through=True)
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    texts = [name for name, kind in COLUMNS.items() if kind == "text"]
    count = 0
    for row in rows:
        cells = row | {name: neutral(row[name]) for name in texts}
        cells["t"] = None if row["t"] is None else exact_seconds(row["t"])
        writer.writerow(cells.values())
        count += 1
    text.detach()
    return count


# --- Parquet ---


def arrow() -> tuple[Any, Any]:
    """pyarrow and pyarrow.parquet.

    Raises:
        MissingExtraError: If they are not installed.
    """
    try:
        return importlib.import_module("pyarrow"), importlib.import_module("pyarrow.parquet")
    except ImportError as error:
        raise MissingExtraError("export", "Parquet") from error


class ParquetFolder(ExitStack):
    """Parquet files in a folder, one a message; ``t`` is a UTC timestamp of microseconds.

    Raises:
        MissingExtraError: If pyarrow is not installed.
    """

    def __init__(self, folder: Path) -> None:
        super().__init__()
        self._arrow, self._parquet = arrow()
        self._folder = folder
        self._writers: dict[str, Any] = {}
        self._waiting: dict[str, list[Any]] = {}
        self._rows: dict[str, int] = {}

    def write(self, name: str, columns: dict[str, Column]) -> None:
        """Add rows to the table of a message."""
        arrays = {column: self._array(values) for column, values in columns.items()}
        arrays["t"] = arrays["t"].cast(self._arrow.timestamp("us", "UTC"))
        self._waiting.setdefault(name, []).append(self._arrow.table(arrays))
        self._rows[name] = self._rows.get(name, 0) + len(arrays["t"])
        if self._rows[name] >= ROWS_PER_GROUP:
            self._flush(name)

    def _array(self, column: Column) -> Any:
        if isinstance(column.values, list):
            return self._arrow.array(column.values, self._arrow.string())
        values = np.ascontiguousarray(column.values)
        if values.ndim > 1:
            flat = self._arrow.array(values.reshape(-1))
            return self._arrow.FixedSizeListArray.from_arrays(flat, values.shape[1])
        return self._arrow.array(values, mask=None if column.known is None else ~column.known)

    def _flush(self, name: str) -> None:
        table = self._arrow.concat_tables(self._waiting[name])
        if name not in self._writers:
            # opened here, for pyarrow wants names in UTF-8, which a folder's need not be
            stream = self.enter_context((self._folder / f"{name}.parquet").open("wb"))
            writer = self._parquet.ParquetWriter(stream, table.schema, compression="zstd")
            self._writers[name] = self.enter_context(writer)
        self._writers[name].write_table(table)
        self._waiting[name], self._rows[name] = [], 0

    def finish(self) -> list[str]:
        """Complete all files; their names."""
        for name in self._waiting:
            if self._waiting[name]:
                self._flush(name)
        self.close()
        return sorted(f"{name}.parquet" for name in self._writers)


def write_joined_parquet(rows: Iterable[dict[str, Any]], out: BinaryIO) -> int:
    """Joined rows as one Parquet file; how many.

    The columns of the join come first; after them the same under the names and in the units (feet, knots, feet a
    minute) that the library ``traffic`` reads.

    Raises:
        MissingExtraError: If pyarrow is not installed.
    """
    pa, parquet = arrow()
    types = {"time": pa.timestamp("us", "UTC"), "text": pa.string(), "integer": pa.int64(), "number": pa.float64()}
    schema = pa.schema(
        [
            *((name, types[kind]) for name, kind in COLUMNS.items()),
            ("timestamp", types["time"]),
            *((name, pa.string()) for name in ("icao24", "callsign")),
            *(
                (name, pa.float64())
                for name in ("latitude", "longitude", "altitude", "groundspeed", "track", "vertical_rate")
            ),
        ]
    )
    count = 0
    with parquet.ParquetWriter(out, schema, compression="zstd") as writer:
        for group in _groups(rows, JOINED_ROWS_PER_GROUP):
            count += len(group)
            writer.write_table(pa.Table.from_pylist([row | _for_traffic(row) for row in group], schema))
    return count


def _groups(rows: Iterable[dict[str, Any]], length: int) -> Iterator[list[dict[str, Any]]]:
    group: list[dict[str, Any]] = []
    for row in rows:
        group.append(row)
        if len(group) == length:
            yield group
            group = []
    if group:
        yield group


def _for_traffic(row: dict[str, Any]) -> dict[str, Any]:
    def scaled(name: str, factor: float) -> float | None:
        return None if row[name] is None else row[name] * factor

    name = row["uas_id"] or row["sources"]
    geodetic = scaled("altitude_geodetic_m", FEET_PER_M)
    return {
        "timestamp": row["t"],
        "icao24": name,
        "callsign": name,
        "latitude": row["latitude_deg"],
        "longitude": row["longitude_deg"],
        "altitude": scaled("altitude_barometric_m", FEET_PER_M) if geodetic is None else geodetic,
        "groundspeed": scaled("speed_horizontal_mps", KNOTS_PER_MPS),
        "track": row["direction_deg"],
        "vertical_rate": scaled("speed_vertical_mps", 60.0 * FEET_PER_M),
    }
