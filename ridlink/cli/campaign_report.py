"""``ridlink campaign report``: a campaign compared with the paper, as JSON, as a page and as pictures."""

from __future__ import annotations

import json
from pathlib import Path

import click

from ridlink.cli.options import PATH


@click.command(short_help="A finished campaign beside the paper: report.json, report.html, pictures.")
@click.argument("folder", metavar="DIR", type=PATH)
def report(folder: Path) -> None:
    """Write into the folder of a campaign what came out of it, beside what the paper prints.

    report.json and report.html hold the table with a verdict for every printed figure, and every cell against the
    paper's Candidates, run by run; the page asks for nothing outside of itself. report.md holds the tables for
    documents. The pictures are PNG and SVG (extra: ridlink[plot]): mission times as box plots and as distributions,
    collisions, time against safety. The paper's distributions of errors and sizes are drawn by 'ridlink analyze --out'.
    """
    from ridlink.analysis.campaign import is_the_papers, judge_cells
    from ridlink.analysis.campaign_figures import draw_campaign
    from ridlink.analysis.campaign_markdown import markdown_report
    from ridlink.analysis.campaign_page import report_page
    from ridlink.analysis.campaign_pairs_page import dominance_table, pairs_table, pooled_table
    from ridlink.analysis.pairs import against_lossless, against_points, dominance, pooled
    from ridlink.campaign_runner.reading import read_campaign
    from ridlink.files import write_together

    configuration, flown = read_campaign(folder)
    as_printed = is_the_papers(configuration)
    judged = judge_cells(flown, as_printed=as_printed)
    points, lossless, together = against_points(flown), against_lossless(flown), pooled(flown)
    above = dominance(points)
    tables = (
        pooled_table(together), dominance_table(above), pairs_table("Against the paper's Candidates", points),
        pairs_table("What lost reports cost", lossless),
    )  # fmt: skip
    figures = draw_campaign(flown, judged)
    title = "The paper's simulation, flown again" if as_printed else "Campaign"
    drawn = {name.removesuffix(".svg"): content for name, content in figures.items() if name.endswith(".svg")}
    document = {
        "configuration": configuration,
        "cells": [cell.as_dict() for cell in judged],
        "pooled": [each.as_dict() for each in together],
        "dominance": [each.as_dict() for each in above],
        "against_candidates": [pair.as_dict() for pair in points],
        "against_lossless": [pair.as_dict() for pair in lossless],
    }
    files = figures | {
        "report.json": json.dumps(document, indent=1).encode(),
        "report.html": report_page(title, judged, tables, drawn).encode(),
        "report.md": markdown_report(flown, points, together).encode(),
    }
    write_together(folder, files)
    for name in files:
        click.echo(folder / name)
