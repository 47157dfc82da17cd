"""Tracks of pairs: what each vehicle has received of each other one, as the daemon keeps it of its neighbours.

A report updates the track of each receiver that gets it. Between reports the track is extrapolated, and discs grow with
its age. A track without a report for too long is dropped, as in `ridlink.traffic.track`. Each receiver smooths reported
positions, as in `ridlink.traffic.position_filter`, or not at all.

Axes: north-east, metres, m/s, seconds. W worlds of N vehicles; of two axes of vehicles the receiver's comes first.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ridlink.avoidance import rows
from ridlink.avoidance.encounter import time_to_entry
from ridlink.avoidance.rows import VELOCITY
from ridlink.compiled import kernel_decorator
from ridlink.traffic import track
from ridlink.traffic.track import COAST_FAST_S, COAST_SLOW_S, SLOW_INTERVAL_S

FloatArray = NDArray[np.float64]

SOURCES = (
    Path(__file__), Path(__file__).with_name("pair_deciding.py"), Path(track.__file__),
    *sorted(Path(rows.__file__).parent.glob("*.py")),
)  # fmt: skip
"""Files with kernels that the kernels of pairs call, and with their constants."""

kernel = kernel_decorator(SOURCES, counted=False)

# Columns of a report in the channel, and of a track: position, velocity and command (NaN if none is sent) at the time
# AT. A track also has the time of its last report, the number of reports (0: no track), whether the last one was beyond
# the bound, and the smoothed time between reports.
(PLACE, MOTION, INTENT, AT, REPORT_COLUMNS) = (0, 2, 4, 6, 7)
(HEARD_AT, COUNT, BEYOND, BETWEEN, TRACK_COLUMNS) = (7, 8, 9, 10, 11)

CONFLICT_S = 8.0
"""A neighbour that enters the disc within this time is in conflict, and its track is kept for longer."""

SAME_INSTANT_S = 1e-9


class Picture(NamedTuple):
    """The knowledge that the vehicles of W worlds have of each other.

    Attributes:
        tracks: Track of each by each, shape (W, N, N, TRACK_COLUMNS).
        present: Mask of vehicles in the air, shape (W, N); the others have reported that they landed.
        now_s: Time.
        reciprocal: Whether the vehicle has said that it avoids, shape (W, N), 0 or 1.
        still_m: Radii of the discs without displacement, shape (W, N, N).
        error_sum_m: Parts of the radii for localization errors, shape (W, N, N).
        displaced_s: Time of flight of both vehicles that the discs allow for.
    """

    tracks: FloatArray
    present: NDArray[np.bool_]
    now_s: float
    reciprocal: FloatArray
    still_m: FloatArray
    error_sum_m: FloatArray
    displaced_s: float


@kernel
def take_report(report, now_s, bound_m, time_constant_s, flown_s, track):  # type: ignore[no-untyped-def]
    """Update a track by a report.

    Args:
        report: Shape (REPORT_COLUMNS,).
        now_s: Time of receipt.
        bound_m: Reported three-sigma error of the position.
        time_constant_s: Time constant of the filter; 0 uses reports unfiltered.
        flown_s: Time before a report during which its velocity was already flown; earlier, the velocity changed towards
            it.
        track: Shape (TRACK_COLUMNS,), written.
    """
    n_1, n_2 = report[PLACE], report[PLACE + 1]
    reports = track[COUNT]
    if reports > 0.0 and time_constant_s > 0.0:
        elapsed = report[AT] - track[AT]
        old_share = 0.5 * max(elapsed - flown_s, 0.0) / max(elapsed, SAME_INSTANT_S)
        v_1 = old_share * track[MOTION] + (1.0 - old_share) * report[MOTION]
        v_2 = old_share * track[MOTION + 1] + (1.0 - old_share) * report[MOTION + 1]
        p_1, p_2 = track[PLACE] + v_1 * elapsed, track[PLACE + 1] + v_2 * elapsed
        off = math.sqrt((n_1 - p_1) ** 2 + (n_2 - p_2) ** 2)
        beyond = off > bound_m
        if off <= 2.0 * bound_m and not (beyond and track[BEYOND] != 0.0):
            gain = max(1.0 / (reports + 1.0), 1.0 - math.exp(-elapsed / time_constant_s))
            n_1, n_2 = p_1 + gain * (n_1 - p_1), p_2 + gain * (n_2 - p_2)
            track[BEYOND] = 1.0 if beyond else 0.0
        else:
            reports, track[BEYOND] = 0.0, 0.0
    if track[COUNT] > 0.0:
        track[BETWEEN] += 0.3 * (now_s - track[HEARD_AT] - track[BETWEEN])
    track[COUNT] = reports + 1.0
    track[PLACE], track[PLACE + 1] = n_1, n_2
    for column in range(MOTION, REPORT_COLUMNS):
        track[column] = report[column]
    track[HEARD_AT] = now_s


@kernel(nogil=True)
def hear(sent, arrives_s, now_s, bound_m, time_constant_s, flown_s, tracks):  # type: ignore[no-untyped-def]
    """Let every vehicle process the reports that have arrived.

    Args:
        sent: Last reports of each vehicle, shape (W, N, M, REPORT_COLUMNS).
        arrives_s: Arrival time at each receiver, infinite if never or already processed, shape (W, N, N, M), written.
        now_s: Time.
        bound_m: Reported error bounds, shape (W, N).
        time_constant_s: As in `take_report`.
        flown_s: As in `take_report`.
        tracks: Shape (W, N, N, TRACK_COLUMNS), written.
    """
    for world in range(sent.shape[0]):
        for i in range(sent.shape[1]):
            for j in range(sent.shape[1]):
                track, arrives = tracks[world, i, j], arrives_s[world, i, j]
                while True:
                    oldest = -1
                    for slot in range(len(arrives)):
                        if arrives[slot] > now_s + SAME_INSTANT_S:
                            continue
                        if track[COUNT] > 0.0 and sent[world, j, slot, AT] <= track[AT]:
                            # A later report arrived first.
                            arrives[slot] = math.inf
                        elif oldest < 0 or sent[world, j, slot, AT] < sent[world, j, oldest, AT]:
                            oldest = slot
                    if oldest < 0:
                        break
                    arrives[oldest] = math.inf
                    report = sent[world, j, oldest]
                    take_report(report, now_s, bound_m[world, j], time_constant_s, flown_s, track)


@kernel
def collect(own, world, i, picture, memory, room):  # type: ignore[no-untyped-def]
    """Neighbours of one vehicle as rows for `packing.pack`; tracks that are too old are dropped.

    Args:
        own: Own row.
        world: Number of its world.
        i: Number of the vehicle.
        picture: `Picture`; tracks are written.
        memory: `Memory` of the encounters, shape (N,).
        room: Results: rows of the neighbours (W, N, 10), their memory and their numbers (W, N); and more.

    Returns:
        Number of neighbours.
    """
    tracks, present, reciprocal = picture.tracks[world, i], picture.present[world], picture.reciprocal[world]
    still_m, error_sum_m = picture.still_m[world, i], picture.error_sum_m[world, i]
    now_s, displaced_s = picture.now_s, picture.displaced_s
    reports, kept, names = room[0][world], room[1][world], room[2][world]
    speed = math.sqrt(own[VELOCITY] ** 2 + own[VELOCITY + 1] ** 2)
    count = 0
    for j in range(len(tracks)):
        track = tracks[j]
        if j == i or not present[j] or track[COUNT] == 0.0:
            continue
        age, silent = now_s - track[AT], now_s - track[HEARD_AT]
        radius = still_m[j] + displaced_s * (speed + math.sqrt(track[MOTION] ** 2 + track[MOTION + 1] ** 2))
        if silent > COAST_FAST_S:
            r_1 = track[PLACE] + track[MOTION] * age - own[0]
            r_2 = track[PLACE + 1] + track[MOTION + 1] * age - own[1]
            w_1, w_2 = own[VELOCITY] - track[MOTION], own[VELOCITY + 1] - track[MOTION + 1]
            entry = time_to_entry(r_1, r_2, w_1, w_2, radius, math.inf)
            slow = track[BETWEEN] > SLOW_INTERVAL_S or entry <= CONFLICT_S
            if silent > COAST_SLOW_S or not slow:
                track[COUNT] = 0.0
                continue
        report = reports[count]
        for column in range(AT):
            report[column] = track[column]
        report[6], report[7], report[8], report[9] = age, reciprocal[j], radius, error_sum_m[j]
        kept[count], names[count] = memory[j], j
        count += 1
    return count
