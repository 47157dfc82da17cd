"""``ridlink mqtt``: the traffic on a broker."""

from __future__ import annotations

import errno
import os
import socket
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ridlink.cli import EXIT_DONE
from ridlink.cli.options import NAME, PATH, accuracy_convention, definition, definition_of
from ridlink.cli.signals import stopped_by_signals
from ridlink.errors import ConfigError
from ridlink.words import counted

if TYPE_CHECKING:
    from ridlink.metrics import MetricsServer
    from ridlink.mqtt.bridge import Bridge

PASSWORD_VARIABLE = "RIDLINK_MQTT_PASSWORD"


@click.command(short_help="Publish the traffic on an MQTT broker.")
@click.option("--broker", required=True, metavar="URL", help="mqtt://HOST[:PORT], or mqtts:// for TLS; USER@HOST.")
@click.option(
    "--source",
    default="udpout:127.0.0.1:14650",
    show_default=True,
    metavar="URL",
    help="Link on which the traffic is heard.",
)
@click.option(
    "--site",
    default=socket.gethostname,
    show_default="host name",
    metavar="NAME",
    help="Level of the topics: this place.",
)
@click.option("--prefix", default="ridlink", show_default=True, metavar="TOPIC", help="First level of the topics.")
@definition
@accuracy_convention
@click.option(
    "--rate", type=float, default=1.0, show_default=True, metavar="HZ", help="States of each aircraft a second."
)
@click.option("--batch", is_flag=True, help="All states of an instant in one message.")
@click.option("--password-file", type=PATH, metavar="FILE",
              help=f"Password of the broker's user; or {PASSWORD_VARIABLE}.")  # fmt: skip
@click.option("--ca-file", type=NAME, metavar="FILE.pem",
              help="Certificates to trust, instead of the system's.")  # fmt: skip
@click.option("--home-assistant", is_flag=True,
              help="Announce each aircraft as a device tracker; not with --batch.")  # fmt: skip
@click.option("--in", "feed", metavar="TOPIC", help="Take a foreign JSON feed as traffic; needs --relay.")
@click.option("--relay", metavar="URL", help="Where the traffic of the feed goes, as Remote ID frames.")
@click.option("--metrics", metavar="HOST:PORT", help="Serve Prometheus metrics there (extra metrics).")
def mqtt(
    broker: str,
    source: str,
    site: str,
    prefix: str,
    definition: str,
    accuracy_convention: str,
    rate: float,
    batch: bool,
    password_file: Path | None,
    ca_file: str | None,
    home_assistant: bool,
    feed: str | None,
    relay: str | None,
    metrics: str | None,
) -> int:
    """Publish who is in the air, who meets whom and alerts on an MQTT broker, until Ctrl-C.

    \b
    ridlink mqtt --broker mqtt://127.0.0.1 --site field-1
    mosquitto_sub -t 'ridlink/v1/field-1/#' -v

    The connection comes back by itself; meanwhile the latest values wait. No topic steers a vehicle.
    """
    import asyncio
    from importlib.metadata import version

    from ridlink.companions import beside
    from ridlink.links import parse_link_url
    from ridlink.metrics import MQTT_METRICS, MetricsServer, parse_metrics_address
    from ridlink.mqtt import Publisher, PublisherSettings, Topics, parse_broker_url
    from ridlink.mqtt.bridge import Bridge

    sized_by = definition_of(definition)
    if (feed is None) != (relay is None):
        raise click.UsageError("--in and --relay belong together: from where on the broker, and to which link")
    topics = Topics(site, prefix)
    publisher = Publisher(
        PublisherSettings(
            topics=topics,
            definition=sized_by,
            convention=accuracy_convention,
            rate_hz=rate,
            batch=batch,
            home_assistant=home_assistant,
        ),
        version("ridlink"),
    )
    broker_url, source_url = parse_broker_url(broker), parse_link_url(source)
    relay_url = None if relay is None else parse_link_url(relay)
    if ca_file is not None and not broker_url.encrypted:
        raise click.UsageError("--ca-file is for mqtts:, and mqtt: does not encrypt")
    password = _password(password_file)
    metrics_address = None if metrics is None else parse_metrics_address(metrics)

    async def run() -> Bridge:
        bridge = Bridge(
            broker_url,
            topics,
            publisher,
            source_url,
            password=password,
            ca_file=ca_file,
            feed_topic=feed,
            relay=relay_url,
            on_event=lambda text: click.echo(f"ridlink: {text}", err=True),
        )
        stop = stopped_by_signals(asyncio.get_running_loop())
        if metrics_address is None:
            await bridge.run(stop)
            return bridge
        server = MetricsServer(metrics_address, MQTT_METRICS)
        try:
            async with beside(_leave_figures(bridge, server)):
                await bridge.run(stop)
        finally:
            await asyncio.to_thread(server.close)
        return bridge

    bridge = asyncio.run(run())
    waited = bridge.outbox.replaced + bridge.outbox.dropped
    published = counted(bridge.counters["published"], "message")
    connections = counted(bridge.counters["connections"], "connection")
    click.echo(f"{topics.root}: {published}, {connections}, {waited:,} overtaken by newer ones")
    return EXIT_DONE


async def _leave_figures(bridge: Bridge, server: MetricsServer) -> None:
    import asyncio

    while True:
        outbox, counters = bridge.outbox, bridge.counters
        server.publish(
            {
                "ridlink_mqtt_published": counters["published"],
                "ridlink_mqtt_connections": counters["connections"],
                "ridlink_mqtt_waiting": len(outbox),
                "ridlink_mqtt_overtaken": outbox.replaced,
                "ridlink_mqtt_dropped": outbox.dropped,
                "ridlink_mqtt_events": bridge.events(),
            }
        )
        await asyncio.sleep(1.0)


def _password(file: Path | None) -> str | None:
    """The password, from a file that only its owner can read, or from the environment.

    Raises:
        ConfigError: If other users can read the file, or it is no text.
        OSError: If it cannot be read.
    """
    if file is None:
        return os.environ.get(PASSWORD_VARIABLE)
    if file.is_dir():
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(file))
    if file.stat().st_mode & 0o077:
        raise ConfigError(f"{file}: others can read it; chmod 600 {file}")
    try:
        return file.read_text("utf-8").rstrip("\r\n")
    except UnicodeDecodeError as error:
        raise ConfigError(f"{file}: is not UTF-8 text: {error.reason}") from error
