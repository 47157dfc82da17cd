"""``ridlink view``: the traffic in a browser."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import click

from ridlink.cli import EXIT_DONE
from ridlink.cli.files import refuse_unreadable
from ridlink.cli.options import NAME, accuracy_convention, capture_kind, definition, definition_of, refuse_recording
from ridlink.cli.progress import StatusLine
from ridlink.cli.reviewing import exit_code
from ridlink.cli.signals import stopped_by_signals

if TYPE_CHECKING:
    from ridlink.links import LinkUrl
    from ridlink.view.show import Show

AIR = "udpout:127.0.0.1:14650"


@click.command(short_help="Show the traffic in a browser: live, or a recording.")
@click.argument("files", nargs=-1, metavar="[FILE]...", type=NAME)
@click.option("--source", metavar="URL", help=f"Link on which the traffic is heard.  [default: {AIR}, the air]")
@click.option("--host", default="127.0.0.1", show_default=True, metavar="ADDRESS", help="Address to listen on.")
@click.option("--port", type=click.IntRange(0, 65535), default=8090, show_default=True, metavar="PORT",
              help="Port of the page; 0 = any.")  # fmt: skip
@click.option("--allow-host", "names", multiple=True, metavar="NAME",
              help="A name by which browsers may ask for the page, beside localhost and --host.")  # fmt: skip
@definition
@accuracy_convention
@click.option("--memory", "memory_mb", type=click.IntRange(1, 65536), default=64, show_default=True, metavar="MB",
              help="Memory of the history.")  # fmt: skip
@click.option("--open", "opens", is_flag=True, help="Open the page in a browser.")
@capture_kind("Format of the files; auto tells it by content and suffix.")
def view(
    files: tuple[str, ...],
    source: str | None,
    host: str,
    port: int,
    names: tuple[str, ...],
    definition: str,
    accuracy_convention: str,
    memory_mb: int,
    opens: bool,
    kind: str,
) -> int:
    """Show who is in the air, with discs, encounters and a scrubber, until Ctrl-C.

    \b
    ridlink view                                  what the emulated radio carries
    ridlink view --source udpin:127.0.0.1:14550   what a vehicle sends to a ground station
    ridlink view flight.tlog                      a recording; of several files, one picture
    """
    if files and source is not None:
        raise click.UsageError("either a FILE or --source, not both")
    refuse_recording(source or AIR)
    for file in files:
        refuse_unreadable(file)

    import asyncio

    from ridlink.links import parse_link_url
    from ridlink.view.recorded import read_history
    from ridlink.view.scenery import Scenery
    from ridlink.view.server import check_can_listen
    from ridlink.view.show import Show

    sized_by = definition_of(definition)
    memory_bytes = memory_mb * 2**20
    url: LinkUrl | None = None
    code = EXIT_DONE
    if files:
        check_can_listen(host, port)  # not after an hour of reading
        line = StatusLine()
        scenery, history, sources = read_history(
            files, kind, memory_bytes=memory_bytes, convention=accuracy_convention,
            on_progress=lambda share, time_s: line.show(f"reading: {100.0 * share:.0f} %, {time_s:.0f} s of traffic"),
        )  # fmt: skip
        line.clear()
        code = exit_code(sources, 0, is_strict=False)
        if history.thinned:
            click.echo(f"ridlink: kept one instant in {2**history.thinned} to stay within {memory_mb} MB "
                       "(--memory)", err=True)  # fmt: skip
        show = Show(scenery, sized_by, history=history)
    else:
        import time

        url = parse_link_url(source or AIR)
        where = "the air" if source is None else str(url)
        scenery = Scenery(where, "air" if source is None else "link", live=True, utc0_s=time.time())
        show = Show(scenery, sized_by, memory_bytes=memory_bytes)
    asyncio.run(_serve(show, url, host, port, names, accuracy_convention, opens))
    return code


async def _serve(
    show: Show, url: LinkUrl | None, host: str, port: int, names: tuple[str, ...], accuracy_convention: str, opens: bool
) -> None:
    import asyncio
    from contextlib import AsyncExitStack

    from ridlink.companions import beside
    from ridlink.links import Scheme, open_link
    from ridlink.observer import Sky
    from ridlink.view.kernels import load_kernels
    from ridlink.view.live import Receiver, subscribe
    from ridlink.view.server import ViewServer

    stop = stopped_by_signals(asyncio.get_running_loop())
    receiver = Receiver(show, sky=Sky(convention=accuracy_convention))
    server = ViewServer(show, host, port, names=names, health=receiver.health if url is not None else dict)
    async with AsyncExitStack() as ends:
        await ends.enter_async_context(server.serving())
        if url is not None:
            link = await open_link(url, receiver.hear)
            ends.callback(link.close)
            await ends.enter_async_context(beside(receiver.run(server)))
            if url.scheme is Scheme.UDPOUT:
                await ends.enter_async_context(beside(subscribe(link)))
        announce(server.url, opens, " (Ctrl-C ends)")
        await ends.enter_async_context(beside(load_kernels(show)))
        await stop.wait()


def _say(line: str) -> None:
    click.echo(line, err=True)


def announce(url: str, opens: bool, remark: str = "", say: Callable[[str], None] = _say) -> None:
    """Print the address of the page, and open it if wanted."""
    say(f"ridlink: the page is at {url}{remark}")
    if opens:
        import webbrowser

        if not webbrowser.open(url):
            say("ridlink: there is no browser here to open it")
