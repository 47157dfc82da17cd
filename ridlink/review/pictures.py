"""Two pictures of an encounter: both tracks, and the distance with the distance that each definition requires."""

from __future__ import annotations

import math

import numpy as np

from ridlink.review.drawing import Frame
from ridlink.review.report import Met
from ridlink.separation.definitions import Definition

PLAN = (400.0, 400.0)
DISTANCE = (560.0, 400.0)
LEAST_SPAN_M = 20.0
TRACK_STYLES = ("one", "two")
MOST_TIMES_ASKED = 3.0
"""The axis of distances ends at this many times the greatest required distance."""


def style_of(definition: Definition) -> str:
    """CSS class of the lines of a definition."""
    return f"d-{definition}"


def plan(met: Met) -> str:
    """Both tracks, north up, in metres about the closest approach, with the errors and the connecting line there."""
    assert met.trace is not None
    tracks, k = met.trace.tracks_ne_m, _closest(met)
    middle = (tracks[0][k] + tracks[1][k]) / 2.0
    norths, easts = ([track[:, axis] - middle[axis] for track in tracks] for axis in (0, 1))
    errors = met.row["horizontal_error_m"]
    room_m = max(LEAST_SPAN_M / 2.0, *(error or 0.0 for error in errors), met.row["closest_m"]) / 2.0
    frame = Frame.true_to_scale(
        *PLAN, *((float(min(map(np.min, axis), default=0.0)) - room_m,
                  float(max(map(np.max, axis), default=0.0)) + room_m) for axis in (easts, norths))
    )  # fmt: skip
    parts = [frame.axes("east [m]", "north [m]")]
    for name, style, north, east, error in zip(met.row["uas"], TRACK_STYLES, norths, easts, errors, strict=True):
        if error is not None:
            parts.append(frame.circle(east[k], north[k], error, f"error {style}"))
        parts.append(frame.line(east, north, f"track {style}"))
        parts.append(frame.dot(east[0], north[0], f"start {style}", 3.0))
        parts.append(frame.text(east[0], north[0], name, f"name {style}", below=bool(north[k] > north[0])))
    parts.append(frame.line([east[k] for east in easts], [north[k] for north in norths], "closest"))
    for style, north, east in zip(TRACK_STYLES, norths, easts, strict=True):
        parts.append(frame.dot(east[k], north[k], f"here {style}"))
    return frame.drawing(parts, f"Tracks of {' and '.join(met.row['uas'])}, seen from above")


def distance(met: Met) -> str:
    """Distance over time, and the distance that each definition requires."""
    assert met.trace is not None
    since_s = met.trace.time_s - met.row["start_t"]
    required = met.trace.required_m
    asked_m = max(float(np.max(radius)) for radius in required.values())
    top_m = 1.05 * min(max(float(met.trace.distance_m.max()), asked_m), MOST_TIMES_ASKED * asked_m)
    last_s = max(float(since_s[-1]), 1.0)
    frame = Frame(*DISTANCE, (0.0, last_s), (0.0, top_m))
    shown = np.where(met.trace.distance_m <= top_m, met.trace.distance_m, np.nan)
    parts = [frame.axes("since the encounter began [s]", "between centres [m]")]
    parts += [frame.line(since_s, radius, f"required {style_of(kind)}") for kind, radius in required.items()]
    parts.append(frame.line([0.0, last_s], [met.row["mac_distance_m"]] * 2, "mac"))
    parts.append(frame.line(since_s, shown, "distance"))
    closest_s = met.row["closest_t"] - met.row["start_t"]
    parts.append(frame.dot(closest_s, met.row["closest_m"], "here"))
    parts.append(frame.text(closest_s, met.row["closest_m"], f"{met.row['closest_m']:.1f} m", "name"))
    return frame.drawing(parts, "Distance between the two over time")


def _closest(met: Met) -> int:
    assert met.trace is not None
    at = met.row["closest_t"]
    if at is None or not math.isfinite(at):
        return 0
    return int(np.abs(met.trace.time_s - at).argmin())
