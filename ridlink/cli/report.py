"""``ridlink report``: encounters in recorded traffic, as JSON lines and as a page."""

from __future__ import annotations

import errno
import os
from pathlib import Path
from typing import Any

import click

from ridlink.cli.files import refuse_to_replace, whole_output
from ridlink.cli.options import NAME, accuracy_convention, capture_kind, definition, definition_of
from ridlink.cli.reviewing import exit_code, open_sources, strict, walk_through

ROWS = 500


@click.command(short_help="Who met whom in recorded traffic: JSON lines, and a page with pictures.")
@click.argument("files", nargs=-1, required=True, metavar="FILE...")
@capture_kind("Format of the files; auto tells it by content and suffix.")
@definition
@accuracy_convention
@click.option("-o", "--output", type=NAME, metavar="F.jsonl",
              help="Where the lines go, if not to standard output; replaces it.")  # fmt: skip
@click.option("--html", type=NAME, metavar="F.html",
              help="Where the page goes; replaces it.  [default: NAME-report.html, here]")  # fmt: skip
@click.option("--no-html", is_flag=True, help="No page.")
@click.option(
    "--pictures", type=click.IntRange(0, ROWS), default=40, show_default=True, metavar="N",
    help="So many encounters, those of the least margin, are drawn.",
)  # fmt: skip
@strict
def report(
    files: tuple[str, ...],
    kind: str,
    definition: str,
    accuracy_convention: str,
    output: str | None,
    html: str | None,
    no_html: bool,
    pictures: int,
    is_strict: bool,
) -> int:
    """Find every encounter in recordings (tlog, pcap, pcapng): who, when, how near, with what margin under each
    definition, and who moved. One JSON object a line, and one HTML page with a plan and a distance plot for each.

    \b
    ridlink report flight.tlog                          lines to the screen, flight-report.html here
    ridlink report a.tlog b.tlog --no-html -o e.jsonl   the logs of several vehicles of one flight

    Vehicles count as they were broadcast; one whose own broadcast is not recorded takes part with its telemetry.
    All of it is as reported: nothing in a recording says where a vehicle truly was.
    """
    sized_by = definition_of(definition)
    if no_html and html is not None:
        raise click.UsageError("--html and --no-html exclude each other")
    page = None if no_html else Path(html or _page_name(files[0]))
    if page is not None:
        _check_folder(page)
        refuse_to_replace(str(page), files)
        if output is not None and os.path.realpath(output) == os.path.realpath(page):
            raise click.UsageError("-o and --html name one file: the page would replace the lines")
    refuse_to_replace(output, files)
    sources, absent = open_sources(files, kind)

    import msgspec

    from ridlink.review import Report
    from ridlink.review.page import Summary, report_page, summary_line

    with whole_output(output) as out:

        def write(row: dict[str, Any]) -> None:
            out.write(msgspec.json.encode(row) + b"\n")

        watched = Report(sized_by, write, keep=0 if page is None else ROWS, traced=pictures > 0)
        walk = walk_through(sources, [watched], accuracy_convention)
    summary = Summary(
        names=[source.name for source in sources],
        begun_s=None if walk.begun_us is None else walk.begun_us / 1e6,
        ended_s=None if walk.ended_us is None else walk.ended_us / 1e6,
        aircraft=walk.aircraft,
        encounters=watched.encounters,
        definition=sized_by,
        closest=watched.closest,
        convention=accuracy_convention,
    )
    click.echo(f"ridlink: {summary_line(summary)}", err=True)
    if page is not None:
        _write_page(page, report_page(summary, watched.worst(), drawn=pictures))
    return exit_code(sources, absent, is_strict)


def _write_page(page: Path, text: str) -> None:
    from ridlink.remote_id.text import display_name

    with whole_output(str(page)) as out:
        out.write(text.encode())
    click.echo(f"ridlink: {display_name(str(page))}: the page", err=True)


def _page_name(file: str) -> str:
    return "report.html" if file == "-" else f"{Path(file).stem}-report.html"


def _check_folder(page: Path) -> None:
    """Check that the page can be written, before an hour of reading.

    Raises:
        OSError: If the folder does not exist or is not writable.
    """
    if page.is_dir():
        raise OSError(errno.EISDIR, "is a folder; --html names a file", str(page))
    if not page.parent.is_dir():
        raise OSError(errno.ENOENT, f"there is no folder {page.parent}", str(page))
    if not os.access(page.parent, os.W_OK):
        raise OSError(errno.EACCES, "cannot be written; --html names another place, --no-html none", str(page))
