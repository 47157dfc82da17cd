"""Words of sentences and tables: 1 shard, 2 shards, 1,200 flights, a dash; and what was meant by another word."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from enum import StrEnum
from typing import Any


def counted(number: float, noun: str, form: str = ",", *, more: str = "") -> str:
    """A number and what it counts, in the singular for one.

    Args:
        number: How many.
        noun: What, in the singular.
        form: How the number is written, as `format` takes it.
        more: The plural; empty: the singular with an s.
    """
    return f"{number:{form}} {noun if number == 1 else more or noun + 's'}"


def or_dash(value: float | None, form: str = ".1f") -> str:
    """A figure of a table, written as `format` takes it; a dash for what is unknown."""
    return "-" if value is None else format(value, form)


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """What to say behind an unknown word, as in ``": did you mean 'goal'?"``; empty where nothing is like it.

    Args:
        word: What was written.
        known: What there is; the end of one is nearest, as LOCATION of OPEN_DRONE_ID_LOCATION.
    """
    names = list(known)
    near = [name for name in names if word and name.endswith(f"_{word}")] or difflib.get_close_matches(word, names, n=1)
    return f": did you mean {near[0]!r}?" if near else ""


def unknown_name(what: str, name: Any, known: Iterable[str]) -> str:
    """What to say of a name that is none of a few: what was meant, and which there are.

    Args:
        what: What it should name.
        name: What was written.
        known: What there is.
    """
    names = [str(one) for one in known]
    hint = did_you_mean(name, names).removeprefix(": ") if isinstance(name, str) else ""
    return f"unknown {what} {name!r}: {hint}{' ' if hint else ''}known are {', '.join(names)}"


class Named(StrEnum):
    """A choice that is made by its name. A ValueError for any other name says which there are."""

    @classmethod
    def _missing_(cls, value: object) -> None:
        raise ValueError(unknown_name(cls.__name__, value, cls))
