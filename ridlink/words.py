"""Counts in sentences: 1 shard, 2 shards, 1,200 flights."""

from __future__ import annotations


def counted(number: float, noun: str, form: str = ",", *, more: str = "") -> str:
    """A number and what it counts, in the singular for one.

    Args:
        number: How many.
        noun: What, in the singular.
        form: How the number is written, as `format` takes it.
        more: The plural; empty: the singular with an s.
    """
    return f"{number:{form}} {noun if number == 1 else more or noun + 's'}"
