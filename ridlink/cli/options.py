"""Options that several commands share."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ridlink.remote_id.text import display_name
from ridlink.words import did_you_mean, unknown_name

if TYPE_CHECKING:
    from ridlink.separation.definitions import Definition


class _FileName(click.Path):
    """Path of a file or folder. An empty one, as of a shell variable that is not set, names nothing: as a `Path` it
    would be the current folder."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        if value == "":
            self.fail("an empty name", param, ctx)
        return super().convert(value, param, ctx)


NAME = _FileName(readable=False)
"""Path of a file or folder. Whether it can be read is only checked when it is read: the exit code is then 3, as for a
missing file, and not that of wrong usage."""

PATH = _FileName(readable=False, path_type=Path)
"""The same as a `Path`."""


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


GNSS_MODELS = ("white", "white-radial", "gauss-markov", "bias")
TECHNOLOGIES = ("ideal", "bt4", "bt5", "wifi-beacon", "wifi-nan", "nr-sidelink", "flarm", "lora")

DEFINITIONS = ("snmac", "remote-id", "odid-accuracy", "candidate1", "candidate2", "chance")
DEFINITION = f"What sizes the discs: {', '.join(DEFINITIONS[:-1])} or {DEFINITIONS[-1]}."
"""Help for ``--definition``."""

definition = click.option("--definition", default="candidate2", show_default=True, metavar="NAME", help=DEFINITION)
"""``--definition``, for every command that observes under one definition."""

ACCURACY_CONVENTIONS = ("letter", "one-sigma", "as-is")
ACCURACY_CONVENTION = (
    "Of odid-accuracy: what senders mean by their accuracy codes: letter (95 % of positions, as the standard has it), "
    "one-sigma (as PX4 and ArduPilot fill them) or as-is (three sigma)."
)
"""Help for ``--accuracy-convention``."""

accuracy_convention = click.option(
    "--accuracy-convention", type=click.Choice(ACCURACY_CONVENTIONS), default="letter", show_default=True,
    metavar="NAME", help=ACCURACY_CONVENTION,
)  # fmt: skip
"""``--accuracy-convention``, the same for every command that uses a definition."""


def _probability(_: click.Context, __: click.Parameter, value: float | None) -> float | None:
    if value is not None:
        from ridlink.separation.chance import ETA_RANGE

        ETA_RANGE.check("eta", value)  # with the words of the configuration
    return value


def eta_option(default: float | None = 0.999) -> Callable[[Any], Any]:
    """``--eta``, the same for every command that uses a definition.

    Args:
        default: None where a configuration file may say it.
    """
    return click.option(
        "--eta", type=float, default=default, callback=_probability, metavar="P",
        help="Of chance: probability, at any one instant, that no neighbour comes too close.  [default: 0.999]",
    )  # fmt: skip


class Within(click.FloatRange):
    """A float in a range; "nan" and "inf" are refused."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        number: float = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"{value!r} is not a finite number.", param, ctx)
        return number


def above_zero(_: click.Context, __: click.Parameter, value: float | None) -> float | None:
    """Callback of an option: a finite number above 0, or None.

    Raises:
        click.BadParameter: If it is another number.
    """
    if value is not None and not 0.0 < value < math.inf:
        raise click.BadParameter("must be a number above 0")
    return value


duration_option = click.option(
    "--duration", type=float, callback=above_zero, metavar="S", help="Stop after this time.  [default: at Ctrl-C]"
)
"""``--duration``, for commands that run until they are ended."""


def definition_of(text: str) -> Definition:
    """The separation definition with a name.

    Raises:
        click.BadParameter: If the name is unknown; the text lists the known ones.
    """
    from ridlink.separation.definitions import Definition

    try:
        return Definition(text.strip())
    except ValueError:
        raise click.BadParameter(unknown_name("definition", text.strip(), Definition)) from None


def wanted_names(types: str | None) -> frozenset[str] | None:
    """Names of the dialect that a comma-separated list of globs matches; ``None`` for all.

    Raises:
        click.BadParameter: If a glob matches nothing.
    """
    if types is None:
        return None
    from fnmatch import fnmatchcase

    from ridlink.captures.messages import UNKNOWN
    from ridlink.mavlink.codec import MESSAGES_BY_NAME

    names = [*MESSAGES_BY_NAME, UNKNOWN]
    wanted: set[str] = set()
    for pattern in (part.strip().upper() for part in types.split(",") if part.strip()):
        matching = [name for name in names if fnmatchcase(name, pattern)]
        if not matching:
            hint = did_you_mean(pattern, names)
            raise click.BadParameter(f"no message of the dialect matches {pattern!r}{hint}", param_hint="'--types'")
        wanted.update(matching)
    if not wanted:
        raise click.BadParameter("names no message", param_hint="'--types'")
    return frozenset(wanted)


def refuse_recording(url: str) -> None:
    """Refuse a recording in place of a link.

    Raises:
        click.UsageError: If it is one; the text names commands for recordings.
    """
    if Path(url).is_file():
        name = display_name(url)
        raise click.UsageError(f"{name} is a file, not a link: 'ridlink view {name}' shows a recording")


def signing_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """``--signing-key`` and related options, for commands that send to an autopilot."""
    for option in (
        click.option(
            "--signing-state",
            type=NAME,
            metavar="FILE",
            help="Keeps the clock of the signatures, a file for each program.  [default: the key's name with .state]",
        ),
        click.option(
            "--signing-link-id",
            type=click.IntRange(0, 255),
            metavar="N",
            help="Link id in our signatures.  [default: 0]",
        ),
        click.option(
            "--require-signature",
            is_flag=True,
            default=None,
            help="On the vehicle link, hear only what is signed.",
        ),
        click.option(
            "--signing-key",
            type=NAME,
            metavar="FILE",
            help="Sign what is sent to the vehicle, refuse what is signed wrongly: 32 bytes or 64 hexadecimal digits, "
            "in a file of mode 0600.",
        ),
    ):
        command = option(command)
    return command
