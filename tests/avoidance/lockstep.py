"""Virtual-time worlds for the avoidance kernels: many at once, in lockstep, with vehicles that do not obey at once.

Physics at 20 ms; every vehicle decides and reports at 10 Hz in a phase of its own. Reports arrive 0.1 to 0.3 s late and
carry the position error of the sender; own positions carry the same error. North-east axes throughout.

Flights begin at cruise towards the goal, from a hover, or at given velocities. Who has arrived is gone at once if it is
ideal, as in the paper; with an autopilot it comes down where it is, and for so long it is an obstacle that avoids
nobody.

The responses are fits to what the two autopilots do with velocity setpoints: ArduPilot shapes its target with limited
acceleration (2.5 m/s^2) and jerk (5 m/s^3) and follows it through a delay of 0.06 s and a lag of 0.1 s; PX4 closes a
velocity loop without shaping, against a strong drag, through a delay of 0.03 s and a lag of 0.17 s.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from ridlink.avoidance import rows
from ridlink.avoidance.obstacles import Obstacles
from ridlink.avoidance.priority import give_way_in_worlds, new_turns
from ridlink.avoidance.progress import ProgressWatch
from ridlink.avoidance.roadmap import new_roadmap
from ridlink.avoidance.settings import HalfplaneSettings
from ridlink.avoidance.worlds import avoid_worlds, halfplane_scratch, new_memory
from ridlink.separation import Definition, Discs, Reported, separation_discs
from ridlink.separation.reference import REPORT_INTERVAL_S
from tests.avoidance.first_form import FirstForm

STEP_S = 0.02
PHASES = 5
ARRIVED_M = 5.0
LANDING_S = 35.0
"""Descent from 45 m at 1.5 m/s, and the last ten metres more slowly."""
MEMORY = 16
WATCH = ProgressWatch()
"""Only its constants: here its rule is written out for whole arrays."""


@dataclass(frozen=True)
class Scene:
    """Where vehicles start and go: positions (N, 2), speeds (N,), cooperative (N,), or with W worlds in front of N."""

    start: np.ndarray
    goal: np.ndarray
    speed: np.ndarray
    cooperative: np.ndarray
    polygons: tuple = ()

    @property
    def count(self) -> int:
        return self.start.shape[-2]


def scene(start, goal, speed=10.0, cooperative=None, polygons=()) -> Scene:
    start, goal = np.asarray(start, float), np.asarray(goal, float)
    count = start.shape[-2]
    flags = np.ones(count, bool) if cooperative is None else np.asarray(cooperative)
    return Scene(start, goal, np.broadcast_to(np.asarray(speed, float), (count,)).copy(), flags, polygons)


def circle(count=8, radius_m=100.0, speed=10.0) -> Scene:
    angle = 2.0 * np.pi * np.arange(count) / count
    start = radius_m * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return scene(start, -start, speed)


def head_on(offset_m=0.0, speed=10.0, cooperative=None) -> Scene:
    return scene([[-250.0, 0.0], [250.0, offset_m]], [[250.0, 0.0], [-250.0, offset_m]], speed, cooperative)


def crossing(speed=10.0, cooperative=None) -> Scene:
    return scene([[-250.0, 0.0], [0.0, -250.0]], [[250.0, 0.0], [0.0, 250.0]], speed, cooperative)


def overtaking(speed=10.0) -> Scene:
    return scene([[-250.0, 0.0], [-150.0, 0.0]], [[250.0, 0.0], [350.0, 0.0]], [speed, speed / 2.0])


def with_bystanders(plan: Scene) -> Scene:
    """The same with two more in the air, 190 m to either side, who are heard and in nobody's way."""
    side = np.array([[-250.0, 190.0], [-250.0, -190.0]])
    return scene(
        np.concatenate([plan.start, side]),
        np.concatenate([plan.goal, side * (-1.0, 1.0)]),
        np.concatenate([plan.speed, plan.speed[:1], plan.speed[:1]]),
        np.concatenate([plan.cooperative, [True, True]]),
    )


def square24(speed=10.0) -> Scene:
    along = np.arange(6) * 100.0 - 250.0
    side = np.full(6, 300.0)
    start = np.concatenate(
        [np.stack(pair, axis=1) for pair in ((-side, along), (side, along), (along, -side), (along, side))]
    )
    goal = np.concatenate(
        [np.stack(pair, axis=1) for pair in ((side, along), (-side, along), (along, side), (along, -side))]
    )
    block = ((-40.0, -40.0), (40.0, -40.0), (40.0, 40.0), (-40.0, 40.0))
    return scene(start, goal, speed, polygons=(block,))


def beside(*plans: Scene, worlds: int) -> Scene:
    """Scenes of equally many vehicles in one batch: `worlds` worlds of the first, then as many of the next."""
    start, goal, speed, cooperative = (
        np.repeat([getattr(plan, name) for plan in plans], worlds, axis=0)
        for name in ("start", "goal", "speed", "cooperative")
    )
    return Scene(start, goal, speed, cooperative, plans[0].polygons)


def length(vector: np.ndarray) -> np.ndarray:
    """Lengths of vectors (..., 2): the numbers of `np.linalg.norm`, for these small arrays in a fifth of its time."""
    first, second = vector[..., 0], vector[..., 1]
    return np.sqrt(first * first + second * second)


class Ideal:
    """Obeys at once."""

    def __init__(self, velocity):
        self.velocity = velocity.copy()

    def advance(self, command):
        self.velocity = command.copy()
        return self.velocity


class ArduPilot:
    """Target shaped with limited acceleration and jerk, then a delay and a first-order lag."""

    def __init__(self, velocity):
        self.velocity = velocity.copy()
        self.target = velocity.copy()
        self.acceleration = np.zeros_like(velocity)
        self.delay = [velocity.copy() for _ in range(3)]

    def advance(self, command):
        jerk, most, gain = 5.0, 2.5, 2.0
        error = command - self.target
        size = length(error)[..., None]
        linear = jerk / gain**2
        wanted = np.where(size > linear, np.sqrt(np.maximum(2.0 * jerk * (size - linear / 2.0), 0.0)), gain * size)
        wanted = np.minimum(wanted, most) * error / np.maximum(size, 1e-9)
        change = wanted - self.acceleration
        step = length(change)[..., None]
        self.acceleration = self.acceleration + change * np.minimum(1.0, jerk * STEP_S / np.maximum(step, 1e-9))
        self.target = self.target + self.acceleration * STEP_S
        self.delay.append(self.target)
        self.velocity = self.velocity + (self.delay.pop(0) - self.velocity) * (STEP_S / 0.1)
        return self.velocity


class Px4:
    """Velocity loop with an integrator, limited tilt, a delay and a lag, against drag."""

    drag = 1.0

    def __init__(self, velocity):
        self.velocity = velocity.copy()
        self.integral = self.drag * velocity / 0.4
        self.force = self.drag * velocity
        self.change = np.zeros_like(velocity)
        self.delay = [velocity.copy() for _ in range(2)]

    def advance(self, command):
        self.delay.append(command)
        error = self.delay.pop(0) - self.velocity
        wanted = 1.8 * error + 0.4 * self.integral - 0.2 * self.change
        size = length(wanted)[..., None]
        saturated = size > 9.8
        gained = error * STEP_S
        if saturated.any():
            wanted = np.where(saturated, wanted * 9.8 / np.maximum(size, 1e-9), wanted)
            gained = np.where(saturated, 0.0, gained)
        self.integral = self.integral + gained
        self.force = self.force + (wanted - self.force) * (STEP_S / 0.17)
        self.change = self.force - self.drag * self.velocity
        self.velocity = self.velocity + self.change * STEP_S
        return self.velocity


RESPONSES = {"ideal": Ideal, "ardupilot": ArduPilot, "px4": Px4}
IDEAL_SETTINGS = HalfplaneSettings(
    response_time_s=0.0, arrival_deceleration_mps2=math.inf, obstacle_deceleration_mps2=math.inf, smoothing=1.0
)


@dataclass
class Outcome:
    """What happened; W worlds of N vehicles."""

    arrival_s: np.ndarray
    collided: np.ndarray
    least_gap_m: np.ndarray
    least_margin_m: np.ndarray
    least_obstacle_m: np.ndarray
    infeasible_share: float
    reversals: float
    path: np.ndarray | None = field(default=None, repr=False)

    @property
    def arrived(self):
        return np.isfinite(self.arrival_s)


def signed_distance(obstacles: Obstacles, position: np.ndarray) -> np.ndarray:
    """Distance of positions (..., 2) to the nearest convex piece, negative inside (by edges, not by corners) [m]."""
    nearest = np.full(position.shape[:-1], np.inf)
    for first, last in pairwise(obstacles.piece_start):
        ring = obstacles.piece_vertex_ne_m[first:last]
        edge = np.roll(ring, -1, axis=0) - ring
        length = np.linalg.norm(edge, axis=1)
        offset = position[..., None, :] - ring
        height = (offset[..., 0] * edge[:, 1] - offset[..., 1] * edge[:, 0]) / length
        along = np.clip((offset * edge).sum(-1) / length**2, 0.0, 1.0)
        distance = np.linalg.norm(offset - along[..., None] * edge, axis=-1).min(axis=-1)
        inside = (height <= 0.0).all(axis=-1)
        nearest = np.minimum(nearest, np.where(inside, -distance, distance))
    return nearest


def discs_at_rest(definition: Definition, airframe_m: np.ndarray, error_bound_m: float) -> tuple[Discs, float]:
    """Discs (W, N, N) of vehicles that do not move, and how they grow with the sum of both speeds [m, s].

    Nothing else about a disc changes in a flight, and to work out all of it at every step took a third of the time.
    """
    own, others = (
        Reported(airframe_m[axes], error_bound_m, speed_mps=0.0) for axes in (np.s_[:, :, None], np.s_[:, None, :])
    )
    return separation_discs(definition, own, others), 0.0 if definition == Definition.SNMAC else REPORT_INTERVAL_S


def fly(
    plan: Scene,
    *,
    worlds=8,
    seed=1,
    response="px4",
    definition=Definition.CANDIDATE2,
    sigma_m=3.5,
    error_bound_m: float | None = None,
    gnss="gauss-markov",
    settings: HalfplaneSettings | None = None,
    duration_s=120.0,
    broadcast_command=True,
    announces=True,
    range_m=400.0,
    latency_s=(0.1, 0.3),
    airframe_m=(0.5, 2.0),
    watch=True,
    from_rest=False,
    first_velocity=None,
    landing_s: float | None = None,
    keep_path=False,
    first_form=False,
) -> Outcome:
    """Fly `worlds` noisy copies of a scene in lockstep, by half-planes or by their first form."""
    if landing_s is None:
        landing_s = 0.0 if response == "ideal" else LANDING_S
    random = np.random.default_rng(seed)
    settings = settings or (IDEAL_SETTINGS if response == "ideal" else HalfplaneSettings())
    count = plan.count
    shape = (worlds, count)
    airframe = random.uniform(*airframe_m, shape)
    position = np.broadcast_to(plan.start, (*shape, 2)).copy()
    goal = np.broadcast_to(plan.goal, (*shape, 2))
    speed = np.broadcast_to(plan.speed, shape)
    cooperative = np.broadcast_to(plan.cooperative, shape)
    to_goal = goal - position
    velocity = to_goal / np.linalg.norm(to_goal, axis=-1, keepdims=True) * speed[..., None]
    if first_velocity is not None:
        velocity = np.broadcast_to(first_velocity, velocity.shape).copy()
    elif from_rest:
        velocity = np.where(cooperative[..., None], 0.0, velocity)
    model = RESPONSES[response](velocity)
    command = velocity.copy()
    error = random.normal(0.0, sigma_m, (*shape, 2))
    keep = math.exp(-STEP_S / 10.0)
    phase = random.integers(0, PHASES, shape)
    obstacles = Obstacles.from_polygons(plan.polygons)

    own = np.zeros((*shape, rows.OWN_COLUMNS))
    own[..., rows.LIMIT] = own[..., rows.CRUISE] = speed
    heard = np.zeros((*shape, 8))
    vehicles = np.arange(worlds * count)
    sent_at, arrives_at = (np.full((*shape, MEMORY), np.inf) for _ in range(2))
    reports = np.zeros((*shape, MEMORY, 6))
    sent_at[..., 0] = arrives_at[..., 0] = 0.0
    reports[..., 0, :2], reports[..., 0, 2:4] = position + error, velocity
    reports[..., 0, 4:6] = command if broadcast_command else np.nan
    every_sent_at, every_arrival, every_report = sent_at.reshape(-1), arrives_at.reshape(-1), reports.reshape(-1, 6)
    first_slot, slot = MEMORY * vehicles, np.ones(worlds * count, np.int64)
    present = np.ones(shape, bool)
    active = np.ones(shape, bool)
    memory, turns = new_memory(*shape), new_turns(*shape)
    route, roadmap = np.zeros(shape, np.int64), new_roadmap(obstacles)
    scratch = halfplane_scratch(*shape, obstacles)
    former = FirstForm(*shape) if first_form else None
    in_turn, identities = np.zeros((count, 10)), np.zeros(count, np.int64)
    result = np.zeros((*shape, rows.RESULT_COLUMNS))
    vector = settings.as_vector()
    itself, nobody = np.eye(count, dtype=bool), np.zeros(shape, bool)
    mac = (airframe[:, :, None] + airframe[:, None, :]) / 2.0
    arrival = np.full(shape, np.inf)
    collided = np.zeros(shape, bool)
    least_gap = np.full(worlds, np.inf)
    least_margin = np.full(worlds, np.inf)
    least_obstacle = np.full(worlds, np.inf)
    bound = 3.0 * sigma_m if error_bound_m is None else error_bound_m
    clearance = airframe / 2.0 + bound
    discs, growth_s = discs_at_rest(definition, airframe, bound)
    disc_m = discs.radius_m
    turn = np.zeros(shape)
    window = round(WATCH.window_s / 0.1)
    distances = np.full((window, *shape), np.nan)
    course = plan.goal - plan.start
    course = course / np.linalg.norm(course, axis=-1, keepdims=True)
    last_lateral = np.zeros(shape)
    reversals = decisions = infeasible = 0
    path = []
    changed = True
    steps = round(duration_s / STEP_S)
    for step in range(steps):
        now = step * STEP_S
        if changed:
            everyone, all_active, deciders = present.all(), active.all(), cooperative & active
            heard[..., 7] = deciders & announces
            both = present[:, :, None] & present[:, None, :] & ~itself
            judged = both & active[:, :, None] & active[:, None, :]
            mac_of_both = np.where(both, mac, -np.inf)
            beside_the_point = np.where(judged, 0.0, np.inf)
            changed = False
        turn_now = phase == step % PHASES
        if not everyone:
            turn_now = turn_now & present
        if gnss == "gauss-markov":
            error = keep * error + math.sqrt(1.0 - keep**2) * random.normal(0.0, sigma_m, (*shape, 2))
        else:
            error = np.where(turn_now[..., None], random.normal(0.0, sigma_m, (*shape, 2)), error)
        reported = position + error

        arrived_times = np.where(arrives_at <= now, sent_at, -np.inf)
        newest = first_slot + np.argmax(arrived_times, axis=-1).reshape(-1)
        heard[..., :6] = every_report[newest].reshape(*shape, 6)
        heard[..., 6] = now - every_sent_at[newest].reshape(shape)
        if not all_active:
            heard[~active, 4:6] = np.nan
        measured = velocity + random.normal(0.0, 0.1, velocity.shape)
        own[..., 0:2], own[..., 2:4], own[..., 4:6], own[..., 6:8] = reported, measured, command, goal
        own_speed = length(measured)
        own[..., rows.CLEARANCE] = clearance + 0.1 * own_speed
        own[..., rows.EXTRA_TURN] = turn
        radius = disc_m + growth_s * (own_speed[:, :, None] + length(heard[..., 2:4])[:, None, :])
        deciding = turn_now & deciders
        if former is not None:
            former.decide(own, deciding, heard, present, radius, discs.error_sum_m, range_m, result)
        else:
            give_way_in_worlds(own, deciding, heard, present, radius, range_m, now, turns, in_turn, identities)
            avoid_worlds(
                own, deciding, heard, present, radius, discs.error_sum_m, range_m, memory, route,
                obstacles.pieces, roadmap, vector, *scratch, result,
            )  # fmt: skip
        command = np.where(deciding[..., None], result[..., 2:4], command)
        if not all_active:
            command[~active] = 0.0
        decisions += np.count_nonzero(deciding)
        infeasible += np.count_nonzero(deciding & (result[..., rows.R_STATUS] == rows.INFEASIBLE))
        lateral = course[..., 0] * command[..., 1] - course[..., 1] * command[..., 0]
        to_a_side = deciding & (np.abs(lateral) > 0.5)
        lateral = np.sign(lateral)
        reversals += np.count_nonzero(to_a_side & (lateral * last_lateral < 0))
        np.copyto(last_lateral, lateral, where=to_a_side)

        publishing = vehicles[turn_now.reshape(-1)]
        if len(publishing):
            place = first_slot[publishing] + slot[publishing]
            told = command if broadcast_command else np.full_like(command, np.nan)
            every_report[place] = np.concatenate([reported, measured, told], axis=-1).reshape(-1, 6)[publishing]
            every_sent_at[place] = now
            every_arrival[place] = now + random.uniform(*latency_s, len(publishing))
            slot[publishing] = (slot[publishing] + 1) % MEMORY

        velocity = model.advance(command)
        moved = velocity * STEP_S
        position = position + (moved if everyone else np.where(present[..., None], moved, 0.0))

        here = length(goal - reported)
        if watch and step % PHASES == 0:
            before = distances[(step // PHASES) % window]
            stalled = (before - here < WATCH.share * speed * WATCH.window_s) & (here > speed)
            rate = np.where(stalled, WATCH.growth_rad_per_s, -WATCH.decay_rad_per_s)
            turn = np.clip(turn + rate * PHASES * STEP_S, 0.0, WATCH.most_rad)
            distances[(step // PHASES) % window] = here

        gap = length(position[:, :, None] - position[:, None, :]) - mac_of_both
        nearest = gap.reshape(worlds, -1).min(axis=1)
        least_gap = np.minimum(least_gap, nearest)
        seen = length(reported[:, :, None] - reported[:, None, :])
        margin = seen - radius + beside_the_point
        least_margin = np.minimum(least_margin, margin.reshape(worlds, -1).min(axis=1))
        if plan.polygons and step % PHASES == 0:
            away = signed_distance(obstacles, position)
            least_obstacle = np.minimum(least_obstacle, np.where(active, away, np.inf).min(axis=1))
        hit = (gap < 0.0).any(axis=2) if (nearest < 0.0).any() else nobody
        there = active & (here < ARRIVED_M) & ~hit
        if hit is not nobody or not all_active or there.any():
            collided |= hit
            arrival = np.where(there, now, arrival)
            changed = True
            active = active & ~there & ~hit
            present = present & ~hit & (active | (now < arrival + landing_s))
        if keep_path:
            path.append(np.where(present[..., None], position, np.nan))
        if not active.any():
            break
    return Outcome(
        arrival, collided, least_gap, least_margin, least_obstacle, infeasible / max(decisions, 1),
        reversals / (worlds * count), path=np.array(path) if keep_path else None,
    )  # fmt: skip


def solo_time(plan: Scene, **options) -> np.ndarray:
    """Arrival times (W, N) of the same vehicles when they hear nobody and nothing collides [s]."""
    lonely = [
        fly(replace(plan, start=plan.start[i : i + 1], goal=plan.goal[i : i + 1], speed=plan.speed[i : i + 1],
                    cooperative=plan.cooperative[i : i + 1]), **options).arrival_s
        for i in range(plan.count)
    ]  # fmt: skip
    return np.concatenate(lonely, axis=1)
