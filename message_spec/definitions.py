"""Does somebody else's XML say the same as ours on the wire? Ids, names, sizes, CRC_EXTRA and fields, compared.

The file may come from anywhere, so mavgen, which evaluates what it reads, never sees it: a small expat reader takes
what the wire depends on (message ids, names, fields) and refuses document types, in which entities would be declared.

Source for CRC_EXTRA and the order of fields: https://mavlink.io/en/guide/serialization.html
"""

from __future__ import annotations

import re
import xml.parsers.expat
from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

from fastcrc import crc16

from message_spec.generate import DIALECT_XML

MAX_FILE_BYTES = 16 * 1024 * 1024
MAX_FILES = 64
MAX_PAYLOAD = 255
OWN_IDS = range(61400, 61500)
"""Message ids that belong to ridlink; those not yet used are reserved."""

_SIZES = {"char": 1, "int8_t": 1, "uint8_t": 1, "int16_t": 2, "uint16_t": 2, "int32_t": 4, "uint32_t": 4,
          "int64_t": 8, "uint64_t": 8, "float": 4, "double": 8}  # fmt: skip
_FIELD_TYPE = re.compile(r"(\w+?)(?:\[(\d{1,3})\])?", re.ASCII)
_NAME = re.compile(r"\w{1,64}", re.ASCII)
_MESSAGE = ("mavlink", "messages", "message")


class DefinitionError(Exception):
    """A file that is no MAVLink definition; the text is one line with file name and line number."""


@dataclass(frozen=True, slots=True)
class Field:
    """One field: ``array_length`` is 0 for a scalar."""

    name: str
    kind: str
    array_length: int
    extension: bool

    @property
    def size(self) -> int:
        """Bytes on the wire."""
        return _SIZES[self.kind] * max(self.array_length, 1)


@dataclass(frozen=True, slots=True)
class Definition:
    """What the wire depends on in one message; ``fields`` in wire order, ``origin`` the file that defines it."""

    msgid: int
    name: str
    fields: tuple[Field, ...]
    origin: str

    @property
    def size(self) -> int:
        """Length of the full payload in bytes."""
        return sum(field.size for field in self.fields)

    @property
    def crc_extra(self) -> int:
        """The checksum seed: name, types and names of the fields that are no extension."""
        text = f"{self.name} ".encode()
        for field in self.fields:
            if not field.extension:
                text += f"{field.kind} {field.name} ".encode()
                if field.array_length:
                    text += bytes([field.array_length])
        crc: int = crc16.mcrf4xx(text)
        return crc & 0xFF ^ crc >> 8


@dataclass(frozen=True, slots=True)
class Difference:
    """One way in which a definition departs from ours: ``kind`` is missing, changed or collision."""

    kind: str
    msgid: int
    text: str


def read_definitions(path: Path) -> list[Definition]:
    """Every message of a definition and of what it includes, in order of reading.

    An include is looked up beside the file that names it, then among the definitions that pymavlink ships.

    Raises:
        DefinitionError: If a file is malformed, or an include is not found.
        OSError: If the file cannot be read.
    """
    definitions: list[Definition] = []
    waiting, seen = [path], {path.resolve()}
    while waiting:
        current = waiting.pop(0)
        found, includes = _read_one(current)
        definitions += found
        for name in includes:
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


def _read_one(path: Path) -> tuple[list[Definition], list[str]]:
    """Messages of one file, and the names that it includes."""
    if path.exists() and not path.is_file():
        raise DefinitionError(f"{path.name}: not a file")
    with path.open("rb") as stream:
        content = stream.read(MAX_FILE_BYTES + 1)
    if len(content) > MAX_FILE_BYTES:
        raise DefinitionError(f"{path.name}: larger than {MAX_FILE_BYTES // 2**20} MiB")
    reader = _Reader(path.name)
    try:
        reader.parser.Parse(content, True)
    except xml.parsers.expat.ExpatError as error:
        raise DefinitionError(f"{path.name}: {error}") from error
    except (LookupError, ValueError) as error:  # an encoding that Python does not have
        raise DefinitionError(f"{path.name}: not readable: {error}") from error
    return reader.definitions, [include.strip() for include in reader.includes]


class _Reader:
    """Collects messages and includes while expat walks the file."""

    def __init__(self, file_name: str) -> None:
        self.file_name = file_name
        self.definitions: list[Definition] = []
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
        elif where == ("mavlink", "include"):
            self.includes.append("")

    def _end(self, _: str) -> None:
        if len(self._path) == 3 and tuple(self._path) == _MESSAGE:
            base = [field for field in self._fields if not field.extension]
            base.sort(key=lambda field: -_SIZES[field.kind])
            fields = (*base, *(field for field in self._fields if field.extension))
            definition = Definition(*self._header, fields, self.file_name)
            if not 0 < definition.size <= MAX_PAYLOAD:
                raise self._error(f"{definition.name} has {definition.size} bytes, not 1 to {MAX_PAYLOAD}")
            self.definitions.append(definition)
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
        if not _NAME.fullmatch(name):  # it is printed: nothing that a terminal would obey
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
        return Field(self._name(attributes, "field"), kind, length, self._extensions)


def compare(theirs: Iterable[Definition], ours: Iterable[Definition]) -> list[Difference]:
    """How ``theirs`` departs from ``ours``, by message id.

    Messages that only they have are no difference, unless they take an id that belongs to ridlink.
    """
    theirs, ours_by_id = list(theirs), {definition.msgid: definition for definition in ours}
    ours_by_name = {definition.name: definition for definition in ours_by_id.values()}
    differences: list[Difference] = []
    for msgid, count in Counter(definition.msgid for definition in theirs).items():
        if count > 1:
            names = sorted({definition.name for definition in theirs if definition.msgid == msgid})
            differences.append(Difference("collision", msgid, f"defined {count} times: {', '.join(names)}"))
    for definition in theirs:
        own = ours_by_id.get(definition.msgid)
        if own is None and definition.name in ours_by_name:
            text = f"{definition.name} has this id, {ours_by_name[definition.name].msgid} in ours"
            differences.append(Difference("changed", definition.msgid, text))
        elif own is None:
            if definition.msgid in OWN_IDS:
                text = f"{definition.name} takes an id that is reserved for ridlink"
                differences.append(Difference("collision", definition.msgid, text))
        elif definition.name != own.name:
            text = f"{definition.name}, which is {own.name} in {own.origin}"
            differences.append(Difference("collision", definition.msgid, text))
        elif definition.fields != own.fields:
            differences.append(Difference("changed", definition.msgid, _describe_change(definition, own)))
    their_ids, their_names = {d.msgid for d in theirs}, {d.name for d in theirs}
    for own in ours_by_id.values():
        if own.msgid not in their_ids and own.name not in their_names:
            differences.append(Difference("missing", own.msgid, f"{own.name} of {own.origin}"))
    return sorted(differences, key=lambda difference: (difference.msgid, difference.kind))


def _describe_change(theirs: Definition, ours: Definition) -> str:
    parts = []
    if theirs.size != ours.size:
        parts.append(f"{theirs.size} bytes, {ours.size} in {ours.origin}")
    if theirs.crc_extra != ours.crc_extra:
        parts.append(f"CRC_EXTRA {theirs.crc_extra}, {ours.crc_extra} in {ours.origin}")
    for index, (their_field, our_field) in enumerate(zip(theirs.fields, ours.fields, strict=False)):
        if their_field != our_field:
            parts.append(f"field {index} on the wire is {_describe(their_field)}, not {_describe(our_field)}")
            break
    else:
        longer, verb = (theirs, "added") if len(theirs.fields) > len(ours.fields) else (ours, "dropped")
        names = [field.name for field in longer.fields[min(len(theirs.fields), len(ours.fields)) :]]
        parts.append(f"{verb}: {', '.join(names)}")
    return f"{theirs.name}: {'; '.join(parts)}"


def _describe(field: Field) -> str:
    array = f"[{field.array_length}]" if field.array_length else ""
    return f"{field.kind}{array} {field.name}{' (extension)' if field.extension else ''}"


def check_file(path: Path) -> tuple[list[Difference], int]:
    """Differences between a definition and the ridlink dialect (our messages and upstream's), and its message count.

    Raises:
        DefinitionError: If the file is no MAVLink definition.
        OSError: If the file cannot be read.
    """
    theirs = read_definitions(path)
    return compare(theirs, read_definitions(DIALECT_XML)), len(theirs)
