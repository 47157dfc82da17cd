"""``ridlink doctor``: checks before a flight."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

import click

from ridlink.cli import EXIT_DONE, EXIT_NEGATIVE
from ridlink.words import counted

if TYPE_CHECKING:
    from ridlink.doctor import Finding

MARKS = {"ok": ("ok", "green"), "note": ("--", "blue"), "warning": ("!!", "yellow"), "failure": ("XX", "red")}
NAME_WIDTH = 20


@click.command(short_help="What a machine, an autopilot and the air lack for a flight.")
@click.option("--vehicle", metavar="URL", help="Look at the autopilot there, too, as in udpin:127.0.0.1:14540.")
@click.option("--rid", metavar="URL", help="Listen to the air there, too, as in udpout:127.0.0.1:14650.")
@click.option("--json", "as_json", is_flag=True, help="One JSON object on standard output.")
def doctor(vehicle: str | None, rid: str | None, as_json: bool) -> int:
    """Say what this machine, an autopilot and the air lack for a flight, each with its remedy.

    \b
    ridlink doctor                                     this machine
    ridlink doctor --vehicle udpin:127.0.0.1:14540     and the autopilot that speaks there

    It arms nothing and changes nothing: of an autopilot it asks for the values of a few parameters. Exit code 1 if
    something will not work.
    """
    import asyncio

    from ridlink.doctor import Verdict, examine_air, examine_machine, examine_vehicle
    from ridlink.links import parse_link_url

    vehicle_url = None if vehicle is None else parse_link_url(vehicle)
    rid_url = None if rid is None else parse_link_url(rid)
    findings: list[Finding] = []

    def show(finding: Finding) -> None:
        findings.append(finding)
        if not as_json:
            _show(finding)

    for finding in examine_machine():
        show(finding)
    if vehicle_url is not None:
        for finding in asyncio.run(examine_vehicle(vehicle_url)):
            show(finding)
    if rid_url is not None:
        for finding in asyncio.run(examine_air(rid_url)):
            show(finding)
    fit = not any(finding.verdict is Verdict.FAILURE for finding in findings)
    warnings = sum(finding.verdict is Verdict.WARNING for finding in findings)
    if as_json:
        import msgspec

        click.echo(msgspec.json.encode({"fit": fit, "findings": [finding.as_dict() for finding in findings]}))
    else:
        verdict = "fit to fly emulated vehicles" if vehicle is None else "fit to fly"
        click.echo(f"{verdict if fit else 'not fit to fly'}; {counted(warnings, 'warning')}")
    return EXIT_DONE if fit else EXIT_NEGATIVE


def _show(finding: Finding) -> None:
    mark, colour = MARKS[finding.verdict]
    plain = False if os.environ.get("NO_COLOR") else None  # None: colours only if the output is a terminal
    click.echo(f"{click.style(mark, fg=colour)}  {finding.name:<{NAME_WIDTH}} {finding.text}", color=plain)
    if finding.remedy:
        click.echo(f"    {'':<{NAME_WIDTH}} -> {finding.remedy}")
