"""``ridlink campaign``: many runs of a scene in virtual time, and the table of results."""

from __future__ import annotations

import math
import os
import time
from contextlib import ExitStack, closing
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from click.core import ParameterSource

from ridlink.cli import EXIT_DONE, EXIT_INTERNAL, EXIT_IO
from ridlink.cli.campaign_options import (
    BASELINE,
    DEFINITIONS,
    LARGEST,
    PAPER_DEFINITIONS,
    air_options,
    cell_options,
    fleet_options,
)
from ridlink.cli.campaign_report import report
from ridlink.cli.campaign_show import progress_shown, say, say_if_compiling, show_rows
from ridlink.cli.options import PATH
from ridlink.cli.signals import removed_by_signals
from ridlink.words import counted

if TYPE_CHECKING:
    from collections.abc import Iterator

    from ridlink.campaign.plan import Plan
    from ridlink.campaign.worlds import Outcomes
    from ridlink.campaign_runner.choice import Choice


@click.group(short_help="Fly many runs in virtual time; the paper's simulation.")
def campaign() -> None:
    """Many runs of a scene in virtual time, through the kernels that the daemon calls."""


campaign.add_command(report)


@campaign.command(short_help="Fly scenes under definitions, errors and solvers; one row for each.")
@cell_options
@air_options
@fleet_options
@click.option(
    "--runs", type=click.IntRange(1, 1_000_000), default=500, show_default=True, metavar="N", help="Runs of each cell."
)
@click.option(
    "--seed", type=click.IntRange(0, LARGEST), default=1, show_default=True, metavar="N", help="Of all draws."
)
@click.option(
    "--jobs",
    type=click.IntRange(1, 1024),
    metavar="N",
    help="Processes, each of one thread; rows do not depend on it.  [default: one a core]",
)
@click.option(
    "--scheduler",
    metavar="tcp://HOST:PORT",
    help="Fly on the workers of a dask scheduler instead; the shards are kept here (extra: ridlink[cluster]).",
)
@click.option("--resume", is_flag=True, help="Go on with what is in the folder: fly only what is missing.")
@click.option(
    "--only-run",
    type=click.IntRange(0, LARGEST),
    metavar="K",
    help="Fly run K alone, as it was flown among others, and print it, vehicle by vehicle.",
)
@click.option(
    "--log",
    type=PATH,
    metavar="F.tlog",
    help="With --only-run: that flight as a MAVLink log, what was true and what was told; replaces the file.",
)
@click.option(
    "-o",
    "--output",
    type=PATH,
    metavar="DIR",
    help="Folder of the campaign: its configuration, shards and rows (extra: ridlink[export]).  "
    "[required; not with --only-run, which keeps nothing]",
)
@click.option("--json", "as_json", is_flag=True, help="One JSON object on standard output instead of the table.")
def run(
    preset: str | None, scenarios: tuple[str, ...], definitions: tuple[str, ...] | None, gnss: tuple[str, ...] | None,
    solvers: tuple[str, ...] | None, points: tuple[str, ...] | None, dynamics: tuple[str, ...],
    sigmas_m: tuple[float, ...], intervals_s: tuple[float, ...] | None, losses: tuple[float, ...] | None, runs: int,
    seed: int, jobs: int | None, scheduler: str | None, resume: bool, only_run: int | None, log: Path | None,
    output: Path | None, as_json: bool,
    **conditions: Any,
) -> int:  # fmt: skip
    """Fly every scenario under every definition, kind of error, solver, dynamics, sigma, interval and loss, and print
    one row for each.

    Runs are seeded one by one: the same seed gives the same rows, in any number of processes, and a run can be flown
    again alone. Times count the flights without a collision; one that has not arrived by the cut-off counts with it.
    Reported error bounds are three sigma of each vehicle; with --preset paper three sigma for a pair, its reading.
    Collisions are judged at the instants of decisions and between them; with --preset paper at them alone.

    \b
        ridlink campaign run --preset paper -o paper/
        ridlink campaign run --scenario crossing,mine.toml --definition candidate2,chance --runs 200 -o mine/
        ridlink campaign run --definition candidate2,none --dynamics px4,ardupilot --loss 0,0.3 --runs 200 -o real/
        ridlink campaign run --preset paper --definition snmac --scenario circle8 --only-run 17
    """
    if output is None and only_run is None:
        raise click.UsageError("Missing option '-o' / '--output': a campaign is kept in a folder.")
    if points and (definitions or solvers):
        raise click.UsageError("--point says definition and solver; --definition and --solver do not go with it.")
    context = click.get_current_context()
    if only_run is not None:
        given = [f"--{name}" for name in ("output", "resume", "jobs", "scheduler") if _was_given(context, name)]
        if given:
            raise click.UsageError(f"{given[0]} does not go with --only-run K: one run is flown here, and not kept.")
        if _was_given(context, "runs") and only_run >= runs:
            raise click.UsageError(f"--only-run {only_run} is none of {runs} runs, which are 0 to {runs - 1}.")
    if log is not None and only_run is None:
        raise click.UsageError("--log goes with --only-run K: one flight, one log.")
    if scheduler is not None and jobs is not None:
        raise click.UsageError("--jobs and --scheduler exclude each other: processes here, or workers there.")
    from ridlink.campaign.chance import ErrorModel
    from ridlink.campaign.response import Dynamics
    from ridlink.campaign_runner.choice import Choice, Conditions

    paper = preset == "paper"
    every = tuple(name for name in DEFINITIONS if name != BASELINE)
    choice = Choice(
        scenarios=scenarios,
        definitions=definitions or _named(points, 0) or (PAPER_DEFINITIONS if paper else every),
        gnss=tuple(map(ErrorModel, gnss or ("white-radial" if paper else "gauss-markov",))),
        solvers=solvers or _named(points, 2) or ("rotation" if paper else "halfplane",),
        dynamics=tuple(map(Dynamics, dynamics)),
        sigmas_m=sigmas_m,
        intervals_s=intervals_s or (),
        losses=losses or (),
        points=tuple((each.partition("/")[0], each.partition("/")[2]) for each in points or ()),
        conditions=Conditions(paper=paper, seed=seed, **conditions),
    )
    for line in choice.left_out():
        click.echo(f"ridlink: {line}", err=True)
    if only_run is not None:
        return _fly_one(choice.plans(), only_run, log, as_json)
    assert output is not None
    return _fly_all(choice, runs, jobs or len(os.sched_getaffinity(0)), scheduler, output, resume, as_json)


def _was_given(context: click.Context, name: str) -> bool:
    """Whether the user gave the option; otherwise its value is the default."""
    return context.get_parameter_source(name) is not ParameterSource.DEFAULT


def _named(points: tuple[str, ...] | None, part: int) -> tuple[str, ...]:
    """Definitions (0) or solvers (2) of points, each once."""
    return tuple(dict.fromkeys(point.partition("/")[part] for point in points or ()))


def _fly_all(
    choice: Choice, runs: int, jobs: int, scheduler: str | None, output: Path, resume: bool, as_json: bool
) -> int:  # fmt: skip
    from ridlink.campaign.table import table_rows
    from ridlink.campaign.worlds import Outcomes
    from ridlink.campaign_runner.cluster import Cluster
    from ridlink.campaign_runner.folder import CampaignFolder
    from ridlink.campaign_runner.pool import WorkerLostError, fly_tasks, tasks_of

    plans = choice.plans()
    with ExitStack() as stack:
        who, cluster = counted(jobs, "process", more="processes"), None
        if scheduler is not None:
            who, cluster = f"workers of {scheduler}", stack.enter_context(closing(Cluster(scheduler, say)))
        configuration = choice.configuration(plans, runs)
        folder = stack.enter_context(closing(CampaignFolder(output, configuration, resume=resume)))
        tasks = tasks_of(plans, runs)
        missing = [task for task in tasks if folder.read(plans[task.plan], task.runs) is None]
        kept = len(tasks) - len(missing)
        if cluster is None:
            say_if_compiling([plans[k] for k in sorted({task.plan for task in missing})])
        begin, steps = time.monotonic(), 0

        def end_by_signal() -> None:
            folder.discard_unfinished()
            say(_left_off(kept, len(tasks)))

        try:
            with progress_shown(len(tasks), kept, who) as done, removed_by_signals(end_by_signal):
                flying = fly_tasks(plans, missing, jobs) if cluster is None else cluster.fly_tasks(plans, missing)
                with closing(flying) as flown:
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
                cells = {plan.cell: Outcomes.joined(part) for plan, part in zip(plans, parts, strict=True)}
                rows = [row for row, _ in table_rows(cells, choice.conditions.seed)]
                folder.write_rows([row.as_dict() for row in rows])
        except WorkerLostError as error:
            return _ended(str(error), kept, len(tasks), EXIT_INTERNAL)
        except OSError as error:
            where = f"{error.filename}: " if error.filename else ""
            return _ended(f"{where}{error.strerror or error}", kept, len(tasks), EXIT_IO)
    show_rows(rows, steps, wall_s, as_json)
    return EXIT_DONE


def _ended(why: str, kept: int, all_of_them: int, code: int) -> int:
    click.echo(f"ridlink: {why}; {_left_off(kept, all_of_them)}", err=True)
    return code


def _left_off(kept: int, all_of_them: int) -> str:
    return f"{kept} of {counted(all_of_them, 'shard')} kept, --resume goes on from there"


def _fly_one(plans: list[Plan], number: int, log: Path | None, as_json: bool) -> int:
    """Fly one run of every cell, and print it vehicle by vehicle."""
    from ridlink.campaign.flight import fly
    from ridlink.campaign.table import table_rows
    from ridlink.campaign_runner.flight_log import log_run

    if log is not None and len(plans) != 1:
        raise click.UsageError(f"--log takes one scenario, definition, gnss and solver; these are {len(plans)} cells.")
    begin = time.monotonic()
    if log is None:
        say_if_compiling(plans)
        cells = [(plan, fly(plan, range(number, number + 1))) for plan in plans]
    else:
        cells = [(plans[0], log_run(plans[0], number, log, lambda: say_if_compiling(plans)))]
    wall_s = time.monotonic() - begin
    vehicles = [each for plan, outcomes in cells for each in _vehicles(plan, outcomes)]
    steps = sum(int(outcomes.decisions.sum()) for _, outcomes in cells)
    if not as_json:
        for each in vehicles:
            end = "collided" if each["collided"] else "did not arrive"
            if each["arrival_s"] is not None:
                end = f"arrived after {each['arrival_s']:.1f} s"
            which = " ".join(str(each[name]) for name in ("scenario", "definition", "gnss", "solver"))
            click.echo(f"{which} run {number} vehicle {each['vehicle']}: {end}")
    rows = [row for row, _ in table_rows({plan.cell: outcomes for plan, outcomes in cells}, plans[0].seed)]
    show_rows(rows, steps, wall_s, as_json, {"run": number, "vehicles": vehicles})
    return EXIT_DONE


def _vehicles(plan: Plan, outcomes: Outcomes) -> Iterator[dict[str, Any]]:
    for k, (arrival_s, collided) in enumerate(zip(outcomes.arrival_s[0], outcomes.collided[0], strict=True), start=1):
        yield {
            **asdict(plan.cell),
            "vehicle": k,
            "arrival_s": float(arrival_s) if math.isfinite(arrival_s) else None,
            "collided": bool(collided),
        }
