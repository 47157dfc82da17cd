"""Options that several commands have."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from ridlink.separation.definitions import Definition


def capture_kind(what: str) -> Callable[[Any], Any]:
    """``--in``, the format of the files that a command reads.

    Args:
        what: Help for it.
    """
    return click.option(
        "--in",
        "kind",
        type=click.Choice(["auto", "tlog", "mavlink", "pcap", "hex"]),
        default="auto",
        show_default=True,
        help=what,
    )


def above_zero(_: click.Context, __: click.Parameter, value: float | None) -> float | None:
    """Callback of an option: a finite number above 0, or none.

    Raises:
        click.BadParameter: If it is another.
    """
    if value is not None and not 0.0 < value < math.inf:
        raise click.BadParameter("must be a number above 0")
    return value


def definition_of(text: str, option: str = "--definition") -> Definition:
    """The separation definition of a name.

    Raises:
        click.BadParameter: If there is none; the text lists those that there are.
    """
    from ridlink.separation.definitions import Definition

    try:
        return Definition(text.strip())
    except ValueError:
        raise click.BadParameter(f"{text.strip()!r} is none of {', '.join(Definition)}", param_hint=option) from None
