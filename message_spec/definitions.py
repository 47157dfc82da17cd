"""Reads any MAVLink definition: the parts of its messages that matter on the wire, and the values of its enums.

A file may come from an untrusted source, so mavgen, which evaluates values as Python, is not used. A small expat reader
takes message ids, names, fields and enum entries. It refuses document types, which could declare entities.

Source for CRC_EXTRA and the order of fields: https://mavlink.io/en/guide/serialization.html
"""

from __future__ import annotations

import hashlib
import re
import xml.parsers.expat
from dataclasses import dataclass, field
from importlib import resources
from pathlib import Path

from fastcrc import crc16

MAX_FILE_BYTES = 16 * 1024 * 1024
MAX_FILES = 64
MAX_PAYLOAD = 255
_SIZES = {"char": 1, "int8_t": 1, "uint8_t": 1, "int16_t": 2, "uint16_t": 2, "int32_t": 4, "uint32_t": 4,
          "int64_t": 8, "uint64_t": 8, "float": 4, "double": 8}  # fmt: skip
_FIELD_TYPE = re.compile(r"(\w+?)(?:\[(\d{1,3})\])?", re.ASCII)
_NAME = re.compile(r"\w{1,64}", re.ASCII)
_MESSAGE = ("mavlink", "messages", "message")
_ENUM = ("mavlink", "enums", "enum")
_MEANING = ("units", "enum", "invalid")
_NUMBER = re.compile(r"\d{1,20}|0[xX][0-9a-fA-F]{1,16}|0[bB][01]{1,64}", re.ASCII)


class DefinitionError(Exception):
    """A file that is no MAVLink definition; the text is one line with file name and line number."""


@dataclass(frozen=True, slots=True)
class Field:
    """One field: ``array_length`` is 0 for a scalar; ``meaning`` is its units, enum and value for unknown."""

    name: str
    kind: str
    array_length: int
    extension: bool
    meaning: dict[str, str] = field(default_factory=dict, compare=False)

    @property
    def size(self) -> int:
        """Bytes on the wire."""
        return _SIZES[self.kind] * max(self.array_length, 1)


@dataclass(frozen=True, slots=True)
class Definition:
    """The parts of one message that matter on the wire; ``fields`` in wire order, ``origin`` the defining file."""

    msgid: int
    name: str
    fields: tuple[Field, ...]
    origin: str

    @property
    def size(self) -> int:
        """Length of the full payload in bytes."""
        return sum(each.size for each in self.fields)

    @property
    def crc_extra(self) -> int:
        """The checksum seed, from the message name and from types and names of the fields without extensions."""
        text = f"{self.name} ".encode()
        for each in self.fields:
            if not each.extension:
                text += f"{each.kind} {each.name} ".encode()
                if each.array_length:
                    text += bytes([each.array_length])
        crc: int = crc16.mcrf4xx(text)
        return crc & 0xFF ^ crc >> 8


@dataclass(frozen=True, slots=True)
class Entry:
    """One value of an enum: a number, or its text if it is an expression that is not evaluated here."""

    enum: str
    name: str
    value: int | str


@dataclass(frozen=True, slots=True)
class Definitions:
    """Messages and enum entries of a file and of its includes, in order of reading."""

    messages: list[Definition] = field(default_factory=list)
    entries: list[Entry] = field(default_factory=list)


def read_definitions(path: Path) -> Definitions:
    """All messages and enum entries of a definition and its includes.

    An include is looked up beside the file that names it, then among the definitions of pymavlink. A file that is
    identical in both places is read once.

    Raises:
        DefinitionError: If a file is malformed, or an include is not found.
        OSError: If the file cannot be read.
    """
    definitions = Definitions()
    waiting, seen = [path], {path.resolve()}
    read: set[tuple[str, bytes]] = set()
    while waiting:
        current = waiting.pop(0)
        content = _content(current)
        known = current.name, hashlib.sha256(content).digest()
        if known in read:
            continue
        read.add(known)
        for name in _read_one(current.name, content, definitions):
            target = _included(name, current)
            if target.resolve() in seen:
                continue
            if len(seen) == MAX_FILES:
                raise DefinitionError(f"{path.name}: more than {MAX_FILES} files are included")
            seen.add(target.resolve())
            waiting.append(target)
    return definitions


def _included(name: str, by: Path) -> Path:
    beside = by.parent / name
    if beside.is_file():
        return beside
    shipped = Path(str(resources.files("pymavlink") / "dialects" / "v20")) / Path(name).name
    if not shipped.is_file():
        raise DefinitionError(f"{by.name}: includes {name[:80]!a}, which is neither beside it nor one of pymavlink's")
    return shipped


def _content(path: Path) -> bytes:
    if path.exists() and not (path.is_file() or path.is_dir()):  # to open a folder is an error of its own
        raise DefinitionError(f"{path.name}: not a file")
    with path.open("rb") as stream:
        content = stream.read(MAX_FILE_BYTES + 1)
    if len(content) > MAX_FILE_BYTES:
        raise DefinitionError(f"{path.name}: larger than {MAX_FILE_BYTES // 2**20} MiB")
    return content


def _read_one(name: str, content: bytes, definitions: Definitions) -> list[str]:
    """Add the definitions of one file. Returns the names of its includes."""
    reader = _Reader(name, definitions)
    try:
        reader.parser.Parse(content, True)
    except xml.parsers.expat.ExpatError as error:
        raise DefinitionError(f"{name}: {error}") from error
    except (LookupError, ValueError) as error:  # an encoding unknown to Python
        raise DefinitionError(f"{name}: not readable: {error}") from error
    return [include.strip() for include in reader.includes]


class _Reader:
    """Collects messages, enum entries and includes while expat walks the file."""

    def __init__(self, file_name: str, definitions: Definitions) -> None:
        self.file_name = file_name
        self.definitions = definitions
        self.includes: list[str] = []
        self.parser = xml.parsers.expat.ParserCreate()
        self.parser.StartDoctypeDeclHandler = self._doctype
        self.parser.StartElementHandler = self._start
        self.parser.EndElementHandler = self._end
        self.parser.CharacterDataHandler = self._text
        self._path: list[str] = []
        self._header = (0, "")
        self._fields: list[Field] = []
        self._extensions = False
        self._enum, self._highest = "", 0

    def _error(self, text: str) -> DefinitionError:
        return DefinitionError(f"{self.file_name}: line {self.parser.CurrentLineNumber}: {text}")

    def _doctype(self, *_: object) -> None:
        raise self._error("a document type is declared; MAVLink definitions have none")

    def _start(self, tag: str, attributes: dict[str, str]) -> None:
        if not self._path and tag != "mavlink":
            raise self._error(f"the root is <{tag}>, not <mavlink>")
        self._path.append(tag)
        if len(self._path) > 4:
            return
        where = tuple(self._path)
        if where == _MESSAGE:
            msgid = self._attribute(attributes, "id", tag)
            if not re.fullmatch(r"\d{1,8}", msgid, re.ASCII) or int(msgid) >= 1 << 24:
                raise self._error(f"message id {msgid[:20]!a} is not a number of 24 bits")
            self._header = (int(msgid), self._name(attributes, tag))
            self._fields, self._extensions = [], False
        elif where == (*_MESSAGE, "extensions"):
            self._extensions = True
        elif where == (*_MESSAGE, "field"):
            self._fields.append(self._field(attributes))
        elif where == _ENUM:
            self._enum, self._highest = self._name(attributes, tag), 0
        elif where == (*_ENUM, "entry"):
            self.definitions.entries.append(self._entry(attributes))
        elif where == ("mavlink", "include"):
            self.includes.append("")

    def _end(self, _: str) -> None:
        if len(self._path) == 3 and tuple(self._path) == _MESSAGE:
            base = [each for each in self._fields if not each.extension]
            base.sort(key=lambda each: -_SIZES[each.kind])
            fields = (*base, *(each for each in self._fields if each.extension))
            definition = Definition(*self._header, fields, self.file_name)
            if not 0 < definition.size <= MAX_PAYLOAD:
                raise self._error(f"{definition.name} has {definition.size} bytes, not 1 to {MAX_PAYLOAD}")
            self.definitions.messages.append(definition)
        self._path.pop()

    def _text(self, text: str) -> None:
        if len(self._path) == 2 and self._path[1] == "include":
            self.includes[-1] += text

    def _attribute(self, attributes: dict[str, str], name: str, tag: str) -> str:
        if name not in attributes:
            raise self._error(f"<{tag}> has no {name}")
        return attributes[name]

    def _name(self, attributes: dict[str, str], tag: str) -> str:
        name = self._attribute(attributes, "name", tag)
        if not _NAME.fullmatch(name):  # it is printed, so it must have no control characters
            raise self._error(f"{name[:40]!a} is no name")
        return name

    def _field(self, attributes: dict[str, str]) -> Field:
        written = self._attribute(attributes, "type", "field")
        match = _FIELD_TYPE.fullmatch(written)
        kind = match[1].replace("uint8_t_mavlink_version", "uint8_t") if match else ""
        if match is None or kind not in _SIZES or match[2] == "0":
            raise self._error(f"unknown type {written[:40]!a}")
        length = int(match[2] or 0)
        if length > MAX_PAYLOAD:
            raise self._error(f"an array of {length}: a payload has {MAX_PAYLOAD} bytes")
        meaning = {name: attributes[name] for name in _MEANING if name in attributes}
        return Field(self._name(attributes, "field"), kind, length, self._extensions, meaning)

    def _entry(self, attributes: dict[str, str]) -> Entry:
        """One entry; without a value it gets the highest value before it plus one, as in mavgen."""
        value: int | str = attributes.get("value", str(self._highest + 1)).strip()
        if _NUMBER.fullmatch(str(value)):
            value = int(str(value), 10 if str(value).isdecimal() else 0)
            self._highest = max(self._highest, value)
        return Entry(self._enum, self._name(attributes, "entry"), value)
