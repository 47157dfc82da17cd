"""Instants, encounters and other messages as the JSON text that the page reads. Unknown is null, never NaN.

An instant is encoded once for all pages under one definition, without the closing brace: the selected vehicle and the
fields of the message are appended.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import msgspec
import numpy as np

from ridlink.observer import Encounter, Pairs, Scene, rings
from ridlink.separation.definitions import Definition
from ridlink.view.instants import Instant
from ridlink.view.scenery import Scenery

VERSION = 1
STEP_S = 0.1
MOST_PAIRS = 200
NOT_AVOIDING, STALE = 1, 2
STALE_S = 1.0

TITLES = {
    Definition.SNMAC: "sNMAC: 15 m for everybody",
    Definition.REMOTE_ID: "Remote ID: the worst that the standard allows",
    Definition.ODID_ACCURACY: "Open Drone ID: the accuracy code",
    Definition.CANDIDATE1: "Candidate 1: reported error, largest airframe",
    Definition.CANDIDATE2: "Candidate 2: reported error and airframe",
    Definition.CHANCE: "Chance: apart with a probability of 99.9 %",
}

encode = msgspec.json.encode


def hello(scenery: Scenery, definition: Definition, extent_s: tuple[float, float] | None) -> bytes:
    """The first message to a page."""
    origin = scenery.origin
    return encode(
        {
            "type": "hello",
            "version": VERSION,
            "title": scenery.title,
            "source": scenery.source,
            "live": scenery.live,
            "truth": scenery.truth,
            "definitions": [{"name": str(one), "title": TITLES[one]} for one in Definition],
            "definition": str(definition),
            "step_s": STEP_S,
            **_extent(extent_s),
            "origin": None if origin is None else [origin.latitude_deg, origin.longitude_deg],
            "obstacles": scenery.obstacles,
            "goals": scenery.goals,
            "utc0": scenery.utc0_s,
        }
    )


def instant(
    moment: Instant, scene: Scene, pairs: Pairs, tightest: Pairs, definition: Definition, *, live: bool
) -> bytes:
    """The body of an instant, from its time to its tightest pair: a JSON object without its braces.

    Args:
        moment: The instant.
        scene: The same instant as a scene.
        pairs: The pairs of the scene under that definition that are inside their discs, or soon will be.
        tightest: The pair with the least margin under that definition, or none; another may be nearer and need less.
        definition: Separation definition.
        live: Whether it is the newest instant of a live source.
    """
    numbers = np.column_stack(
        [scene.position_ne_m, scene.velocity_ne_mps, rings(scene, definition), scene.age_s, scene.altitude_m,
         moment.truth_ne_m]
    )  # fmt: skip
    status = NOT_AVOIDING * ~scene.avoiding + STALE * (scene.age_s > STALE_S)
    vehicles = [
        [name, *row, code]
        for name, row, code in zip(scene.names, np.round(numbers, 2).tolist(), status.tolist(), strict=True)
    ]
    who, room = _places_and_room(tightest)
    return encode(
        {
            "t": round(moment.time_s, 3),
            "definition": str(definition),
            "live": live,
            "vehicles": vehicles,
            "pairs": _pair_rows(pairs),
            "tightest": [*who, *room] or None,
            "nearest": room or None,
        }
    )[1:-1]


def _places_and_room(pair: Pairs) -> tuple[list[int], list[float]]:
    """Indices of the two, and distance and radius; empty if there is no pair."""
    return [*pair.first.tolist(), *pair.second.tolist()], np.round([*pair.distance_m, *pair.radius_m], 2).tolist()


def _pair_rows(pairs: Pairs) -> list[list[float | None]]:
    chosen = np.argsort(pairs.distance_m - pairs.radius_m, kind="stable")[:MOST_PAIRS]
    figures = np.round(np.column_stack([pairs.distance_m, pairs.radius_m, pairs.entry_s])[chosen], 2).tolist()
    places = zip(pairs.first[chosen].tolist(), pairs.second[chosen].tolist(), figures, strict=True)
    return [[i, j, *row] for i, j, row in places]


def pushed(body: bytes, selected: bytes, extent_s: tuple[float, float]) -> bytes:
    """The message of a new instant."""
    return b'{"type":"instant",%b,"selected":%b,"t0":%.3f,"t1":%.3f}' % (body, selected, *extent_s)


def answered(body: bytes, selected: bytes, extent_s: tuple[float, float]) -> bytes:
    """An instant in an answer."""
    return b'{%b,"selected":%b,"t0":%.3f,"t1":%.3f}' % (body, selected, *extent_s)


def instants(request: int | str | None, definition: Definition, answers: Iterable[bytes], *, done: bool) -> bytes:
    """The answer to a request for instants, or a part of it."""
    head = encode({"type": "instants", "id": request, "definition": str(definition), "done": done})
    return b'%b,"instants":[%b]}' % (head[:-1], b",".join(answers))


def series(definition: Definition, from_s: float, step_s: float, least: np.ndarray[Any, Any], complete: bool) -> bytes:
    """Distance of the tightest pair, and the distance that it needs.

    Args:
        definition: Separation definition.
        from_s: Time of the first bucket.
        step_s: Length of a bucket.
        least: Distance and radius of the pair with the least margin in each bucket, NaN in empty ones, shape (n, 2).
        complete: Whether the whole requested time is in it.
    """
    rounded = np.round(least.astype(np.float64), 2)
    return encode(
        {
            "type": "series",
            "definition": str(definition),
            "from": round(from_s, 3),
            "step_s": round(step_s, 4),
            "nearest_m": rounded[:, 0].tolist(),
            "required_m": rounded[:, 1].tolist(),
            "complete": complete,
        }
    )


def encounters(definition: Definition, known: Iterable[tuple[int, Encounter]], *, complete: bool = True) -> bytes:
    """The list of encounters with their ids; complete once the history has been read to its end."""
    rows = [
        {
            "id": number,
            "pair": one.pair,
            "opened": _rounded(one.opened_s, 3),
            "closed": None if one.closed_s is None else _rounded(one.closed_s, 3),
            "closest_t": _rounded(one.closest_s, 3),
            "closest_m": _rounded(one.closest_m),
            "margin_m": _rounded(one.margin_m.get(definition, math.nan)),
            "collided": one.collided,
            "moved": one.moved,
        }
        for number, one in known
    ]
    return encode({"type": "encounters", "definition": str(definition), "encounters": rows, "complete": complete})


def health(
    facts: Mapping[str, Any], pages: int, dropped: int, extent_s: tuple[float, float] | None, *, live: bool
) -> bytes:
    """The state of the source and the server, once a second."""
    return encode({"type": "health", **facts, "clients": pages, "dropped": dropped, "live": live, **_extent(extent_s)})


def error(text: str) -> bytes:
    """The error message for a request."""
    return encode({"type": "error", "message": text})


def _extent(extent_s: Sequence[float] | None) -> dict[str, float | None]:
    first, last = (None, None) if extent_s is None else extent_s
    return {"t0": _rounded(first, 3), "t1": _rounded(last, 3)}


def _rounded(value: float | None, digits: int = 2) -> float | None:
    return None if value is None or not math.isfinite(value) else round(value, digits)
