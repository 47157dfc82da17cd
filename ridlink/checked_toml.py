"""A TOML document read key by key, with errors that a person can act on.

One line of text names the file, the line where it can, the table and key, and what would be right. Numbers must be
finite. A key that nobody asked for is an error: a misspelt key must not pass as a default.
"""

from __future__ import annotations

import math
import re
import reprlib
import tomllib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Any, TypeVar

from ridlink.errors import ConfigError

LARGEST = 1e6
"""Metres, seconds or metres a second: beyond this the local tangent plane, and common sense, end."""


UNREADABLE = "cannot be read: an integer of thousands of digits, or brackets nested too deeply"
"""What a parser of the standard library gives up at without a word of its own format."""


MOST_FAULTS = 5
"""Mistakes of a file that are told at once."""

ALIKE = 0.85
"""From here on one key may be another one misspelt; those of one kind of table are less alike."""

Made = TypeVar("Made")


class KeyFault(ConfigError):
    """What is wrong with one key, whatever the others say: its value is, it is missing, or nobody knows it.

    Attributes:
        key: The key.
    """

    def __init__(self, text: str, key: str = "") -> None:
        super().__init__(text)
        self.key = key


@dataclass(frozen=True, slots=True)
class TomlSource:
    """Name and text of a file, to say where a key stands."""

    name: str
    text: str

    def line(self, table: str, number: int, key: str) -> int | None:
        """Line of a key in the ``number``-th table of a name (the top: ""), else of its header; None if unclear."""
        current, seen, header = "", dict.fromkeys(("",), 1), None
        for at, line in enumerate(self.text.splitlines(), start=1):
            if heading := re.match(r"\s*\[{1,2}\s*([\w.-]+)\s*\]{1,2}", line):
                current = heading[1]
                seen[current] = seen.get(current, 0) + 1
            elif not (current == table and re.match(rf"\s*[\"']?{re.escape(key)}[\"']?\s*=", line)):
                continue
            if current == table and seen[current] == max(number, 1):
                if not heading:
                    return at
                header = at
        return header


class CheckedTable:
    """One table of a file, emptied key by key, so that what is left over is unknown.

    Args:
        source: The file.
        values: What the parser made of the table.
        name, number: Its name, empty for the top, and its place from 1 among those of that name, 0 for the only one.

    Raises:
        ConfigError: By whatever reads it, in the words of `error`: the table is none, a key is missing, or its value is
            not what was asked for.
    """

    def __init__(self, source: TomlSource, values: object, name: str, number: int) -> None:
        self._source = source
        self._name = name
        self._number = number
        if not isinstance(values, dict):
            raise self.error("", "must be a table")
        self._values: dict[str, Any] = dict(values)
        self._known: dict[str, None] = {}

    def error(self, key: str, text: str) -> ConfigError:
        """The one line that says file, line, key and what is wrong."""
        line = self._source.line(self._name, self._number, key)
        where = f"{self._source.name}:{line}" if line else self._source.name
        owner = f"{self._name} {self._number}" if self._number else self._name
        return ConfigError(f"{where}: {': '.join(part for part in (owner, key) if part)} {text}")

    def _fault(self, key: str, text: str) -> KeyFault:
        return KeyFault(str(self.error(key, text)), key)

    def read(self, make: Callable[[CheckedTable], Made], faults: list[ConfigError]) -> Made | None:
        """What is made of this table; None if something is wrong with it, which joins the faults.

        It is read on without the keys that are wrong, so that all of them are told; what follows from that they are
        not there is told by nobody.

        Args:
            make: Reads a table.
            faults: All that was found so far; with `MOST_FAULTS` of them nothing more is read.
        """
        values, before = dict(self._values), len(faults)
        while len(faults) < MOST_FAULTS:
            table = CheckedTable(self._source, values, self._name, self._number)
            table._known = dict(self._known)
            try:
                made = make(table)
                return made if len(faults) == before else None
            except KeyFault as fault:
                if fault.key in values:
                    faults.append(fault)
                    del values[fault.key]
                    continue
                if fault.key not in self._values:
                    faults.append(fault)
            except ConfigError as error:  # about several keys
                if len(faults) == before:
                    faults.append(error)
            return None
        return None

    def has(self, key: str) -> bool:
        """Whether a key is there; it counts as known from now on."""
        self._known[key] = None
        return key in self._values

    def take(self, key: str, default: object = None) -> Any:
        """The value of a key; without a default it must be there."""
        if self.has(key):
            return self._values.pop(key)
        if default is None:
            near = get_close_matches(key, self._values, n=1, cutoff=ALIKE)
            raise self._fault(key, f"is missing: did you mean it by {near[0]}?" if near else "is missing")
        return default

    def text(self, key: str) -> str:
        """Text of one line, not empty."""
        value = self.take(key)
        if not isinstance(value, str) or not value.strip() or not value.isprintable():
            raise self._fault(key, "must be text of one line")
        return value

    def truth(self, key: str, default: bool) -> bool:
        """True or false."""
        value = self.take(key, default)
        if not isinstance(value, bool):
            raise self._fault(key, f"must be true or false, not {value!r}")
        return value

    def number(
        self, key: str, default: float | None = None, *, above: float | None = None, least: float | None = None
    ) -> float:
        """A finite number, greater than ``above`` and not less than ``least``."""
        value = self._finite(key, self.take(key, default))
        if above is not None and value <= above:
            raise self._fault(key, f"must be greater than {above:g}, not {value:g}")
        if least is not None and value < least:
            raise self._fault(key, f"must be at least {least:g}, not {value:g}")
        return value

    def point(self, key: str, value: object, axes: str) -> tuple[float, ...]:
        """Coordinates, one for each of the axes named ("north, east"); ``value`` may be part of the key's value."""
        if not isinstance(value, list) or len(value) != axes.count(",") + 1:
            raise self._fault(key, f"must be [{axes}] in metres, not {value!r}")
        return tuple(self._finite(key, part) for part in value)

    def _finite(self, key: str, value: object) -> float:
        number = finite_number(value)
        if number is None:
            raise self._fault(key, f"must be a finite number, not {reprlib.repr(value)}")
        if abs(number) > LARGEST:
            raise self._fault(key, f"must be at most {LARGEST:g} in size, not {number:g}")
        return number

    def tables(self, key: str, *, needed: bool = True) -> Iterator[CheckedTable]:
        """The tables of an array of tables, in order."""
        value = self.take(key, None if needed else [])
        if not isinstance(value, list):
            raise self._fault(key, f"must be written as [[{key}]]")
        return (CheckedTable(self._source, entry, key, number) for number, entry in enumerate(value, start=1))

    def table(self, key: str) -> CheckedTable:
        """A table within this one, written as ``[key]``."""
        value = self.take(key)
        if not isinstance(value, dict):
            raise self._fault(key, f"must be written as [{key}]")
        return CheckedTable(self._source, value, key, 0)

    def nothing_else(self) -> None:
        """Refuse keys that nobody asked for: a misspelt key must not pass as a default."""
        for key in self._values:
            raise self._fault(key, f"is not known here: known are {', '.join(self._known)}")


def read_toml(path: str | Path) -> CheckedTable:
    """The top table of a file.

    Raises:
        ConfigError: If it is not TOML in UTF-8.
        OSError: If the file cannot be read.
    """
    try:
        text = Path(path).read_bytes().decode("utf-8-sig")  # editors on Windows write a mark before the text
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: is not UTF-8 text: {error.reason}") from error
    return CheckedTable(TomlSource(str(path), text), parse_toml(text, str(path)), "", 0)


def parse_toml(text: str, where: str) -> dict[str, Any]:
    """A TOML document.

    Args:
        text: The document.
        where: Whence it comes, for the error text.

    Raises:
        ConfigError: If it is none.
    """
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise ConfigError(f"{where}: is not TOML: {' '.join(str(error).split())}") from error
    except (ValueError, RecursionError) as error:
        raise ConfigError(f"{where}: {UNREADABLE}") from error


def finite_number(value: object) -> float | None:
    """The value as a float; None if it is no number, not finite, or an integer that no float can hold."""
    if isinstance(value, bool) or not isinstance(value, int | float) or not -math.inf < value < math.inf:
        return None
    try:
        return float(value)
    except OverflowError:
        return None
