"""Decisions of the half-plane and the rotation solver in batches: ``python -m tests.bench.avoidance``.

Vehicles are spread evenly, 24 to a square of 600 m, at 10 m/s in all directions with discs of 24 m. In worlds of up to
24 everybody hears everybody. The kernels have no grid to find neighbours in: for more vehicles, or fewer neighbours,
each decides as the only one in a world of its own with its k nearest, which numpy finds beforehand, untimed. Filling
such a world for one decision is timed with it.

In the same rounds plain ORCA (`reference_orca`) decides for the same vehicles among the same neighbours, and
Python-RVO2 (module `rvo2`), where it is installed, for the same crowds, its own search for neighbours included;
half-planes alone are compared with them. The set-up of Python-RVO2 compiles it without optimisation, six to nine times
as slow as with `-O3`.
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
import time
from functools import partial
from typing import Any

import numpy as np

from ridlink.avoidance import HalfplaneSettings, Obstacles, RotationSettings, rows
from ridlink.campaign.deciding import new_decider
from tests.avoidance.reference_orca import Orca
from tests.bench.measure import ROUNDS, interleaved

SPEED_MPS, DISC_M, ERROR_SHARE, SPACING_M = 10.0, 24.0, 0.8, 600.0 / 24**0.5
EVERYWHERE_M = 1e9
HALFPLANES, ROTATION = HalfplaneSettings(), RotationSettings.paper()
Settings = HalfplaneSettings | RotationSettings
WORLDS, VEHICLES = 500, 24
CROWDS = ((8, 7), (24, 10), (24, 23), (100, 10), (100, 23), (1000, 10), (1000, 23), (10_000, 10), (10_000, 23))
"""Vehicles, and how many of them each hears."""
RVO2_DECISIONS = 2_000
DECISIONS = 100_000
"""Of a batch at a time: a campaign takes hundreds of steps of the same worlds one after the other."""


def drawn(random: np.random.Generator, shape: tuple[int, ...], extent_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Positions and velocities, shape (..., 2)."""
    angle = random.uniform(-np.pi, np.pi, shape)
    velocity = SPEED_MPS * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    return random.uniform(0.0, extent_m, (*shape, 2)), velocity


def nearest(position: np.ndarray, count: int) -> np.ndarray:
    """Indices of each vehicle and its `count` nearest, itself first, shape (n, count + 1)."""
    found = []
    for first in range(0, len(position), 256):
        part = position[first : first + 256]
        square = ((part[:, None] - position) ** 2).sum(-1)
        square[np.arange(len(part)), np.arange(first, first + len(part))] = -1.0
        near = np.argpartition(square, count, axis=1)[:, : count + 1]
        order = np.argsort(np.take_along_axis(square, near, axis=1), axis=1, kind="stable")
        found.append(np.take_along_axis(near, order, axis=1))
    return np.concatenate(found)


class Batch:
    """The same step of W worlds of N vehicles again and again."""

    def __init__(
        self, position: np.ndarray, velocity: np.ndarray, deciding: np.ndarray, settings: Settings, threads: int = 1
    ) -> None:
        shape = position.shape[:2]
        self.decisions = int(deciding.sum())
        self._decider = new_decider(settings, (shape[0], shape[1]), Obstacles.from_polygons(()), threads=threads)
        own, heard = np.zeros((*shape, rows.OWN_COLUMNS)), np.zeros((*shape, 8))
        own[..., 0:2], own[..., 2:4], own[..., 4:6], own[..., 6:8] = (
            position, velocity, velocity, position + 60.0 * velocity,
        )  # fmt: skip
        own[..., rows.LIMIT] = own[..., rows.CRUISE] = SPEED_MPS
        heard[..., 0:2], heard[..., 2:4], heard[..., 4:6], heard[..., 6], heard[..., 7] = (
            position, velocity, np.nan, 0.2, 1.0,
        )  # fmt: skip
        self.plain = Orca(position, velocity, deciding, DISC_M, SPEED_MPS)
        radius = np.full((*shape, shape[1]), DISC_M)
        self._picture = (own, deciding, heard, np.ones(shape, np.bool_), radius, ERROR_SHARE * radius, EVERYWHERE_M)

    def step(self) -> np.ndarray:
        """Decide for everybody."""
        return self._decider.decide(*self._picture)

    def infeasible(self) -> float:
        """Share of the decisions without an admissible velocity."""
        status = self.step()[..., rows.R_STATUS][self._picture[1]]
        return float((status == rows.INFEASIBLE).mean())


def worlds(random: np.random.Generator, settings: Settings = HALFPLANES, threads: int = 1) -> Batch:
    """500 worlds of 24 in which everybody hears everybody."""
    shape = (WORLDS, VEHICLES)
    return Batch(*drawn(random, shape, SPACING_M * VEHICLES**0.5), np.ones(shape, np.bool_), settings, threads)


def crowd(random: np.random.Generator, vehicles: int, neighbours: int, settings: Settings) -> Batch:
    """One crowd of which each hears its nearest."""
    position, velocity = drawn(random, (vehicles,), SPACING_M * vehicles**0.5)
    if neighbours == vehicles - 1:
        return Batch(position[None], velocity[None], np.ones((1, vehicles), np.bool_), settings)
    near = nearest(position, neighbours)
    deciding = np.zeros(near.shape, np.bool_)
    deciding[:, 0] = True
    return Batch(position[near], velocity[near], deciding, settings)


class Rvo2:
    """The same crowd for Python-RVO2, as often as makes RVO2_DECISIONS: it moves vehicles, and each is to move little.

    Raises:
        ImportError: If it is not installed.
    """

    def __init__(self, vehicles: int, neighbours: int) -> None:
        import rvo2  # type: ignore[import-not-found]

        random, extent_m = np.random.default_rng(1), SPACING_M * vehicles**0.5
        self._simulators = [
            rvo2.PyRVOSimulator(0.1, EVERYWHERE_M, neighbours, 8.0, 2.0, DISC_M / 2.0, SPEED_MPS)
            for _ in range(max(1, RVO2_DECISIONS // vehicles))
        ]
        self.decisions = vehicles * len(self._simulators)
        for simulator in self._simulators:
            for place, flown in zip(*(part.tolist() for part in drawn(random, (vehicles,), extent_m)), strict=True):
                agent = simulator.addAgent(tuple(place))
                simulator.setAgentVelocity(agent, tuple(flown))
                simulator.setAgentPrefVelocity(agent, tuple(flown))

    def step(self) -> None:
        """Decide for everybody once, and move."""
        for simulator in self._simulators:
            simulator.doStep()


def peers() -> dict[tuple[int, int], Rvo2]:
    """Of every batch; none if Python-RVO2 is not installed."""
    try:
        return {(vehicles, neighbours): Rvo2(vehicles, neighbours) for vehicles, neighbours in CROWDS}
    except ImportError:
        return {}


def crowds(settings: Settings, peers: dict[tuple[int, int], Rvo2]) -> list[dict[str, Any]]:
    """Time of a decision on one thread, interleaved; every batch is stepped for so many DECISIONS in a round."""
    random = np.random.default_rng(1)
    batches = {(vehicles, neighbours): crowd(random, vehicles, neighbours, settings) for vehicles, neighbours in CROWDS}
    batches[WORLDS * VEHICLES, VEHICLES - 1] = worlds(random, settings)
    times = {key: max(1, DECISIONS // batch.decisions) for key, batch in batches.items()}

    def steps(decider: Batch | Orca, count: int) -> None:
        for _ in range(count):
            decider.step()

    actions: dict[str, Any] = {}
    for key, batch in batches.items():
        actions[f"{key[0]} {key[1]}"] = partial(steps, batch, times[key])
        if settings is HALFPLANES:
            actions[f"orca {key[0]} {key[1]}"] = partial(steps, batch.plain, times[key])
    seconds = interleaved(actions | {f"rvo2 {key[0]} {key[1]}": peer.step for key, peer in peers.items()})
    table = []
    for vehicles, neighbours in batches:
        batch, each = batches[vehicles, neighbours], times[vehicles, neighbours]
        spent = [1e9 * one / each / batch.decisions for one in seconds[f"{vehicles} {neighbours}"]]
        plain = [1e9 * one / each / batch.decisions for one in seconds.get(f"orca {vehicles} {neighbours}", ())]
        same = (VEHICLES if vehicles == WORLDS * VEHICLES else vehicles, neighbours)
        peer = [1e9 * one / peers[same].decisions for one in seconds[f"rvo2 {same[0]} {same[1]}"]] if peers else None
        table.append(
            {
                "vehicles": vehicles,
                "worlds": WORLDS if vehicles == WORLDS * VEHICLES else 1,
                "neighbours": neighbours,
                "decision_ns": statistics.median(spent),
                "decision_min_ns": min(spent),
                "decision_max_ns": max(spent),
                "per_s": 1e9 / statistics.median(spent),
                "infeasible": batch.infeasible(),
                "plain_orca_ns": statistics.median(plain) if plain else None,
                "python_rvo2_ns": None if peer is None else statistics.median(peer),
            }
        )
    return table


def slope(table: list[dict[str, Any]]) -> float:
    """What a neighbour more costs, from the largest crowd [ns]."""
    few, many = (row for row in table if row["vehicles"] == 10_000)
    return float((many["decision_ns"] - few["decision_ns"]) / (many["neighbours"] - few["neighbours"]))


def threads() -> float:
    """How many times faster two threads are than one, over the worlds, by the wall clock; 1 on one core."""
    least = []
    for count in (1, min(2, len(os.sched_getaffinity(0)))):
        batch = worlds(np.random.default_rng(1), threads=count)
        batch.step()
        taken = []
        for _ in range(3 * ROUNDS):
            begun = time.perf_counter()
            batch.step()
            taken.append(time.perf_counter() - begun)
        least.append(min(taken))
    return least[0] / least[1]


STARTING = """
import time
import numpy
from ridlink.avoidance.solver import warm_up
from tests.bench.avoidance import worlds
batch = worlds(numpy.random.default_rng(1))
begun = time.process_time()
warm_up()
warm = time.process_time()
batch.step()
print(warm - begun, time.process_time() - warm)
"""


def start() -> dict[str, tuple[float, float]]:
    """CPU time until the kernels of a process are ready, those for one own-ship and those for batches besides: with an
    empty cache of compiled code, and with a full one [s]."""
    with tempfile.TemporaryDirectory() as folder:
        command, environment = [sys.executable, "-c", STARTING], os.environ | {"NUMBA_CACHE_DIR": folder}
        cold, cached = (
            subprocess.run(command, capture_output=True, text=True, check=True, env=environment).stdout.split()
            for _ in range(2)
        )
    return {"cold_s": (float(cold[0]), float(cold[1])), "cached_s": (float(cached[0]), float(cached[1]))}


def report() -> dict[str, Any]:
    """Measure everything and print it."""
    beside = peers()
    table, rotation, faster, started = crowds(HALFPLANES, beside), crowds(ROTATION, {}), threads(), start()
    for solver, found in (("half-planes", table), ("rotation", rotation)):
        print(f"\ndecisions by {solver} in batches, CPU time on one thread, median of {ROUNDS} interleaved rounds")
        print(f"{'vehicles':>20}{'neighbours':>12}{'a decision':>14}{'decisions':>14}{'infeasible':>12}  (spread)")
        for row in found:
            name = f"{row['worlds']} x {VEHICLES}" if row["worlds"] > 1 else f"{row['vehicles']:,}"
            told = "".join(
                f"  {peer} {row[key]:,.0f} ns, {row[key] / row['decision_ns']:.1f} times as long"
                for peer, key in (("plain ORCA", "plain_orca_ns"), ("Python-RVO2", "python_rvo2_ns"))
                if row[key]
            )
            print(
                f"{name:>20}{row['neighbours']:>12}{row['decision_ns']:>11.0f} ns{row['per_s']:>12,.0f}/s"
                f"{row['infeasible']:>12.1%}  ({row['decision_min_ns']:.0f}-{row['decision_max_ns']:.0f}){told}"
            )
    print(
        f"half-planes: a neighbour more {slope(table):.1f} ns; two threads over {WORLDS} worlds: {faster:.2f} times one"
    )
    for state, (one, batch) in (("compiled", started["cold_s"]), ("from the cache", started["cached_s"])):
        print(f"half-planes {state}: {one:.2f} s for one own-ship, {batch:.2f} s more for batches")
    if not beside:
        print("Python-RVO2 is not installed: no figures beside it")
    return {
        "batches": table,
        "rotation_batches": rotation,
        "neighbour_ns": slope(table),
        "two_threads": faster,
        "avoidance_start": started,
    }


if __name__ == "__main__":
    report()
