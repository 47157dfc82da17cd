"""Words for sentences and tables: "1 shard", "2 shards", "1,200 flights", a dash; and hints for misspelt names."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from enum import StrEnum
from typing import Any


def counted(number: float, noun: str, form: str = ",", *, more: str = "") -> str:
    """A number and its noun, in the singular for one.

    Args:
        number: The number.
        noun: The noun in the singular.
        form: How the number is written, as `format` takes it.
        more: The plural; empty for the singular with an s.
    """
    return f"{number:{form}} {noun if number == 1 else more or noun + 's'}"


def or_dash(value: float | None, form: str = ".1f") -> str:
    """A figure for a table, with a format as `format` takes it; a dash if it is unknown."""
    return "-" if value is None else format(value, form)


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """A hint to append after an unknown word, as in ``": did you mean 'goal'?"``; empty if no known word is similar.

    Args:
        word: The unknown word.
        known: Known words. One that ends in the word is preferred, as LOCATION of OPEN_DRONE_ID_LOCATION.
    """
    names = list(known)
    near = [name for name in names if word and name.endswith(f"_{word}")] or difflib.get_close_matches(word, names, n=1)
    return f": did you mean {near[0]!r}?" if near else ""


def unknown_name(what: str, name: Any, known: Iterable[str]) -> str:
    """Error text for an unknown name: what may have been meant, and which names are known.

    Args:
        what: What the name stands for.
        name: The unknown name.
        known: Known names.
    """
    names = [str(one) for one in known]
    hint = did_you_mean(name, names).removeprefix(": ") if isinstance(name, str) else ""
    return f"unknown {what} {name!r}: {hint}{' ' if hint else ''}known are {', '.join(names)}"


class Named(StrEnum):
    """Base of enumerations that are chosen by name. An unknown name is a ValueError that lists the known ones."""

    @classmethod
    def _missing_(cls, value: object) -> None:
        raise ValueError(unknown_name(cls.__name__, value, cls))
