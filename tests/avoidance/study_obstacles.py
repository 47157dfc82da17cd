"""Vehicles that must brake and turn at an obstacle at once.

python -m tests.avoidance.study_obstacles [flights]

First one alone, which comes as fast as half-planes let it, or nearly, when its goal moves to somewhere else; then up to
six in random scenes with one to four obstacles, from a hover. Printed: flights in which an obstacle was entered, the
smallest true distance to one [m], and the mean time of the last arrival [s]; of scenes also collisions.
"""

from __future__ import annotations

import math
import sys

import numpy as np

from ridlink.avoidance import HalfplaneSettings, Obstacles, keep_out
from tests.avoidance.lockstep import Outcome, Scene, fly, scene, signed_distance
from tests.avoidance.way_in import way_in

nearest_point, approach_speed = way_in(keep_out.nearest_point), way_in(keep_out.approach_speed)
SETTINGS = HalfplaneSettings()
AIRFRAME_M = 0.6
# Against its drag, the model of PX4 does not fly faster.
SPEEDS_MPS = {"ardupilot": (5.0, 10.0, 15.0, 20.0), "px4": (5.0, 8.0, 9.8)}


def box(south: float, west: float, north: float, east: float) -> tuple:
    """A rectangle."""
    return ((south, west), (north, west), (north, east), (south, east))


SHAPES = {
    "wall": (box(0, -400, 80, 400),),
    "corner": (box(0, -400, 80, 400), box(-400, 100, 0, 180)),
    "box": (box(-20, -20, 20, 20),),
    "gate": (box(0, 12, 10, 120), box(0, -120, 10, -12)),
}


def room_m(speed: float, sigma_m: float) -> float:
    """What half-planes keep from an obstacle, with the buffer."""
    clearance_m = AIRFRAME_M / 2.0 + 3.0 * sigma_m + 0.1 * speed
    return clearance_m * (1.0 + SETTINGS.buffer_share)


def distances(obstacles: Obstacles, place: np.ndarray) -> list[tuple[float, np.ndarray]]:
    """Distance of a place to each piece, and the normal that leads out."""
    normal, found = np.zeros(2), []
    for first, last in zip(obstacles.piece_start[:-1], obstacles.piece_start[1:], strict=True):
        distance = nearest_point(obstacles.piece_vertex_ne_m, first, last, *place, normal)
        found.append((distance, normal.copy()))
    return found


def share_of_approach(obstacles: Obstacles, place: np.ndarray, velocity: np.ndarray, room: float) -> float:
    """The largest share of the speed towards a piece that half-planes would admit; above 1 if it is more."""
    most = 0.0
    for distance, normal in distances(obstacles, place):
        toward = max(-(normal @ velocity), 0.0)
        gap = distance - room - SETTINGS.response_time_s * toward
        if gap <= 0.0:
            return math.inf
        admitted = approach_speed(
            gap, SETTINGS.obstacle_horizon_s, SETTINGS.obstacle_deceleration_mps2, SETTINGS.obstacle_response_s
        )
        most = max(most, toward / admitted)
    return most


def on_a_circle(random: np.random.Generator, radius: float) -> np.ndarray:
    angle = random.uniform(0.0, 2.0 * math.pi)
    return radius * np.array([math.cos(angle), math.sin(angle)])


def approaching(random: np.random.Generator, shape: str, speed: float, sigma_m: float, flights: int):
    """Starts that come at 0.6 to 1 of what is admitted, with goals 80 to 300 m off; and their velocities."""
    obstacles, room, drawn = Obstacles.from_polygons(SHAPES[shape]), room_m(speed, sigma_m), []
    while len(drawn) < flights:
        place, velocity = random.uniform(-100.0, (110.0, 100.0)), on_a_circle(random, speed)
        if not 0.6 < share_of_approach(obstacles, place, velocity, room) <= 1.0:
            continue
        goal = place + on_a_circle(random, random.uniform(80.0, 300.0))
        if min(distance for distance, _ in distances(obstacles, goal)) > room + 2.0:
            drawn.append((place, goal, velocity))
    start, goal, velocity = (np.array(one)[:, None] for one in zip(*drawn, strict=True))
    return scene(start, goal, speed, polygons=SHAPES[shape]), velocity


def fly_alone(shape: str, response: str, speed: float, sigma_m: float, flights: int) -> Outcome:
    """Fly one vehicle each from such starts."""
    plan, velocity = approaching(np.random.default_rng(3), shape, speed, sigma_m, flights)
    return fly(
        plan, worlds=flights, seed=2, response=response, sigma_m=sigma_m, airframe_m=(AIRFRAME_M, AIRFRAME_M),
        first_velocity=velocity, duration_s=300.0,
    )  # fmt: skip


def any_obstacle(random: np.random.Generator) -> np.ndarray:
    """A wall, an L, or a polygon round a circle."""
    kind, place = random.random(), random.uniform(-110.0, 110.0, 2)
    if kind < 0.3:
        corners = np.array(box(-1, -1, 1, 1)) * (random.uniform(3.0, 8.0), random.uniform(15.0, 60.0))
    elif kind < 0.45:
        side = random.uniform(30.0, 80.0)
        corners = np.array([(0, 0), (side, 0), (side, 10), (10, 10), (10, side), (0, side)]) - side / 3.0
    else:
        count = int(random.integers(3, 8))
        angle = (np.arange(count) + random.uniform(0.0, 0.9, count)) * 2.0 * math.pi / count
        corners = random.uniform(10.0, 45.0) * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    c, s = math.cos(turn := random.uniform(0.0, math.pi)), math.sin(turn)
    return corners @ np.array([[c, s], [-s, c]]) + place


def any_scene(random: np.random.Generator, speed: float, sigma_m: float) -> Scene:
    """One to four obstacles and one to six vehicles, whose starts and goals keep apart and clear of them."""
    while True:
        polygons = tuple(any_obstacle(random) for _ in range(random.integers(1, 5)))
        obstacles, vehicles = Obstacles.from_polygons(polygons), int(random.integers(1, 7))
        places: list[np.ndarray] = []
        for _ in range(400):
            place = random.uniform(-170.0, 170.0, 2)
            apart = min((math.dist(place, other) for other in places), default=math.inf)
            if signed_distance(obstacles, place) > room_m(speed, sigma_m) + 4.0 and apart > 12.0 * (1.0 + sigma_m):
                places.append(place)
            if len(places) == 2 * vehicles:
                return scene(np.array(places[:vehicles]), np.array(places[vehicles:]), speed, polygons=polygons)


def report(name: str, flown: list[Outcome], extra: str = "") -> None:
    """Print a row."""
    nearest = np.concatenate([out.least_obstacle_m for out in flown])
    last = np.concatenate([out.arrival_s.max(axis=1) for out in flown])
    arrived = np.isfinite(last)
    print(
        f"{name:28} entered {np.count_nonzero(nearest < 0.0):3} of {len(nearest)}, nearest {nearest.min():5.1f} m, "
        f"last at {last[arrived].mean():5.1f} s, not arrived {np.count_nonzero(~arrived)}{extra}",
        flush=True,
    )


def main() -> None:
    """Print a row for each autopilot, speed and error."""
    flights = int(sys.argv[1]) if len(sys.argv) > 1 else 150
    for response, speeds in SPEEDS_MPS.items():
        for speed in speeds:
            for sigma_m in (0.02, 1.5):
                flown = [fly_alone(shape, response, speed, sigma_m, flights) for shape in SHAPES]
                report(f"{response} {speed:g} m/s, {sigma_m:g} m", flown)
    for response in ("ardupilot", "px4"):
        for speed, sigma_m in ((9.8, 0.02), (9.8, 1.5), (8.0, 3.5)):
            random = np.random.default_rng(5)
            flown = [
                fly(any_scene(random, speed, sigma_m), worlds=2, seed=seed, response=response, sigma_m=sigma_m,
                    from_rest=True, duration_s=400.0)
                for seed in range(flights // 2)
            ]  # fmt: skip
            collided = sum(int(out.collided.any(axis=1).sum()) for out in flown)
            report(f"{response} {speed:g} m/s, {sigma_m:g} m, scenes", flown, f", collided {collided}")


if __name__ == "__main__":
    main()
