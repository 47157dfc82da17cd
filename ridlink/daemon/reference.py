"""The reference of the configuration, generated from the schema that checks files, so that no key is missing."""

from __future__ import annotations

import dataclasses
import inspect
import math
import re
import types
from collections.abc import Mapping
from typing import Annotated, Any, Union, get_args, get_origin, get_type_hints

from ridlink.avoidance.settings import GradedSettings, HalfplaneSettings, RotationSettings
from ridlink.daemon.config import KEY_RANGES
from ridlink.daemon.config_file import SOLVER_TABLES, FlatConfig

KINDS = {str: "text", bool: "true or false", int: "whole number", float: "number"}
ELSEWHERE = {"halfplane", "graded", "rotation", "obstacle"}
"""Tables; they have sections of their own."""

HEAD = """# Configuration of `ridlink avoid`

Made by `ridlink avoid --config-reference`. These are the keys of the TOML file given with `--config`. An option of the
same name, with hyphens for underscores, wins over the file. An unknown key, a value of another kind, or a number that
is none or out of its range ends the program with exit code 2 and the line of the file. `--print-config` shows what
would be flown.

A range holds its ends. It says nothing about what flies well: outside of it lies only what is a mistake in a unit or a
digit, or what nothing can measure or fly. Its limits stand with their reasons where the values are used,
`ridlink/avoidance/settings.py` for those of the solvers.
"""

OBSTACLES = """## [[obstacle]]

One table for each static obstacle; none is ever entered. `ridlink sim --daemon-config N` writes those of an emulated
scenario, which has them in metres.

| key | kind | default | meaning |
| --- | --- | --- | --- |
| `polygon` | list of [latitude, longitude] | | Corners in degrees, three or more. |
"""


def reference(helps: Mapping[str, str]) -> str:
    """The whole reference, Markdown.

    Args:
        helps: Help texts of the command-line options, by key, with their defaults in brackets at the end.

    Raises:
        KeyError: If a key has no option.
    """
    hints = get_type_hints(FlatConfig, include_extras=True)
    rows = ["| key | kind | default | range | meaning |", "| --- | --- | --- | --- | --- |"]
    for key, hint in hints.items():
        if key in ELSEWHERE:
            continue
        text, _, default = " ".join(helps[key].split()).partition("[default:")
        kind = _kind(hint)
        default = default.rstrip("] ").strip() or ("false" if kind == KINDS[bool] else "")
        rows.append(f"| `{key}` | {kind} | {default} | {KEY_RANGES.get(key, '')} | {text.strip()} |")
    parts = [HEAD, "## Keys\n\n" + "\n".join(rows) + "\n"]
    for name, settings in SOLVER_TABLES.items():
        parts.append(_table(str(name), settings))
    return "\n".join([*parts, OBSTACLES])


def _kind(hint: Any) -> str:
    if get_origin(hint) in (types.UnionType, Union):
        hint = next(each for each in get_args(hint) if each is not type(None))
    if get_origin(hint) is Annotated:
        hint = get_args(hint)[0]
    return "list of numbers" if get_origin(hint) is list else KINDS[hint]


def _table(name: str, settings: type[HalfplaneSettings | GradedSettings | RotationSettings]) -> str:
    said = dict(re.findall(r"^    {4}(\w+): (.+(?:\n {12}.+)*)", inspect.getdoc(settings) or "", re.M))
    said |= dict(re.findall(r"^    (\w+): (.+(?:\n {8}.+)*)", inspect.getdoc(settings) or "", re.M))
    rows = [f"## [{name}]\n\nConstants of that solver.\n\n| key | default | range | meaning |"]
    rows.append("| --- | --- | --- | --- |")
    for item in dataclasses.fields(settings):
        default = "inf" if item.default == math.inf else item.default
        allowed = settings.RANGES[item.name]
        rows.append(f"| `{item.name}` | {default} | {allowed} | {' '.join(said.get(item.name, '').split())} |")
    return "\n".join(rows) + "\n"
