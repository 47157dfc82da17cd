"""``ridlink broadcast``: an honest Remote ID transmitter for any MAVLink autopilot."""

from __future__ import annotations

import json
from typing import Any

import click

from ridlink.cli import EXIT_DONE
from ridlink.cli.flight_lines import module_line
from ridlink.cli.options import signing_options
from ridlink.cli.printing import Printer
from ridlink.cli.signals import stopped_by_signals
from ridlink.words import counted


@click.command(short_help="Transmit a vehicle's Remote ID, made of what its autopilot reports.")
@click.option(
    "--vehicle", default="udpin:127.0.0.1:14540", show_default=True, metavar="URL", help="Link to the autopilot."
)
@click.option("--to", default="udpout:127.0.0.1:14650", show_default=True, metavar="URL", help="Where to transmit.")
@click.option(
    "--form",
    type=click.Choice(["air", "module"]),
    default="air",
    show_default=True,
    help="air for receivers that speak MAVLink, module for a transmitter module.",
)
@click.option(
    "--relay-as",
    metavar="HEX",
    help="Speak for a transmitter, as a receiver on the ground does: its id_or_mac, as in 02:52:49:44:00:01.",
)
@click.option(
    "--airframe", type=float, default=0.6, show_default=True, metavar="M", help="Largest extent, rotors turning."
)
@click.option("--airframe-height", type=float, metavar="M", help="Vertical extent.  [default: as --airframe]")
@click.option("--uas-id", metavar="ID", help="Identity, a serial number.  [default: as the vehicle says, else none]")
@click.option("--operator-id", default="", metavar="ID", help="Identity of the operator.  [default: none]")
@click.option(
    "--vehicle-sysid",
    type=click.IntRange(1, 255),
    metavar="N",
    help="Listen to this system id only.  [default: the first autopilot heard]",
)
@click.option("--allow-v1", is_flag=True, help="Take MAVLink 1 frames from the autopilot as well.")
@signing_options
@click.option("--json", "as_json", is_flag=True, help="One JSON object a second on standard output.")
def broadcast(
    vehicle: str,
    to: str,
    form: str,
    relay_as: str | None,
    airframe: float,
    airframe_height: float | None,
    uas_id: str | None,
    operator_id: str,
    vehicle_sysid: int | None,
    allow_v1: bool,
    as_json: bool,
    **signing: Any,
) -> int:
    """Transmit a vehicle's Remote ID, until Ctrl-C: where its autopilot says it is, and how wrong that may be.

    LOCATION and RIDLINK_SEPARATION ten times a second, identity and operator every 3 s. The error is never smaller than
    what receiver and estimator report; where they are silent or have lost their position, others are told so.

    \b
    ridlink broadcast --airframe 0.9 --uas-id 1581F45TB2191500A03A
    ridlink broadcast --form module --to tcpout:127.0.0.1:5790
    ridlink broadcast --relay-as 02:52:49:44:00:01 --to udpout:127.0.0.1:14550
    """
    import asyncio

    from ridlink.daemon.transmitter import Transmitter, TransmitterConfig
    from ridlink.links import SigningOptions, parse_link_url
    from ridlink.own_ship.broadcast import BroadcastSettings, Form

    config = TransmitterConfig(
        vehicle=parse_link_url(vehicle),
        to=parse_link_url(to),
        settings=BroadcastSettings(
            airframe_m=airframe,
            airframe_height_m=airframe if airframe_height is None else airframe_height,
            uas_id=None if uas_id is None else uas_id.encode(),
            operator_id=operator_id.encode(),
            form=Form(form),
            relayed_as=None if relay_as is None else _bytes_of(relay_as),
        ),
        vehicle_sysid=vehicle_sysid,
        signing=SigningOptions.of(**signing),
        allow_v1=allow_v1,
    )
    printer = Printer()
    told: list[str] = []

    def tell(facts: dict[str, Any]) -> None:
        if as_json:
            printer.put(json.dumps(facts) + "\n")
        elif (line := _line(facts)) and [line] != told:
            told[:] = [line]
            printer.put(f"ridlink: {line}\n", error=True)

    async def run() -> dict[str, Any]:
        return await Transmitter(config, on_event=tell).run(stopped_by_signals(asyncio.get_running_loop()))

    try:
        final = asyncio.run(run())
        printer.put((json.dumps(final) if as_json else counted(final["sent"], "datagram") + " sent") + "\n")
    finally:
        printer.close()
    return EXIT_DONE


def _line(facts: dict[str, Any]) -> str:
    if facts["event"] == "module":
        return module_line(facts)
    match facts["state"]:
        case "waiting":
            return "waiting for the heartbeat of an autopilot" + (f": {facts['why']}" if facts["why"] else "")
        case "no-position":
            return f"system {facts['system_id']} has no position, and others are told so"
        case _:
            identity = facts["identity"] or "nobody: give --uas-id"
            return f"transmitting for system {facts['system_id']} as {identity}"


def _bytes_of(text: str) -> bytes:
    try:
        return bytes.fromhex(text.replace(":", ""))
    except ValueError:
        raise click.BadParameter(
            f"{text!r} is not an address in hexadecimal, as in 02:52:49:44:00:01", param_hint="--relay-as"
        ) from None
