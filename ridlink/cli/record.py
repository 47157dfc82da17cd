"""``ridlink record``: whatever a link carries into a telemetry log."""

from __future__ import annotations

import errno
import math
import os
import sys
from typing import TYPE_CHECKING, Any

import click

from ridlink.cli import EXIT_DONE

if TYPE_CHECKING:
    from ridlink.captures import TlogWriter
    from ridlink.captures.recorder import Recorder
    from ridlink.links import Link, LinkUrl

TICK_S = 1.0
GROUND_STATION_SYSID = 255
MISSION_PLANNER_COMPID = 190
MAV_TYPE_GCS = 6
MAV_AUTOPILOT_INVALID = 8
MAV_STATE_ACTIVE = 4
MAVLINK_VERSION = 3


def _seconds(_: click.Context, __: click.Parameter, value: float | None) -> float | None:
    if value is not None and not 0.0 < value < math.inf:
        raise click.BadParameter("must be a number of seconds above 0")
    return value


@click.command()
@click.argument("url")
@click.option("-o", "--output", required=True, metavar="F.tlog", help="The log to write.")
@click.option("--duration", type=float, callback=_seconds, metavar="S", help="Stop after so many seconds.")
@click.option("--force", is_flag=True, help="Replace the log if it exists.")
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

    from ridlink.captures.recorder import Recorder, steady_clock
    from ridlink.links import parse_link_url

    link_url = parse_link_url(url)
    if not force and os.path.lexists(output):
        raise FileExistsError(errno.EEXIST, "exists already; --force replaces it", output)
    recorder = Recorder(steady_clock())
    summary = asyncio.run(_record(link_url, output, duration, force, silent, recorder))
    _report(summary, recorder, as_json)
    if recorder.error is not None:
        raise recorder.error
    return EXIT_DONE


async def _record(
    url: LinkUrl, output: str, duration: float | None, force: bool, silent: bool, recorder: Recorder
) -> dict[str, Any]:
    """Record until the time is up, a signal comes or the disk is full; what was written, for the summary."""
    import asyncio
    import signal

    from ridlink.captures import TlogWriter
    from ridlink.links import Scheme, open_link

    loop = asyncio.get_running_loop()
    stop = asyncio.Event()

    def stop_once() -> None:
        stop.set()
        for number in (signal.SIGINT, signal.SIGTERM):  # a second signal finds the default action
            loop.remove_signal_handler(number)

    for number in (signal.SIGINT, signal.SIGTERM):
        loop.add_signal_handler(number, stop_once)
    link = await open_link(url, recorder.receive)
    try:
        with TlogWriter(output, overwrite=force) as writer:
            recorder.start(writer)
            started_s = loop.time()
            here = f"{url.scheme}:{link.local_address[0]}:{link.local_address[1]}" if url.listens else url
            click.echo(f"ridlink: recording {here} into {output}; Ctrl-C stops", err=True)
            speaks = url.scheme is Scheme.UDPOUT and not silent
            await _until(stop, started_s, duration, link, recorder, writer, speaks)
            recorder.flush()
        return {
            "path": output,
            "messages": writer.records,
            "bytes": writer.bytes_written,
            "duration_s": round(loop.time() - started_s, 3),
        }
    finally:
        link.close()


async def _until(
    stop: Any, started_s: float, duration: float | None, link: Link, recorder: Recorder, writer: TlogWriter,
    speaks: bool,
) -> None:  # fmt: skip
    """Each second: say that we are there, bring the log onto the disk, show where we are."""
    import asyncio

    from ridlink.mavlink.codec import Encoder

    loop = asyncio.get_running_loop()
    encoder = Encoder(GROUND_STATION_SYSID, MISSION_PLANNER_COMPID)
    ends_s = math.inf if duration is None else started_s + duration
    on_terminal = sys.stderr.isatty()
    while recorder.error is None and not stop.is_set() and loop.time() < ends_s:
        if speaks:
            link.send(encoder.encode(
                "HEARTBEAT", type=MAV_TYPE_GCS, autopilot=MAV_AUTOPILOT_INVALID, system_status=MAV_STATE_ACTIVE,
                mavlink_version=MAVLINK_VERSION,
            ))  # fmt: skip
        try:
            await asyncio.wait_for(stop.wait(), min(TICK_S, max(0.0, ends_s - loop.time())))
        except TimeoutError:
            recorder.flush()
        if on_terminal:
            sys.stderr.write(f"\r{writer.records:,} messages, {loop.time() - started_s:.0f} s\x1b[K")
            sys.stderr.flush()
    if on_terminal:
        sys.stderr.write("\r\x1b[K")


def _report(summary: dict[str, Any], recorder: Recorder, as_json: bool) -> None:
    """The path and the counts, last."""
    if as_json:
        import msgspec

        summary |= {
            "types": dict(recorder.types.most_common()),
            "sources": dict(recorder.sources.most_common()),
            "rejects": dict(recorder.rejects.counts),
        }
        click.echo(msgspec.json.encode(summary))
        return
    if not summary["messages"]:
        click.echo("ridlink: nothing was received; is anybody sending there?", err=True)
    if recorder.rejects:
        click.echo(f"ridlink: not frames: {recorder.rejects}", err=True)
    click.echo(
        f"{summary['path']}: {summary['messages']:,} messages of {len(recorder.types)} types from "
        f"{len(recorder.sources)} sources, {summary['bytes']:,} bytes, {summary['duration_s']:.1f} s"
    )
