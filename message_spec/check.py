"""Compares another MAVLink definition with ours: whether both mean the same on the wire.

It compares ids, names, sizes, CRC_EXTRA and fields of every message, and the values of enum entries. For our own
messages it also compares the meaning of numbers: units, enums and values for unknown. Upstream corrects its own now and
then; ours are fixed. Additional messages or entries are no difference, unless they use a number of ours.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from message_spec.definitions import Definition, Definitions, Field, read_definitions
from message_spec.generate import DIALECT_XML

OWN_IDS = range(61400, 61500)
"""Message ids that belong to ridlink; those not yet used are reserved."""

OWN_ENUMS = "RIDLINK_"
"""Prefix of the names of ridlink's enums."""


@dataclass(frozen=True, slots=True)
class Difference:
    """One difference from our definition: ``kind`` is missing, changed or collision.

    ``msgid`` is None if it is about an enum.
    """

    kind: str
    msgid: int | None
    text: str


def compare(theirs: Definitions, ours: Definitions) -> list[Difference]:
    """Differences of ``theirs`` from ``ours``: messages by id, then enums."""
    messages = sorted(_in_messages(theirs.messages, ours.messages), key=lambda each: (each.msgid or 0, each.kind))
    return messages + list(_in_enums(theirs, ours))


def _in_messages(theirs: list[Definition], ours: list[Definition]) -> Iterator[Difference]:
    ours_by_id = {definition.msgid: definition for definition in ours}
    ours_by_name = {definition.name: definition for definition in ours}
    for msgid, count in Counter(definition.msgid for definition in theirs).items():
        if count > 1:
            names = sorted({definition.name for definition in theirs if definition.msgid == msgid})
            yield Difference("collision", msgid, f"defined {count} times: {', '.join(names)}")
    for definition in theirs:
        msgid, own = definition.msgid, ours_by_id.get(definition.msgid)
        if own is None and definition.name in ours_by_name:
            text = f"{definition.name} has this id, {ours_by_name[definition.name].msgid} in ours"
            yield Difference("changed", msgid, text)
        elif own is None:
            if msgid in OWN_IDS:
                yield Difference("collision", msgid, f"{definition.name} takes an id that is reserved for ridlink")
        elif definition.name != own.name:
            yield Difference("collision", msgid, f"{definition.name}, which is {own.name} in {own.origin}")
        elif definition.fields != own.fields:
            yield Difference("changed", msgid, _describe_change(definition, own))
        elif msgid in OWN_IDS:
            yield from _in_meanings(definition, own)
    their_ids, their_names = {d.msgid for d in theirs}, {d.name for d in theirs}
    for own in ours_by_id.values():
        if own.msgid not in their_ids and own.name not in their_names:
            yield Difference("missing", own.msgid, f"{own.name} of {own.origin}")


def _in_meanings(theirs: Definition, ours: Definition) -> Iterator[Difference]:
    for their_field, our_field in zip(theirs.fields, ours.fields, strict=True):
        for what in sorted(their_field.meaning.keys() | our_field.meaning.keys()):
            said, meant = (each.meaning.get(what, "") for each in (their_field, our_field))
            if said != meant:
                text = f"{ours.name}.{our_field.name} has {what} {said[:40]!a}, {meant!a} in {ours.origin}"
                yield Difference("changed", ours.msgid, text)


def _in_enums(theirs: Definitions, ours: Definitions) -> Iterator[Difference]:
    """Entries whose name has another value, and in our own enums those whose value has another name."""
    values = {(entry.enum, entry.name): entry.value for entry in ours.entries}
    names = {(entry.enum, entry.value): entry.name for entry in ours.entries if entry.enum.startswith(OWN_ENUMS)}
    for entry in dict.fromkeys(theirs.entries):
        ours_is = values.get((entry.enum, entry.name), entry.value)
        named = names.get((entry.enum, entry.value), entry.name)
        value = entry.value if isinstance(entry.value, int) else ascii(entry.value[:40])
        if entry.value != ours_is:
            yield Difference("changed", None, f"{entry.name} is {value}, {ours_is} in ours")
        elif entry.name != named:
            yield Difference("collision", None, f"{entry.name} takes {value} in {entry.enum}, which is {named}")


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
    return compare(theirs, read_definitions(DIALECT_XML)), len(theirs.messages)
