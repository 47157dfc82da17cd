"""``ridlink record``: everything that comes over a link into a telemetry log."""

from __future__ import annotations

import contextlib
import errno
import math
import os
from typing import TYPE_CHECKING

import click

from ridlink.cli import EXIT_DONE
from ridlink.cli.options import NAME, duration_option
from ridlink.cli.progress import StatusLine
from ridlink.cli.signals import stopped_by_signals
from ridlink.words import counted

if TYPE_CHECKING:
    import asyncio

    from ridlink.captures.recorder import Recorder
    from ridlink.links import Link, LinkUrl

TICK_S = 1.0


@click.command(short_help="Record what comes over a link into a .tlog.")
@click.argument("url")
@click.option("-o", "--output", required=True, type=NAME, metavar="F.tlog", help="The log to write.")
@duration_option
@click.option("--force", is_flag=True, help="Replace a log with something in it; an empty one is replaced anyway.")
@click.option(
    "--silent",
    is_flag=True,
    help="Send nothing. Without it, udpout says HEARTBEAT each second, which subscribes to the air.",
)
@click.option("--json", "as_json", is_flag=True, help="The final summary as one JSON object.")
def record(url: str, output: str, duration: float | None, force: bool, silent: bool, as_json: bool) -> int:
    """Record everything that comes over a link into a .tlog, until Ctrl-C.

    \b
    ridlink record udpout:127.0.0.1:14650 -o air.tlog      what the emulated radio carries
    ridlink record udpin:127.0.0.1:14550 -o vehicle.tlog   what a vehicle sends to a ground station
    """
    import asyncio

    from ridlink.links import parse_link_url

    link_url = parse_link_url(url)
    if os.path.isdir(output):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), output)
    if os.path.lexists(output) and not (force or _is_empty(output)):
        raise FileExistsError(errno.EEXIST, "exists already; --force replaces it", output)
    recorder, duration_s = asyncio.run(_record(link_url, output, duration, force, silent))
    _report(output, recorder, duration_s, as_json)
    if recorder.error is not None:
        raise recorder.error
    return EXIT_DONE


def _is_empty(path: str) -> bool:
    """Whether a file is empty, as a log is if nothing was heard: it may be replaced."""
    return os.path.isfile(path) and os.path.getsize(path) == 0


async def _record(
    url: LinkUrl, output: str, duration: float | None, force: bool, silent: bool
) -> tuple[Recorder, float]:
    """Record until the time is up, a signal comes or the disk is full. Returns the recorder and the time it ran [s]."""
    import asyncio

    from ridlink.captures.recorder import Recorder
    from ridlink.links import Scheme, open_link

    loop = asyncio.get_running_loop()
    stop = stopped_by_signals(loop)
    # The link first: a port in use must neither replace a log nor leave an empty one.
    link = await open_link(url, lambda data, _: recorder.receive(data))
    try:
        recorder = Recorder(output, overwrite=force or _is_empty(output))
        started_s = loop.time()
        here = url.at(link.local_address) if url.listens else url
        click.echo(f"ridlink: recording {here} into {output}; Ctrl-C stops", err=True)
        await _until(stop, started_s, duration, link, recorder, url.scheme is Scheme.UDPOUT and not silent)
        await asyncio.to_thread(recorder.close)
        return recorder, round(loop.time() - started_s, 3)
    finally:
        link.close()


async def _until(
    stop: asyncio.Event, started_s: float, duration: float | None, link: Link, recorder: Recorder, speaks: bool
) -> None:
    """Each second: send a HEARTBEAT if it must, and show the progress."""
    import asyncio

    from ridlink.mavlink.ground_station import ground_station, heartbeat

    loop = asyncio.get_running_loop()
    encoder = ground_station()
    ends_s = math.inf if duration is None else started_s + duration
    line = StatusLine()
    while recorder.error is None and not stop.is_set() and loop.time() < ends_s:
        if speaks:
            link.send(heartbeat(encoder))
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(stop.wait(), min(TICK_S, max(0.0, ends_s - loop.time())))
        line.show(f"{counted(recorder.messages, 'message')}, {loop.time() - started_s:.0f} s")
    line.clear()


def _report(path: str, recorder: Recorder, duration_s: float, as_json: bool) -> None:
    """Print the path and the counts at the end."""
    if as_json:
        import msgspec

        summary = {
            "path": path,
            "messages": recorder.messages,
            "bytes": recorder.bytes_written,
            "duration_s": duration_s,
            "types": dict(recorder.types.most_common()),
            "sources": dict(recorder.sources.most_common()),
            "rejects": dict(recorder.rejects.counts),
            "dropped": recorder.dropped,
        }
        click.echo(msgspec.json.encode(summary))
        return
    if not recorder.messages:
        click.echo("ridlink: nothing was received; is anybody sending there?", err=True)
    if recorder.rejects:
        click.echo(f"ridlink: not frames: {recorder.rejects}", err=True)
    if recorder.dropped:
        click.echo(f"ridlink: {counted(recorder.dropped, 'datagram')} came faster than they could be written", err=True)
    click.echo(
        f"{path}: {counted(recorder.messages, 'message')} of {counted(len(recorder.types), 'type')} from "
        f"{counted(len(recorder.sources), 'source')}, {recorder.bytes_written:,} bytes, {duration_s:.1f} s"
    )
