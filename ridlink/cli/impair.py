"""``ridlink impair``: a bad network between two programs."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING

import click

from ridlink.cli import EXIT_DONE
from ridlink.cli.options import duration_option
from ridlink.cli.progress import StatusLine
from ridlink.cli.signals import stopped_by_signals
from ridlink.words import counted

if TYPE_CHECKING:
    from ridlink.impair import Impairment, Proxy
    from ridlink.links import LinkUrl

SHOWN_EVERY_S = 1.0


@click.command(short_help="Stand between two programs as a bad network (UDP).")
@click.option("--listen", "near", required=True, metavar="URL", help="Where the one side speaks to: udpin:HOST:PORT.")
@click.option("--to", "far", required=True, metavar="URL", help="Where the other side listens: udpout:HOST:PORT.")
@click.option("--loss", type=float, default=0.0, metavar="P", help="Share of datagrams lost, from 0 to 1.")
@click.option("--burst", type=float, metavar="N", help="Lose N in a row in the mean (Gilbert's model), not one by one.")
@click.option("--delay", type=float, default=0.0, metavar="S", help="Delay of each datagram [s].")
@click.option("--jitter", type=float, default=0.0, metavar="S", help="Standard deviation of the delay [s].")
@click.option("--duplicate", type=float, default=0.0, metavar="P", help="Share that arrives twice.")
@click.option("--reorder", type=float, default=0.0, metavar="P", help="Share held back by 0.15 s, for others to pass.")
@click.option("--truncate", type=float, default=0.0, metavar="P", help="Share cut at a random byte.")
@click.option("--corrupt", type=float, default=0.0, metavar="P", help="Share with one byte replaced.")
@click.option("--rate", type=float, metavar="B", help="Bytes a second that pass; the queue holds one second.")
@click.option(
    "--direction",
    type=click.Choice(["both", "there", "back"]),
    default="both",
    show_default=True,
    help="What is impaired: the way to the far end, the way back, or both.",
)
@click.option("--seed", type=click.IntRange(min=0), default=1, show_default=True, metavar="N", help="Of all draws.")
@duration_option
@click.option("--json", "as_json", is_flag=True, help="The final counts as one JSON object.")
def impair(
    near: str,
    far: str,
    loss: float,
    burst: float | None,
    delay: float,
    jitter: float,
    duplicate: float,
    reorder: float,
    truncate: float,
    corrupt: float,
    rate: float | None,
    direction: str,
    seed: int,
    duration: float | None,
    as_json: bool,
) -> int:
    """Stand between two programs as a bad network (UDP), until Ctrl-C.

    \b
    ridlink impair --listen udpin:127.0.0.1:24650 --to udpout:127.0.0.1:14650 --loss 0.3 --burst 5
    ridlink avoid --rid udpout:127.0.0.1:24650 ...       hears the air through it

    Any number of programs may speak to the near end; each gets its own answers. The same seed gives the same faults
    to the same datagrams.
    """
    import asyncio

    from ridlink.errors import ConfigError
    from ridlink.impair import Impairment
    from ridlink.links import parse_link_url

    try:
        impairment = Impairment(
            loss=loss,
            burst=burst,
            delay_s=delay,
            jitter_s=jitter,
            duplicate=duplicate,
            reorder=reorder,
            truncate=truncate,
            corrupt=corrupt,
            rate=rate,
        )
    except ConfigError as error:  # begins with a field name: the option's name and a unit
        name, _, text = str(error).partition(" ")
        raise click.UsageError(f"--{name.removesuffix('_s')} {text}") from error
    proxy, took_s = asyncio.run(
        _carry(parse_link_url(near), parse_link_url(far), impairment, direction, seed, duration)
    )
    _report(proxy, took_s, as_json)
    return EXIT_DONE


async def _carry(
    near: LinkUrl, far: LinkUrl, impairment: Impairment, direction: str, seed: int, duration: float | None
) -> tuple[Proxy, float]:
    """Forward until the time is up or a signal comes. Returns the proxy and the time it ran [s]."""
    import asyncio

    from ridlink.impair import Impairment, open_proxy

    loop = asyncio.get_running_loop()
    stop = stopped_by_signals(loop)
    clean = Impairment()
    proxy = await open_proxy(
        near,
        far,
        there=clean if direction == "back" else impairment,
        back=clean if direction == "there" else impairment,
        seed=seed,
    )
    started_s, line = loop.time(), StatusLine()
    click.echo(f"ridlink: {near.at(proxy.near.local_address)} leads to {far}; Ctrl-C stops", err=True)
    try:
        while not stop.is_set() and (duration is None or loop.time() - started_s < duration):
            left_s = SHOWN_EVERY_S if duration is None else min(SHOWN_EVERY_S, started_s + duration - loop.time())
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(stop.wait(), max(0.0, left_s))
            there, back = proxy.totals()
            line.show(
                f"{counted(proxy.speakers, 'speaker')}, there {there['passed']:,} of {there['received']:,}, "
                f"back {back['passed']:,} of {back['received']:,}"
            )
    finally:
        proxy.close()
        line.clear()
    return proxy, round(loop.time() - started_s, 3)


def _report(proxy: Proxy, took_s: float, as_json: bool) -> None:
    there, back = proxy.totals()
    if as_json:
        import msgspec

        counts = {"there": dict(there), "back": dict(back), "proxy": dict(proxy.counters), "duration_s": took_s}
        click.echo(msgspec.json.encode(counts))
        return
    for name, counters in (("there", there), ("back", back)):
        rest = ", ".join(f"{count:,} {cause.replace('_', ' ')}" for cause, count in counters.items())
        click.echo(f"{name}: {rest or 'nothing'}")
    if proxy.counters:
        click.echo(
            "proxy: " + ", ".join(f"{count:,} {cause.replace('_', ' ')}" for cause, count in proxy.counters.items())
        )
