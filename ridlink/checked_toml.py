"""Reads a TOML document key by key, with errors that tell a user what to correct.

An error is one line of text. It names the file, the line if known, the table and the key, and says what would be right.
Numbers must be finite. A key that the program never reads is an error: otherwise a misspelt key would silently leave
the default.
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
from ridlink.words import did_you_mean

LARGEST = 1e6
"""Limit in metres, seconds or metres a second. Beyond it the local tangent plane is no use, and no sane value lies."""


UNREADABLE = "cannot be read: an integer of thousands of digits, or brackets nested too deeply"
"""Our text where a parser of the standard library fails with an error that says nothing about the format."""


MOST_FAULTS = 5
"""How many mistakes of a file are reported at once."""

ALIKE = 0.85
"""Similarity from which one key may be a misspelling of another; the keys of one table are less similar."""

Made = TypeVar("Made")


class KeyFault(ConfigError):
    """An error of one key alone: its value is wrong, it is missing, or it is unknown.

    Attributes:
        key: The key.
    """

    def __init__(self, text: str, key: str = "") -> None:
        super().__init__(text)
        self.key = key


@dataclass(frozen=True, slots=True)
class TomlSource:
    """Name and text of a file, to find the line of a key."""

    name: str
    text: str

    def line(self, table: str, number: int, key: str) -> int | None:
        """Line of a key, else of the header, in the ``number``-th ``table`` (the top: ""); None if unclear."""
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
    """One table of a file. Reading a key removes it, so the keys left at the end are unknown ones.

    Args:
        source: The file.
        values: The table as parsed.
        name, number: Its name, empty for the top, and its number from 1 among the tables of that name, 0 if it is the
            only one.

    Raises:
        ConfigError: From any method that reads, with the text of `error`: this is no table, a key is missing, or its
            value is not as required.
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
        """An error whose one line of text says file, line, key and what is wrong."""
        line = self._source.line(self._name, self._number, key)
        where = f"{self._source.name}:{line}" if line else self._source.name
        owner = f"{self._name} {self._number}" if self._number else self._name
        return ConfigError(f"{where}: {': '.join(part for part in (owner, key) if part)} {text}")

    def fault(self, key: str, text: str) -> KeyFault:
        """The same for a mistake that is in one key alone, and hides none in the others."""
        return KeyFault(str(self.error(key, text)), key)

    def read(self, make: Callable[[CheckedTable], Made], faults: list[ConfigError]) -> Made | None:
        """What ``make`` returns for this table; None if the table has mistakes, which are added to ``faults``.

        After a mistake the table is read again without the wrong key, so that all mistakes are reported. Errors that
        only follow from a key taken out are not.

        Args:
            make: Reads a table.
            faults: Mistakes found so far; with `MOST_FAULTS` of them nothing more is read.
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
        """Whether a key is present; it counts as known from now on."""
        self._known[key] = None
        return key in self._values

    def take(self, key: str, default: object = None) -> Any:
        """The value of a key; the key is required if there is no default."""
        if self.has(key):
            return self._values.pop(key)
        if default is None:
            near = get_close_matches(key, self._values, n=1, cutoff=ALIKE)
            raise self.fault(key, f"is missing: did you mean it by {near[0]}?" if near else "is missing")
        return default

    def text(self, key: str) -> str:
        """The value of a key that must be text: one line, not empty."""
        value = self.take(key)
        if not isinstance(value, str) or not value.strip() or not value.isprintable():
            raise self.fault(key, "must be text of one line")
        return value

    def truth(self, key: str, default: bool) -> bool:
        """The value of a key that must be true or false."""
        value = self.take(key, default)
        if not isinstance(value, bool):
            raise self.fault(key, f"must be true or false, not {value!r}")
        return value

    def number(
        self, key: str, default: float | None = None, *, above: float | None = None, least: float | None = None,
        most: float | None = None,
    ) -> float:  # fmt: skip
        """The value of a key that must be a finite number, greater than ``above``, from ``least`` to ``most``."""
        value = self._finite(key, self.take(key, default))
        if above is not None and value <= above:
            raise self.fault(key, f"must be greater than {above:g}, not {value:g}")
        if least is not None and value < least:
            raise self.fault(key, f"must be at least {least:g}, not {value:g}")
        if most is not None and value > most:
            raise self.fault(key, f"must be at most {most:g}, not {value:g}")
        return value

    def point(self, key: str, value: object, axes: str) -> tuple[float, ...]:
        """Coordinates, one for each of the axes named ("north, east"); ``value`` may be part of the key's value."""
        if not isinstance(value, list) or len(value) != axes.count(",") + 1:
            raise self.fault(key, f"must be [{axes}] in metres, not {value!r}")
        return tuple(self._finite(key, part) for part in value)

    def _finite(self, key: str, value: object) -> float:
        number = finite_number(value)
        if number is None:
            raise self.fault(key, f"must be a finite number, not {reprlib.repr(value)}")
        if abs(number) > LARGEST:
            raise self.fault(key, f"must be at most {LARGEST:g} in size, not {number:g}")
        return number

    def tables(self, key: str, *, needed: bool = True) -> Iterator[CheckedTable]:
        """The tables of an array of tables, in order."""
        value = self.take(key, None if needed else [])
        if not isinstance(value, list):
            raise self.fault(key, f"must be written as [[{key}]]")
        return (CheckedTable(self._source, entry, key, number) for number, entry in enumerate(value, start=1))

    def table(self, key: str) -> CheckedTable:
        """A table within this one, written as ``[key]``."""
        value = self.take(key)
        if not isinstance(value, dict):
            raise self.fault(key, f"must be written as [{key}]")
        return CheckedTable(self._source, value, key, 0)

    def nothing_else(self) -> None:
        """Refuse keys that were not read: otherwise a misspelt key would silently leave the default."""
        for key in self._values:
            hint = did_you_mean(key, self._known) or f": known are {', '.join(self._known)}"
            raise self.fault(key, f"is not known here{hint}")


def read_toml(path: str | Path) -> CheckedTable:
    """The top table of a file.

    Raises:
        ConfigError: If it is not TOML in UTF-8.
        OSError: If the file cannot be read.
    """
    try:
        text = Path(path).read_bytes().decode("utf-8-sig")  # editors on Windows write a byte order mark before the text
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path}: is not UTF-8 text: {error.reason}") from error
    return CheckedTable(TomlSource(str(path), text), parse_toml(text, str(path)), "", 0)


def parse_toml(text: str, where: str) -> dict[str, Any]:
    """A TOML document.

    Args:
        text: The document.
        where: Name of its source, for the error text.

    Raises:
        ConfigError: If the text is not TOML; the text names the line.
    """
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        said = " ".join(str(error).split())
        place = re.search(r"\(at line (\d+), column \d+\)$", said)
        line = place[1] if place else max(len(text.splitlines()), 1)  # else it says: at end of document
        raise ConfigError(f"{where}:{line}: is not TOML: {said}") from error
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
