"""``ridlink top``: a live table of the aircraft in the air."""

from __future__ import annotations

import sys
import time
from abc import ABC, abstractmethod
from contextlib import AbstractContextManager, nullcontext, suppress
from typing import TYPE_CHECKING, Any

import click

from ridlink.cli import EXIT_DONE
from ridlink.cli.options import (
    Within,
    above_zero,
    accuracy_convention,
    definition,
    definition_of,
    duration_option,
    refuse_recording,
)
from ridlink.cli.signals import stopped_by_signals
from ridlink.words import or_dash

if TYPE_CHECKING:
    from collections import Counter

    from rich.console import Console
    from rich.table import Table

    from ridlink.links import Link, LinkUrl
    from ridlink.observer import Sky
    from ridlink.separation.definitions import Definition

ORDERS = ("margin", "name", "age")
LINES_BESIDE = 4
"""Lines of the terminal that are not rows of the table."""

State = dict[str, Any]


@click.command(short_help="Who is in the air, as a live table.")
@click.argument("url", default="udpout:127.0.0.1:14650")
@definition
@accuracy_convention
@click.option("--interval", type=Within(0.05, 3600.0), default=1.0, show_default=True, metavar="S",
              help="Time between two tables.")  # fmt: skip
@duration_option
@click.option("--seconds", type=float, callback=above_zero, hidden=True, help="An older name of --duration.")
@click.option("--sort", type=click.Choice(ORDERS), default="margin", show_default=True, help="Who comes first.")
@click.option("--json", "as_json", is_flag=True, help="One JSON object a line, once an interval.")
def top(
    url: str, definition: str, accuracy_convention: str, interval: float, duration: float | None,
    seconds: float | None, sort: str, as_json: bool,
) -> int:  # fmt: skip
    """Show who is in the air on a link, until Ctrl-C: age and rate of the reports, position, speed, error, size, share
    of a disc, and the tightest neighbour, with what is left between the two discs.

    \b
    ridlink top                           the emulated air, udpout:127.0.0.1:14650
    ridlink top udpin:127.0.0.1:14550     what a vehicle sends to a ground station

    Where the output is no terminal it is plain lines, one an aircraft and one for the link.
    """
    import asyncio

    from ridlink.links import parse_link_url

    refuse_recording(url)
    watch = _Watch(parse_link_url(url), definition_of(definition), accuracy_convention, sort)
    asyncio.run(watch.run(interval, seconds if duration is None else duration, _output(as_json)))
    if not watch.counters["remote_id"]:
        click.echo(f"ridlink: no Remote ID was heard on {url}; is anybody sending there?", err=True)
    return EXIT_DONE


class _Watch:
    """Listens on a link, and keeps the aircraft in the air."""

    def __init__(self, url: LinkUrl, definition: Definition, accuracy_convention: str, order: str) -> None:
        from collections import Counter

        from ridlink.observer import Sky

        self.counters: Counter[str] = Counter(frames=0, remote_id=0, not_frames=0)
        self.url = url
        self.sky: Sky = Sky(convention=accuracy_convention)
        self.link: Link | None = None
        self._definition = definition
        self._order = order

    async def run(self, interval_s: float, duration_s: float | None, output: _Output) -> None:
        """Show tables until a signal comes or the time is up.

        Raises:
            LinkError: If the link cannot be opened.
        """
        import asyncio

        from ridlink.links import Scheme, open_link
        from ridlink.mavlink.ground_station import HEARTBEAT_EVERY_S, ground_station, heartbeat

        loop = asyncio.get_running_loop()
        stop = stopped_by_signals(loop)
        self.link = await open_link(self.url, self._heard)
        encoder = ground_station()
        now_s = loop.time()
        ends_s = None if duration_s is None else now_s + duration_s
        show_s, beat_s = now_s + interval_s, now_s
        try:
            with output.context:
                while not stop.is_set() and (ends_s is None or now_s < ends_s):
                    if now_s >= beat_s and self.url.scheme is Scheme.UDPOUT:
                        self.link.send(heartbeat(encoder))
                        beat_s = now_s + HEARTBEAT_EVERY_S
                    if now_s >= show_s:
                        output.show(self)
                        show_s = max(show_s + interval_s, now_s)
                    next_s = min(show_s, beat_s if self.url.scheme is Scheme.UDPOUT else show_s, ends_s or show_s)
                    with suppress(TimeoutError):
                        await asyncio.wait_for(stop.wait(), max(next_s - loop.time(), 0.001))
                    now_s = loop.time()
                output.show(self)
        finally:
            self.link.close()

    def _heard(self, data: bytes, _: object) -> None:
        from ridlink.mavlink.codec import CRC_EXTRAS
        from ridlink.mavlink.frames import Frame, parse_datagram
        from ridlink.remote_id.bridge import REMOTE_ID_IDS

        now_s = time.monotonic()
        for found in parse_datagram(data, CRC_EXTRAS):
            if not isinstance(found, Frame):
                self.counters["not_frames"] += 1
                continue
            self.counters["frames"] += 1
            self.counters["remote_id"] += found.msgid in REMOTE_ID_IDS
            self.sky.receive(found, now_s)

    def states(self) -> list[State]:
        """All aircraft, in the requested order."""
        from ridlink.observer import aircraft_states

        now_s = time.monotonic()
        self.sky.forget_silent(now_s)
        states = aircraft_states(self.sky, self.sky.at(now_s), self._definition, time.time())
        if self._order == "margin":
            return sorted(states, key=lambda state: (state["nearest"] is None, _margin(state), state["uas"]))
        return sorted(states, key=lambda state: (state["age_s"] if self._order == "age" else 0.0, state["uas"]))

    def link_counters(self) -> dict[str, int]:
        """Counters of what came over the link, and of its errors, by cause."""
        assert self.link is not None
        return {**self.counters, "fields_refused": self.sky.rejects.total(), **self.link.counters}


def _margin(state: State) -> float:
    nearest = state["nearest"]
    return float("inf") if nearest is None else float(nearest["margin_m"])


# --- ways to show it ---


class _Output(ABC):
    """A way to show tables.

    Attributes:
        context: Context manager that is open while tables are shown.
    """

    context: AbstractContextManager[Any] = nullcontext()

    @abstractmethod
    def show(self, watch: _Watch) -> None:
        """Show the present table."""


class _Json(_Output):
    """One object a line."""

    def show(self, watch: _Watch) -> None:
        import msgspec

        whole = {"t": round(time.time(), 3), "aircraft": watch.states(), "link": watch.link_counters()}
        sys.stdout.buffer.write(msgspec.json.encode(whole) + b"\n")
        sys.stdout.buffer.flush()


class _Lines(_Output):
    """Plain lines, one an aircraft."""

    def show(self, watch: _Watch) -> None:
        now = time.strftime("%H:%M:%SZ", time.gmtime())
        for state in watch.states():
            cells = zip(COLUMNS, _cells(state), strict=True)
            print(now, *(f"{name} {text}" if name != "aircraft" else text for name, text in cells), sep="  ")
        print(now, f"link {watch.url}", _link_text(watch), sep="  ", flush=True)


class _Screen(_Output):
    """A table that is redrawn in place."""

    def __init__(self, console: Console) -> None:
        from rich.live import Live

        self._console = console
        self.context = self._live = Live(console=console, auto_refresh=False, vertical_overflow="crop")

    def show(self, watch: _Watch) -> None:
        room, width = max(self._console.height - LINES_BESIDE, 1), self._console.width
        self._live.update(table_of(watch.states(), room, width, f"{watch.url}: {_link_text(watch)}"), refresh=True)


def _output(as_json: bool) -> _Output:
    if as_json:
        return _Json()
    if not sys.stdout.isatty():
        return _Lines()
    from rich.console import Console

    return _Screen(Console())


COLUMNS = ("aircraft", "age s", "Hz", "position deg", "m/s", "error m", "size m", "disc m", "tightest", "m", "margin m")
NAMES = ("aircraft", "tightest")
SHORTEST_NAME = 8
WIDE = 100
"""Least width of a terminal, in columns, that all columns of the table fit into."""

LEFT_OUT = {100: ("size m", "m"), 76: ("position deg", "error m")}
"""Columns of the table that are left out on a terminal with fewer columns than the key."""


def _cells(state: State) -> list[str]:
    nearest = state["nearest"]
    interval_s = state["update_interval_s"]
    return [
        state["uas"],
        f"{state['age_s']:.1f}",
        f"{1.0 / interval_s:.1f}" if interval_s else "-",
        f"{state['latitude_deg']:.5f},{state['longitude_deg']:.5f}",
        or_dash(state["speed_horizontal_mps"]),
        or_dash(state["horizontal_error_m"]),
        or_dash(state["airframe_size_m"]),
        or_dash(state["disc_radius_m"]),
        "-" if nearest is None else nearest["uas"],
        "-" if nearest is None else f"{nearest['distance_m']:.1f}",
        "-" if nearest is None else f"{nearest['margin_m']:.1f}",
    ]


def table_of(states: list[State], most: int, width: int, caption: str) -> Table:
    """A table of as many states as fit; figures are never cut, names are if they must be.

    Args:
        states: States of all aircraft.
        most: Rows at most.
        width: Columns of the terminal.
        caption: Text below the table.
    """
    from rich.table import Table
    from rich.text import Text

    room = 2 if width >= WIDE else 1
    left_out = {head for least, heads in LEFT_OUT.items() if width < least for head in heads}
    heads = [head for head in COLUMNS if head not in left_out]
    rows = [dict(zip(COLUMNS, _cells(state), strict=True)) for state in states[:most]]
    taken = sum(max([len(head), *(len(row[head]) for row in rows)]) + room for head in heads if head not in NAMES)
    longest = max((width - taken) // len(NAMES) - room, SHORTEST_NAME)
    table = Table(box=None, header_style="bold", pad_edge=False, padding=(0, room, 0, 0), caption_justify="left")
    for head in heads:
        table.add_column(head, justify="left" if head in NAMES else "right", no_wrap=True)
    for state, row in zip(states, rows, strict=False):
        style = "bold red" if _margin(state) < 0.0 else ""
        table.add_row(*(Text(_cut(row[head], longest) if head in NAMES else row[head], style) for head in heads))
    more = f" ({len(states) - most} more)" if len(states) > most else ""
    table.caption = Text(f"{len(states)} in the air{more}; {caption}")
    return table


def _cut(name: str, longest: int) -> str:
    """A name cut in the middle, as on the page: serial numbers of one maker differ in their last characters."""
    return name if len(name) <= longest else f"{name[: longest - 6]}\N{HORIZONTAL ELLIPSIS}{name[-5:]}"


def _link_text(watch: _Watch) -> str:
    """Counts of what came over the link; of the other counters those that are not zero."""
    counters = watch.link_counters()
    shown = (name for name, count in counters.items() if count or name in ("frames", "remote_id"))
    return ", ".join(f"{name.replace('_', ' ')} {counters[name]:,}" for name in shown)
