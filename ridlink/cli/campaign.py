"""``ridlink campaign``: many runs of a scene in virtual time, and the table of what came out."""

from __future__ import annotations

import json
import math
import os
import time
from contextlib import closing, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ridlink.cli import EXIT_DONE, EXIT_INTERNAL, EXIT_IO
from ridlink.cli.campaign_report import report
from ridlink.cli.signals import removed_by_signals

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from ridlink.campaign.plan import Plan
    from ridlink.campaign.table import Row
    from ridlink.campaign.worlds import Outcomes
    from ridlink.campaign_runner.choice import Choice

DEFINITIONS = ("snmac", "remote-id", "odid-accuracy", "candidate1", "candidate2", "chance")
PAPER_DEFINITIONS = ("snmac", "remote-id", "candidate1", "candidate2")
GNSS_MODELS = ("white", "white-radial", "gauss-markov", "bias")
SOLVERS = ("halfplane", "graded", "rotation")
DYNAMICS = ("ideal", "px4", "ardupilot")

WIDE = 120
"""Columns that the whole table needs."""


class Names(click.ParamType):  # type: ignore[type-arg]  # generic since click 8.4 only
    """Names apart by commas, each once; of a given set, or any."""

    name = "A,B,..."

    def __init__(self, known: Sequence[str] = ()) -> None:
        self._known = known

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> tuple[str, ...]:
        if isinstance(value, tuple):
            return value
        names = tuple(dict.fromkeys(part.strip() for part in value.split(",")))
        for name in names:
            if not name or (self._known and name not in self._known):
                known = f"; known are {', '.join(self._known)}" if self._known else ""
                self.fail(f"{name!r} is not known{known}.", param, ctx)
        return names


class Within(click.FloatRange):
    """A float in a range; "nan" and "inf" are no figures."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        number: float = super().convert(value, param, ctx)
        if not math.isfinite(number):
            self.fail(f"{value!r} is not a finite number.", param, ctx)
        return number


def _only_ideal(_: click.Context, __: click.Parameter, value: str) -> str:
    if value != "ideal":
        raise click.BadParameter(
            f"{value}: a campaign flies vehicles that obey at once (ideal); 'ridlink demo --autopilot {value}' flies "
            "such in real time."
        )
    return value


@click.group(short_help="Fly many runs in virtual time; the paper's simulation.")
def campaign() -> None:
    """Many runs of a scene in virtual time, through the kernels that the daemon calls."""


campaign.add_command(report)


@campaign.command()
@click.option("--preset", type=click.Choice(["paper"]), help="The paper's simulation, section VI-B.")
@click.option(
    "--scenario",
    "scenarios",
    type=Names(),
    default="circle8,square24",
    show_default=True,
    metavar="NAME|FILE.toml,...",
    help="circle8 and square24, with fleets drawn as the paper's; head-on, crossing, overtake; files.",
)
@click.option(
    "--definition",
    "definitions",
    type=Names(DEFINITIONS),
    help="What sizes the discs.  [default: all; paper: its four]",
)
@click.option(
    "--gnss",
    type=Names(GNSS_MODELS),
    help="How sigma becomes a position error.  [default: gauss-markov; paper: white-radial]",
)
@click.option("--solver", "solvers", type=Names(SOLVERS), help="Who decides.  [default: halfplane; paper: rotation]")
@click.option(
    "--dynamics",
    type=click.Choice(DYNAMICS),
    default="ideal",
    show_default=True,
    callback=_only_ideal,
    help="How vehicles answer; so far at once only.",
)
@click.option(
    "--sigma",
    "sigma_m",
    type=Within(0.0, 1000.0),
    default=10.0,
    show_default=True,
    metavar="M",
    help="Standard deviation per axis, for vehicles of which the scenario says nothing; 0 = exact.",
)
@click.option(
    "--eta",
    type=Within(0.5, 0.999999999),
    default=0.999,
    show_default=True,
    metavar="P",
    help="Of the definition chance: probability per instant.",
)
@click.option("--runs", type=click.IntRange(1, 1_000_000), default=500, show_default=True, help="Runs of each cell.")
@click.option("--seed", type=click.IntRange(0), default=1, show_default=True)
@click.option(
    "--jobs",
    type=click.IntRange(1, 1024),
    metavar="N",
    help="Processes, each of one thread; rows do not depend on it.  [default: one a core]",
)
@click.option("--resume", is_flag=True, help="Go on with what is in the folder: fly only what is missing.")
@click.option(
    "--only-run",
    type=click.IntRange(0),
    metavar="K",
    help="Fly run K alone, as it was flown among others, and print it, vehicle by vehicle.",
)
@click.option(
    "--log",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="F.tlog",
    help="With --only-run: that flight as a MAVLink log, what was true and what was told.",
)
@click.option(
    "-o",
    "--output",
    type=click.Path(path_type=Path),
    metavar="DIR",
    help="Folder of the campaign: its configuration, shards and rows (extra: ridlink[export]).",
)
@click.option("--json", "as_json", is_flag=True, help="One JSON object on standard output instead of the table.")
def run(
    preset: str | None, scenarios: tuple[str, ...], definitions: tuple[str, ...] | None, gnss: tuple[str, ...] | None,
    solvers: tuple[str, ...] | None, dynamics: str, sigma_m: float, eta: float, runs: int, seed: int,
    jobs: int | None, resume: bool, only_run: int | None, log: Path | None, output: Path | None,
    as_json: bool,
) -> int:  # fmt: skip
    """Fly every scenario under every definition, kind of error and solver, and print one row for each.

    Runs are seeded one by one: the same seed gives the same rows, in any number of processes, and a run can be flown
    again alone. Times count the flights without a collision; one that has not arrived by the cut-off counts with it.
    Reported error bounds are three sigma of each vehicle; with --preset paper three sigma for a pair, its reading.

    \b
        ridlink campaign run --preset paper -o paper/
        ridlink campaign run --scenario crossing,mine.toml --definition candidate2,chance --runs 200 -o mine/
        ridlink campaign run --preset paper --definition snmac --scenario circle8 --only-run 17
    """
    if output is None and only_run is None:
        raise click.UsageError("Missing option '-o' / '--output': a campaign is kept in a folder.")
    if log is not None and only_run is None:
        raise click.UsageError("--log goes with --only-run K: one flight, one log.")
    from ridlink.avoidance.types import SolverKind
    from ridlink.campaign.chance import ErrorModel
    from ridlink.campaign_runner.choice import Choice
    from ridlink.separation.definitions import Definition

    paper = preset == "paper"
    choice = Choice(
        scenarios=scenarios,
        definitions=tuple(map(Definition, definitions or (PAPER_DEFINITIONS if paper else DEFINITIONS))),
        gnss=tuple(map(ErrorModel, gnss or ("white-radial" if paper else "gauss-markov",))),
        solvers=tuple(map(SolverKind, solvers or ("rotation" if paper else "halfplane",))),
        paper=paper,
        sigma_m=sigma_m,
        eta=eta,
        seed=seed,
    )
    if only_run is not None:
        return _fly_one(choice.plans(), only_run, log, as_json)
    assert output is not None
    return _fly_all(choice, runs, jobs or len(os.sched_getaffinity(0)), output, resume, as_json)


def _fly_all(choice: Choice, runs: int, jobs: int, output: Path, resume: bool, as_json: bool) -> int:
    from ridlink.campaign.table import table_rows
    from ridlink.campaign.worlds import Outcomes
    from ridlink.campaign_runner.folder import CampaignFolder
    from ridlink.campaign_runner.pool import WorkerLostError, fly_tasks, tasks_of

    plans = choice.plans()
    folder = CampaignFolder(output, choice.configuration(plans, runs), resume=resume)
    tasks = tasks_of(plans, runs)
    missing = [task for task in tasks if folder.read(plans[task.plan], task.runs) is None]
    kept = len(tasks) - len(missing)
    begin, steps = time.monotonic(), 0
    try:
        with _progress(len(tasks), kept, jobs) as done, removed_by_signals(folder.discard_unfinished):
            with closing(fly_tasks(plans, missing, jobs)) as flown:
                for task, outcomes in flown:
                    folder.write(plans[task.plan], outcomes)
                    kept += 1
                    steps += int(outcomes.decisions.sum())
                    done(steps)
            wall_s = time.monotonic() - begin
            parts: list[list[Outcomes]] = [[] for _ in plans]
            for task in tasks:
                part = folder.read(plans[task.plan], task.runs)
                if part is None:
                    raise OSError(0, "a shard that was written cannot be read", str(output))
                parts[task.plan].append(part)
            rows = table_rows([(plan, Outcomes.joined(part)) for plan, part in zip(plans, parts, strict=True)])
            folder.write_rows([row.as_dict() for row in rows])
    except WorkerLostError as error:
        return _ended(str(error), kept, len(tasks), EXIT_INTERNAL)
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        return _ended(f"{where}{error.strerror or error}", kept, len(tasks), EXIT_IO)
    _show(rows, steps, wall_s, as_json)
    return EXIT_DONE


def _ended(why: str, kept: int, all_of_them: int, code: int) -> int:
    click.echo(f"ridlink: {why}; {kept} of {all_of_them} shards are kept, --resume goes on from there", err=True)
    return code


def _fly_one(plans: list[Plan], number: int, log: Path | None, as_json: bool) -> int:
    """One run of every cell, vehicle by vehicle."""
    from ridlink.campaign.table import table_rows
    from ridlink.campaign.worlds import fly
    from ridlink.campaign_runner.flight_log import log_run

    if log is not None and len(plans) != 1:
        raise click.UsageError(f"--log takes one scenario, definition, gnss and solver; these are {len(plans)} cells.")
    begin = time.monotonic()
    if log is None:
        cells = [(plan, fly(plan, range(number, number + 1))) for plan in plans]
    else:
        cells = [(plans[0], log_run(plans[0], number, log))]
    wall_s = time.monotonic() - begin
    vehicles = [each for plan, outcomes in cells for each in _vehicles(plan, outcomes)]
    steps = sum(int(outcomes.decisions.sum()) for _, outcomes in cells)
    if not as_json:
        for each in vehicles:
            end = "collided" if each["collided"] else "did not arrive"
            if each["arrival_s"] is not None:
                end = f"arrived after {each['arrival_s']:.1f} s"
            click.echo(
                f"{each['scenario']} {each['definition']} {each['gnss']} {each['solver']} run {number} "
                f"vehicle {each['vehicle']}: {end}"
            )
    _show(table_rows(cells), steps, wall_s, as_json, {"run": number, "vehicles": vehicles})
    return EXIT_DONE


def _vehicles(plan: Plan, outcomes: Outcomes) -> Iterator[dict[str, Any]]:
    for k, (arrival_s, collided) in enumerate(zip(outcomes.arrival_s[0], outcomes.collided[0], strict=True), start=1):
        yield {
            "scenario": plan.scene.name,
            "definition": str(plan.definition),
            "gnss": str(plan.errors),
            "solver": str(plan.solver),
            "vehicle": k,
            "arrival_s": float(arrival_s) if math.isfinite(arrival_s) else None,
            "collided": bool(collided),
        }


# --- what is shown ----------------------------------------------------------------------------------------------------


@contextmanager
def _progress(total: int, kept: int, jobs: int) -> Iterator[Callable[[int], None]]:
    """Says on standard error how far it is: a bar where a terminal watches, else a line at both ends.

    Gives a function to call after each shard, with the decisions made so far.
    """
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    begin = time.monotonic()
    if not console.is_terminal:
        click.echo(f"campaign: {total} shards, {kept} kept from before, {jobs} processes", err=True)
        made = 0

        def count(steps: int) -> None:
            nonlocal made
            made = steps

        yield count
        seconds = time.monotonic() - begin
        click.echo(f"campaign: {total} shards done, {made} decisions in {seconds:.1f} s", err=True)
        return
    columns = (
        TextColumn("flying"), BarColumn(), MofNCompleteColumn(), TextColumn("shards"),
        TextColumn("{task.fields[rate]}"), TimeRemainingColumn(),
    )  # fmt: skip
    with Progress(*columns, console=console, auto_refresh=False, transient=True) as progress:
        bar = progress.add_task("", total=total, completed=kept, rate="")

        def advance(steps: int) -> None:
            rate = steps / max(time.monotonic() - begin, 1e-9)
            progress.update(bar, advance=1, rate=f"{rate:,.0f} decisions/s", refresh=True)

        progress.refresh()
        yield advance


def _show(rows: list[Row], steps: int, wall_s: float, as_json: bool, more: dict[str, Any] | None = None) -> None:
    rate = steps / wall_s if wall_s > 0.0 else 0.0
    if as_json:
        document = {"rows": [row.as_dict() for row in rows], "agent_steps": steps, "wall_s": wall_s,
                    "agent_steps_per_s": rate, **(more or {})}  # fmt: skip
        click.echo(json.dumps(document))
        return
    from rich.console import Console
    from rich.table import Table

    console = Console()
    width = console.width if console.is_terminal else WIDE
    for group in dict.fromkeys((row.gnss, row.solver) for row in rows):
        table = Table(
            box=None, header_style="bold", pad_edge=False, padding=(0, 2 if width >= WIDE else 1, 0, 0),
            title=f"{group[0]} errors, solver {group[1]}, {rows[0].runs} runs", title_justify="left",
        )  # fmt: skip
        figures = [(row, _figures(row, width >= WIDE)) for row in rows if (row.gnss, row.solver) == group]
        for head in ("scenario", "definition"):
            table.add_column(head, no_wrap=True)
        for head in figures[0][1]:
            table.add_column(head, justify="right", no_wrap=True)
        for row, cells in figures:
            table.add_row(row.scenario, row.definition, *cells.values())
        Console(width=width).print(table)
        click.echo()
    click.echo(f"{steps:,} decisions in {wall_s:.1f} s")


def _figures(row: Row, all_of_them: bool) -> dict[str, str]:
    """Cells of a row by the heads of their columns; the last ones only where there is room."""
    low, high = (100.0 * share for share in row.mac_rate_ci95)
    median = "-" if row.median_s is None else f"{row.median_s:.1f}"
    if row.median_ci95:
        median += f" ({row.median_ci95[0]:.1f}-{row.median_ci95[1]:.1f})"
    figures = {
        "MACs": f"{row.macs}/{row.flights:,}",
        "% (95 %)": f"{100.0 * row.mac_rate:.2f} ({low:.2f}-{high:.2f})" if row.macs else f"below {high:.2g}",
        "late": f"{row.unfinished}",
        "median s (95 %)": median,
        "ratio": _or_dash(row.ratio_to_snmac, 2),
    }
    if all_of_them:
        figures |= {
            "longest s": _or_dash(row.max_time_s, 1),
            "nearest m": _or_dash(row.min_separation_m, 1),
            "infeasible %": f"{100.0 * row.infeasible_share:.1f}",
        }
    return figures


def _or_dash(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"
