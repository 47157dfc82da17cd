"""``ridlink dialect``: the message definitions in other forms, and a check of other definitions."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path

import click

from ridlink.cli.options import PATH
from ridlink.errors import ConfigError
from ridlink.files import write_together

FORMS = {
    "xml": "The definition itself. Into a folder: with the upstream definitions that it includes.",
    "python": "One importable Python file, which needs nothing of ridlink.",
    "c": "C headers, into a folder.",
    "lua": "A Wireshark dissector in Lua.",
    "typescript": "TypeScript classes, into a folder.",
}
FOLDERS_ONLY = ("c", "typescript")
PLACES = dict.fromkeys(FORMS, "A file or an existing folder; without it, standard output.") | {
    "xml": "A folder, or a file with a suffix; without it, standard output.",
    **dict.fromkeys(FOLDERS_ONLY, "A folder."),
}


@click.group(short_help="Write the MAVLink dialect in another language; check an XML.")
def dialect() -> None:
    """Write the MAVLink dialect in another language, or check a definition against it."""


def _write(form: str, output: Path | None) -> None:
    from message_spec import generate  # mavgen is only imported to make a binding

    if output is None or output == Path("-"):
        if form in FOLDERS_ONLY:
            raise click.UsageError(f"{form} makes many files: name a folder with -o FOLDER")
        click.echo(_single_file(form, "ridlink"), nl=False)
    elif form in FOLDERS_ONLY:
        write_together(output, _render(form, "ridlink"))
    elif form == "xml" and (output.is_dir() or not (output.suffix or output.exists())):
        write_together(output, generate.definition_files())
    elif output.is_dir():
        generate.write_file(output / f"ridlink{generate.SUFFIXES[form]}", _single_file(form, "ridlink"))
    else:
        generate.write_file(output, _single_file(form, output.stem))


def _single_file(form: str, stem: str) -> bytes:
    from message_spec.generate import DIALECT_XML

    if form == "xml":
        return DIALECT_XML.read_bytes()
    (content,) = _render(form, stem if re.fullmatch(r"[\w.-]+", stem, re.ASCII) else "ridlink").values()
    return content


def _render(form: str, stem: str) -> dict[str, bytes]:
    from message_spec.generate import GenerationError, render

    try:
        return render(form, stem)
    except GenerationError as error:
        raise ConfigError(f"mavgen: {str(error).splitlines()[-1]}") from error


def _add_command(form: str, help_text: str) -> None:
    @dialect.command(form, help=help_text)
    @click.option(
        "-o", "--output", type=PATH, metavar="PATH",
        help=PLACES[form],
    )  # fmt: skip
    def command(output: Path | None) -> None:
        _write(form, output)


for _form, _help in FORMS.items():
    _add_command(_form, _help)


@dialect.command()
@click.argument("file", type=PATH)
@click.option("--allow-missing", is_flag=True, help="What FILE does not define is not held against it.")
@click.pass_context
def check(ctx: click.Context, file: Path, allow_missing: bool) -> None:
    """Compare a definition with ours and upstream's.

    Ids, names, sizes, CRC_EXTRA and fields of every message in FILE and in what it includes, and the values of enums;
    of ridlink's own messages units, enums and values for unknown as well.

    Exit code 0: FILE means the same on the wire. 1: it does not, and the differences are printed. 2: FILE is no MAVLink
    definition.
    """
    from message_spec.check import check_file
    from message_spec.definitions import DefinitionError

    try:
        differences, count = check_file(file)
    except DefinitionError as error:
        raise ConfigError(str(error)) from error
    if allow_missing:
        differences = [difference for difference in differences if difference.kind != "missing"]
    for difference in differences:
        click.echo(f"{difference.kind:9} {'-' if difference.msgid is None else difference.msgid:>8} {difference.text}")
    if differences:
        kinds = Counter(difference.kind for difference in differences)
        click.echo(f"not compatible: {', '.join(f'{kinds[kind]} {kind}' for kind in sorted(kinds))}")
        ctx.exit(1)
    click.echo(f"compatible: {count} messages")
