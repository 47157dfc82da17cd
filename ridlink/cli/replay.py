"""``ridlink replay``: a dump to a link, with its own timing."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import click

from ridlink.cli import EXIT_DONE
from ridlink.cli.options import above_zero, capture_kind, wanted_names
from ridlink.cli.progress import PROGRESS_EVERY_S, StatusLine
from ridlink.cli.signals import stopped_by_signals
from ridlink.errors import CaptureError
from ridlink.words import counted

if TYPE_CHECKING:
    from ridlink.captures import Capture, Record
    from ridlink.links import Link

PEER_EVERY_S = 0.05
LATEST_LAG_S = 1.0
LONG_WAIT_S = 10.0


@click.command(short_help="Send a recording over a link, in its own rhythm.")
@click.argument("file")
@click.option("--out", "url", required=True, metavar="URL", help="Where to send, such as udpout:127.0.0.1:14540.")
@capture_kind("Format of the file; auto tells it by content and suffix.")
@click.option(
    "--speed",
    type=float,
    default=1.0,
    show_default=True,
    callback=above_zero,
    metavar="K",
    help="So many times as fast as it was recorded.",
)
@click.option(
    "--rate",
    type=float,
    default=50.0,
    show_default=True,
    callback=above_zero,
    metavar="HZ",
    help="Messages a second of captures that have no times.",
)
@click.option("--types", metavar="GLOBS", help="Messages to send, such as 'OPEN_DRONE_ID_*,RIDLINK_*'.")
@click.option("--loop", is_flag=True, help="Begin again at the end, until Ctrl-C.")
def replay(file: str, url: str, kind: str, speed: float, rate: float, types: str | None, loop: bool) -> int:
    """Send the frames of a dump over a link as they were recorded, one a datagram.

    \b
    ridlink replay flight.tlog --out udpout:127.0.0.1:14550            to a ground station
    ridlink replay air.tlog --out udpout:127.0.0.1:14650 --speed 10    to the air, ten times as fast
    ridlink replay air.tlog --out udpout:127.0.0.1:14790 --loop        to 'ridlink mqtt --source udpin:127.0.0.1:14790'

    A listening link waits for somebody to speak first. Broadcasts of a pcap go out as the MAVLink frames that a
    Remote ID receiver makes of them.

    Gaps last as long as they did, and of long ones it is said how long. What comes after a gap, as a file of its own:

    \b
    ridlink decode air.tlog --since 2026-05-01T12:30:00Z -f jsonl --frames | ridlink encode - -o after.tlog
    """  # fmt: skip
    import asyncio

    from ridlink.captures import open_capture

    if file == "-" and loop:
        raise click.UsageError("standard input cannot be read twice: no --loop")
    if url.lower().startswith(("mqtt:", "mqtts:")):
        raise click.UsageError("a broker is fed by the bridge: write --out udpout:127.0.0.1:14790 here, and run "
                               "'ridlink mqtt --broker URL --source udpin:127.0.0.1:14790' beside it")  # fmt: skip
    if url.lower().endswith((".tlog", ".mavlink", ".hex")):
        raise click.UsageError("--out takes a link, such as udpout:127.0.0.1:14550; what writes a file is "
                               f"'ridlink decode {file} -f jsonl --frames | ridlink encode - -o {url}'")  # fmt: skip
    if file != "-":
        open_capture(file, kind).close()  # an unreadable file is an error before the link is opened
    wanted = wanted_names(types)
    sent, refused, unheard, took_s = asyncio.run(_replay(file, kind, url, speed, rate, wanted, loop))
    if refused:
        click.echo(f"ridlink: {counted(refused, 'message')} the network did not take", err=True)
    if unheard:
        click.echo(f"ridlink: {counted(unheard, 'message')} came back: nobody listened on {url}", err=True)
    click.echo(f"{url}: {counted(sent, 'message')} in {took_s:.1f} s")
    return EXIT_DONE


async def _replay(
    file: str, kind: str, url: str, speed: float, rate: float, wanted: frozenset[str] | None, loop: bool
) -> tuple[int, int, int, float]:
    """Send until the end, or a signal. Returns messages sent, those not taken by network and by peer, and seconds."""
    import asyncio

    from ridlink.captures import open_capture
    from ridlink.links import open_link, parse_link_url

    running = asyncio.get_running_loop()
    stop = stopped_by_signals(running)
    link_url = parse_link_url(url)
    link = await open_link(link_url, lambda data, address: None)
    player = _Player(link, stop, speed, rate)
    try:
        if link_url.listens:
            click.echo(f"ridlink: waiting for somebody to speak to {link_url.at(link.local_address)}", err=True)
        while not stop.is_set():
            with open_capture(file, kind) as capture:
                await player.play(_selected(capture, wanted), wait_for_peer=link_url.listens)
            if not player.sent + player.refused and not stop.is_set():
                raise CaptureError(f"{capture.name} has none of the messages that --types asks for")
            if not loop:
                break
    finally:
        player.clear_progress()
        link.close()
    return player.sent, player.refused, link.counters["refused"], running.time() - player.started_s


def _selected(capture: Capture, wanted: frozenset[str] | None) -> Iterator[Record]:
    from ridlink.captures.messages import UNKNOWN
    from ridlink.mavlink.codec import MESSAGES

    for record in capture:
        spec = MESSAGES.get(record.frame.msgid)
        if wanted is None or (UNKNOWN if spec is None else spec.name) in wanted:
            yield record


class _Player:
    """Sends records when they are due."""

    def __init__(self, link: Link, stop: Any, speed: float, rate: float) -> None:
        import asyncio

        self.sent = self.refused = 0
        self._running = asyncio.get_running_loop()
        self.started_s = self._running.time()
        self._link = link
        self._stop = stop
        self._speed = speed
        self._interval_us = 1e6 / rate
        self._line, self._shown_s = StatusLine(), -math.inf

    async def play(self, records: Iterator[Record], *, wait_for_peer: bool) -> None:
        """Send all records once.

        If a time goes back, or a receiver in our own process delayed us for more than a second, timing starts anew from
            there: no burst is sent to catch up.
        """
        begun_s = self._running.time()
        begun_us: float | None = None
        time_us = 0.0
        for record in records:
            before_us = time_us
            time_us = time_us + self._interval_us * self._speed if record.time_us is None else float(record.time_us)
            now_s = self._running.time()
            if begun_us is None or time_us < before_us:
                begun_s, begun_us = now_s, time_us
            due_s = begun_s + (time_us - begun_us) / 1e6 / self._speed
            if now_s - due_s > LATEST_LAG_S:
                begun_s, begun_us, due_s = now_s, time_us, now_s
            if due_s - now_s > LONG_WAIT_S:
                self._tell_of_wait(due_s - now_s, record.time_us)
            await self._until(due_s)
            taken = self._link.send(record.frame.raw)
            while not taken and wait_for_peer and not self.sent and not self._stop.is_set():
                await self._until(self._running.time() + PEER_EVERY_S)
                taken = self._link.send(record.frame.raw)
                begun_s, begun_us = self._running.time(), time_us
            if self._stop.is_set():
                return
            self.sent += taken
            self.refused += not taken
            self._progress()

    async def _until(self, due_s: float) -> None:
        """Wait for a time or for the end; the loop runs at least once."""
        import asyncio

        delay_s = due_s - self._running.time()
        if delay_s <= 0.0:
            await asyncio.sleep(0)
            return
        try:
            await asyncio.wait_for(self._stop.wait(), delay_s)
        except TimeoutError:
            return

    def _tell_of_wait(self, wait_s: float, time_us: int | None) -> None:
        from ridlink.captures.lines import clock_time

        self.clear_progress()
        when, less = "", "--rate makes it less"
        if time_us is not None:
            when, less = f" ({clock_time(time_us)})", "--speed makes it less, --help says how to leave a gap out"
        click.echo(f"ridlink: {_rounded(wait_s)} until the next message{when}; {less}", err=True)

    def _progress(self) -> None:
        now_s = self._running.time()
        if now_s - self._shown_s >= PROGRESS_EVERY_S:
            self._shown_s = now_s
            self._line.show(f"{counted(self.sent, 'message')}, {now_s - self.started_s:.0f} s")

    def clear_progress(self) -> None:
        """Remove the line."""
        self._line.clear()


def _rounded(wait_s: float) -> str:
    """A duration as text, in its largest unit."""
    for unit, seconds in (("years", 365.25 * 86400), ("days", 86400.0), ("h", 3600.0), ("min", 60.0)):
        if wait_s >= seconds:
            return f"{wait_s / seconds:{',.1f' if wait_s < 1e12 else '.0e'}} {unit}"
    return f"{wait_s:.0f} s"
