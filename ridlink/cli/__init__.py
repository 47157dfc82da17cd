"""The command ``ridlink``: one module per sub-command, wiring only.

Modules of commands import only click and light modules at their top, so that ``--help`` is fast; a command imports what
it needs when it runs. Other packages add commands through the entry-point group ``ridlink.commands``.

Exit codes: 0 done, 1 done with a negative verdict, 2 usage or configuration, 3 input/output at start (port, file,
broker), 4 finished with rejects under ``--strict``, 70 internal error, 128+n ended by signal n.
"""

from __future__ import annotations

import contextlib
import importlib
import io
import os
import re
import sys
from collections.abc import Callable, Iterable, Iterator
from importlib.metadata import entry_points
from typing import Any, NoReturn, TextIO

import click

from ridlink.errors import CaptureError, ConfigError, LinkError, MissingExtraError, RidlinkError
from ridlink.files import NO_ROOM
from ridlink.words import did_you_mean

EXIT_DONE = 0
EXIT_NEGATIVE = 1
EXIT_USAGE = 2
EXIT_IO = 3
EXIT_REJECTS = 4
EXIT_INTERNAL = os.EX_SOFTWARE
"""70. The watchdog of the daemon, which knows no commands, exits with it as well."""

COMMANDS = {
    "analyze": "ridlink.cli.analyze:analyze",
    "avoid": "ridlink.cli.avoid:avoid",
    "broadcast": "ridlink.cli.broadcast:broadcast",
    "campaign": "ridlink.cli.campaign:campaign",
    "capacity": "ridlink.cli.capacity:capacity",
    "decode": "ridlink.cli.decode:decode",
    "dialect": "ridlink.cli.dialect:dialect",
    "doctor": "ridlink.cli.doctor:doctor",
    "encode": "ridlink.cli.encode:encode",
    "fly": "ridlink.cli.fly:fly",
    "impair": "ridlink.cli.impair:impair",
    "mqtt": "ridlink.cli.mqtt:mqtt",
    "record": "ridlink.cli.record:record",
    "replay": "ridlink.cli.replay:replay",
    "report": "ridlink.cli.report:report",
    "top": "ridlink.cli.top:top",
    "whatif": "ridlink.cli.whatif:whatif",
    "view": "ridlink.cli.view:view",
}
"""Sub-commands of this package, as ``module:attribute``."""


@contextlib.contextmanager
def _reader_may_leave() -> Iterator[None]:
    """The reader of stdout may close it, as `head` does; click would exit with 1."""
    try:
        yield
    except BrokenPipeError:
        _lead_nowhere(sys.stdout)
        raise click.exceptions.Exit(EXIT_DONE) from None


def _lead_nowhere(stream: TextIO) -> None:
    """Let what a stream still holds vanish: Python would write it at its end, and exit with 120 if that fails."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


class LazyGroup(click.Group):
    """A group that imports a sub-command only when it is used."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return sorted({*COMMANDS, *(point.name for point in entry_points(group="ridlink.commands"))})

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name in COMMANDS:
            module, attribute = COMMANDS[cmd_name].split(":")
            return getattr(importlib.import_module(module), attribute)  # type: ignore[no-any-return]
        for point in entry_points(group="ridlink.commands", name=cmd_name):
            return point.load()  # type: ignore[no-any-return]
        return None

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        name = args[0]
        if not name.startswith("-") and self.get_command(ctx, name) is None:
            raise click.UsageError(f"No such command {name!r}{did_you_mean(name, self.list_commands(ctx)) or '.'}", ctx)
        return super().resolve_command(ctx, args)

    def make_context(self, *arguments: Any, **named: Any) -> click.Context:
        with _reader_may_leave():
            return super().make_context(*arguments, **named)

    def invoke(self, ctx: click.Context) -> object:
        try:
            with _reader_may_leave():
                return super().invoke(ctx)
        except click.UsageError as error:
            if error.ctx is None and ctx.invoked_subcommand is not None:  # click's parser says not of which command
                error.ctx = click.Context(self, ctx, ctx.invoked_subcommand)
            raise


def _print_version(ctx: click.Context, _: click.Parameter, value: bool) -> None:
    if not value or ctx.resilient_parsing:
        return
    from importlib.metadata import version

    click.echo(f"ridlink {version('ridlink')} (pymavlink {version('pymavlink')})")
    ctx.exit()


@click.group(
    cls=LazyGroup,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
    epilog="Start with: ridlink demo",
)
@click.option(
    "-V",
    "--version",
    is_flag=True,
    is_eager=True,
    expose_value=False,
    callback=_print_version,
    help="Show the version and exit.",
)
@click.pass_obj
def cli(loaded: Callable[[], None] | None) -> None:
    """Remote ID that keeps drones apart: a MAVLink bridge from Open Drone ID to velocity setpoints."""
    if loaded is not None:
        loaded()


_NO_NUMBER = re.compile("is not a valid (?:float|integer)(?: range)?")
"""Error text of click's own types for a value with a unit behind it, as in ``--speed 10m/s``."""


def _fail(text: str, code: int, others: Iterable[str] = ()) -> NoReturn:
    """Print errors, one line each, and exit. Control characters in names are made harmless to a terminal."""
    from ridlink.remote_id.text import display_name

    with contextlib.suppress(OSError):  # the disk of stderr is full, or its reader has gone
        for line in (text, *others):
            click.echo(f"ridlink: {display_name(line)}", err=True)
    sys.exit(code)


def _open_closed_streams() -> None:
    """Open standard streams that our caller has closed (``>&-``) on the null device, so that no file or socket gets
    their numbers."""
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        if getattr(sys, name) is None:
            setattr(sys, name, os.fdopen(os.open(os.devnull, os.O_RDWR), mode))


def _buffer_lines() -> None:
    """Give standard streams without a buffer (``python -u``, ``PYTHONUNBUFFERED``) one that holds a line.

    Without one Python writes a text once and drops what was not taken, as when a stop and go on come between.
    """
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is getattr(sys, f"__{name}__") and isinstance(stream.buffer, io.RawIOBase):
            setattr(sys, name, os.fdopen(stream.fileno(), "w", 1, stream.encoding, stream.errors, closefd=False))


def main(loaded: Callable[[], None] | None = None) -> NoReturn:
    """Run the command; report every expected failure with one line and a documented exit code.

    Args:
        loaded: Called once the command is known and loaded, before it runs.
    """
    _open_closed_streams()
    _buffer_lines()
    try:
        _run(loaded)
    except SystemExit as end:
        for stream in (sys.stdout, sys.stderr):
            try:
                stream.flush()
            except OSError:  # has been reported, if that could be
                _lead_nowhere(stream)
        if (warming := sys.modules.get("ridlink.daemon.warming")) is not None and warming.is_compiling():
            os._exit(end.code if isinstance(end.code, int) else EXIT_DONE)
        raise


def _run(loaded: Callable[[], None] | None) -> NoReturn:
    try:
        result = cli.main(prog_name="ridlink", standalone_mode=False, obj=loaded)
    except click.exceptions.Exit as stop:
        sys.exit(stop.exit_code)
    except click.UsageError as error:
        if isinstance(error, getattr(click.exceptions, "NoArgsIsHelpError", ())):  # of click since 8.2
            with contextlib.suppress(OSError):
                click.echo(error.format_message(), err=True)
            sys.exit(EXIT_USAGE)
        command = error.ctx.command_path if error.ctx else "ridlink"
        text = _NO_NUMBER.sub("is not a number", error.format_message())
        _fail(f"{text} (see '{command} --help')", EXIT_USAGE)
    except (click.Abort, KeyboardInterrupt):
        sys.exit(130)
    except ConfigError as error:
        _fail(str(error), EXIT_USAGE, error.others)
    except MissingExtraError as error:
        _fail(str(error), EXIT_USAGE)
    except (LinkError, CaptureError, click.FileError) as error:
        _fail(error.format_message() if isinstance(error, click.FileError) else str(error), EXIT_IO)
    except OSError as error:
        where = error.filename or ("''" if error.filename == "" else "standard output" * (error.errno in NO_ROOM))
        _fail(f"{where}: {error.strerror or error}" if where else str(error.strerror or error), EXIT_IO)
    except RidlinkError as error:
        _fail(str(error), EXIT_USAGE)
    except Exception as error:
        if isinstance(error.__cause__, KeyboardInterrupt):  # Python 3.11 wraps it while a class is created
            sys.exit(130)
        if os.environ.get("RIDLINK_DEBUG"):
            raise
        _fail(f"internal error: {type(error).__name__}: {error} (RIDLINK_DEBUG=1 shows where)", EXIT_INTERNAL)
    sys.exit(result if isinstance(result, int) else EXIT_DONE)
