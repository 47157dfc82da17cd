"""Alerts that other definitions would have given for the same traffic: durations, margins, and MACs without an alert.

An alert of a definition begins when a pair is inside its disc, or would enter it within a given time if both flew
straight on. It ends after three seconds without either. A MAC is a pair whose reported airframes touch at the reported
positions. It is unannounced if no alert of the pair had begun earlier. All counts are per pair.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ridlink.avoidance.settings import HalfplaneSettings
from ridlink.observer import Scene, largest_disc, pairs_at
from ridlink.observer.encounters import CLOSES_AFTER_S
from ridlink.observer.scene import BoolArray
from ridlink.review.approach import Approach, nearest_since
from ridlink.separation.chance import DEFAULT_ETA
from ridlink.separation.definitions import Definition, bounded_airframe

AHEAD_S = HalfplaneSettings().horizon_s
"""Default look-ahead [s]: that of the daemon's solver."""

FOLDED_AFTER_S = 30.0
FOLD_EVERY = 100

Pair = tuple[int, int]


@dataclass(slots=True, kw_only=True)
class Tally:
    """Alerts and MACs under one definition, for one pair or for all.

    Attributes:
        alerts: Number of alerts; `alert_s` is their total duration [s].
        entered: Number of alerts in which the disc was entered.
        macs: Number of MACs; `unannounced` counts those without an alert before.
        warning_s: Least time from an alert to its MAC [s], infinite if there was none.
        margin_m: Least difference of distance and disc radius [m], infinite if there were never two aircraft.
        pair, margin_at_s: Pair and time of that margin; seconds since 1970.
    """

    alerts: int = 0
    alert_s: float = 0.0
    entered: int = 0
    macs: int = 0
    unannounced: int = 0
    warning_s: float = math.inf
    margin_m: float = math.inf
    pair: tuple[str, str] = ("", "")
    margin_at_s: float = math.nan

    def add(self, other: Tally) -> None:
        """Add the tally of other pairs."""
        self.alerts += other.alerts
        self.alert_s += other.alert_s
        self.entered += other.entered
        self.macs += other.macs
        self.unannounced += other.unannounced
        self.warning_s = min(self.warning_s, other.warning_s)
        self.note(other.margin_m, other.margin_at_s, other.pair)

    def note(self, margin_m: float, at_s: float, pair: tuple[str, str]) -> None:
        """Take a margin; it is kept if it is less than all before."""
        if margin_m < self.margin_m:
            self.margin_m, self.margin_at_s, self.pair = margin_m, at_s, pair


@dataclass(slots=True, kw_only=True)
class _Ledger(Tally):
    """Tally of one pair that is still in the air."""

    seen_s: float
    begun_s: float = math.nan
    last_s: float = -math.inf
    is_inside: bool = False


@dataclass(slots=True, kw_only=True)
class Judgement(Tally):
    """Alerts and MACs of all pairs under one definition.

    Attributes:
        definition: The definition.
        open: Tallies of pairs that are still in the air.
    """

    definition: Definition
    open: dict[Pair, _Ledger] = field(default_factory=dict)

    def as_dict(self) -> dict[str, Any]:
        """The figures as a JSON object; unknown values are None."""
        has_pair = math.isfinite(self.margin_m)
        return {
            "definition": str(self.definition),
            "alerts": self.alerts,
            "alert_s": round(self.alert_s, 1),
            "entered": self.entered,
            "least_margin_m": round(self.margin_m, 2) if has_pair else None,
            "least_margin_t": round(self.margin_at_s, 3) if has_pair else None,
            "least_margin_uas": list(self.pair) if has_pair else None,
            "macs": self.macs,
            "macs_without_alert": self.unannounced,
            "least_warning_s": round(self.warning_s, 1) if math.isfinite(self.warning_s) else None,
        }

    def fold(self, keys: Iterable[Pair]) -> None:
        """Close pairs, and add their tallies to the total."""
        for key in keys:
            self.add(self.open.pop(key))


class WhatIf:
    """Watches scenes, and evaluates them under several definitions.

    Args:
        definitions: The definitions.
        ahead_s: How far ahead an entry gives an alert.
        eta: Parameter of ``chance`` only.

    Attributes:
        judgements: One for each definition, complete at the end of the recording.
    """

    def __init__(
        self, definitions: Sequence[Definition], *, ahead_s: float = AHEAD_S, eta: float = DEFAULT_ETA
    ) -> None:
        self.judgements = [Judgement(definition=definition) for definition in dict.fromkeys(definitions)]
        self._ahead_s = ahead_s
        self._eta = eta
        self._begin()

    def _begin(self) -> None:
        self._before: Scene | None = None
        self._collided: dict[Pair, float] = {}
        self._steps = 0

    def step(self, scene: Scene) -> None:
        """Take the next scene."""
        before, self._before = self._before, scene
        self._steps += 1
        if self._steps % FOLD_EVERY == 0 or scene.merged:
            self._tidy(scene)
        if len(scene) < 2:
            return
        # What is further apart has no alert, no MAC and no less margin than before.
        largest_m = max(
            1.001 * largest_disc(scene, judgement.definition, eta=self._eta) + max(0.0, judgement.margin_m)
            for judgement in self.judgements
        )
        approach = nearest_since(before, scene, largest_m, ahead_s=self._ahead_s)
        macs = self._new_macs(scene, approach)
        for judgement in self.judgements:
            self._judge(judgement, scene, approach, macs)

    def end(self) -> None:
        """Finish: the recording is over."""
        for judgement in self.judgements:
            judgement.fold(list(judgement.open))
        self._begin()

    def _new_macs(self, scene: Scene, approach: Approach) -> list[int]:
        """Those of the pairs, by their place, that touch now and have not touched for a while."""
        size = bounded_airframe(scene.airframe_m)
        touching = approach.distance_m < (size[approach.first] + size[approach.second]) / 2.0
        new = []
        for at in _places(touching):
            key = _key(scene, approach, at)
            if scene.time_s - self._collided.get(key, -math.inf) > CLOSES_AFTER_S:
                new.append(at)
            self._collided[key] = scene.time_s
        return new

    def _judge(self, judgement: Judgement, scene: Scene, approach: Approach, macs: list[int]) -> None:
        pairs = pairs_at(scene, approach.first, approach.second, judgement.definition, eta=self._eta)
        margin = approach.distance_m - pairs.radius_m
        inside = margin < 0.0
        alerting = inside | (pairs.entry_s <= self._ahead_s)
        for at in macs:
            one = self._ledger(judgement, scene, approach, at)
            at_s = float(approach.time_s[at])
            announced = at_s - one.last_s <= CLOSES_AFTER_S and one.begun_s < at_s
            one.macs += 1
            one.unannounced += not announced
            if announced:
                one.warning_s = min(one.warning_s, at_s - one.begun_s)
        for at in _places(alerting):
            one = self._ledger(judgement, scene, approach, at)
            if scene.time_s - one.last_s > CLOSES_AFTER_S:
                one.alerts, one.begun_s, one.is_inside = one.alerts + 1, scene.time_s, False
            one.last_s = scene.time_s
            one.alert_s += float(approach.lasted_s[at])
            if inside[at] and not one.is_inside:
                one.entered, one.is_inside = one.entered + 1, True
            one.note(float(margin[at]), float(approach.time_s[at]), one.pair)
        others = np.where(alerting, np.inf, margin)
        if len(others):
            at = int(others.argmin())
            judgement.note(float(others[at]), float(approach.time_s[at]), _names(scene, approach, at))

    def _ledger(self, judgement: Judgement, scene: Scene, approach: Approach, at: int) -> _Ledger:
        key, names = _key(scene, approach, at), _names(scene, approach, at)
        one = judgement.open.setdefault(key, _Ledger(pair=names, seen_s=scene.time_s))
        one.pair, one.seen_s = names, scene.time_s
        return one

    def _tidy(self, scene: Scene) -> None:
        """Discard pairs of aircraft that turned out to be another aircraft, and close pairs unseen for long."""
        for judgement in self.judgements:
            for key in [key for key in judgement.open if not scene.merged.isdisjoint(key)]:
                del judgement.open[key]
            judgement.fold([key for key, one in judgement.open.items() if scene.time_s - one.seen_s > FOLDED_AFTER_S])
        self._collided = {
            key: last_s for key, last_s in self._collided.items() if scene.time_s - last_s <= CLOSES_AFTER_S
        }


def _places(which: BoolArray) -> list[int]:
    places: list[int] = np.flatnonzero(which).tolist()
    return places


def _key(scene: Scene, approach: Approach, at: int) -> Pair:
    one, other = scene.numbers[approach.first[at]], scene.numbers[approach.second[at]]
    return (one, other) if one < other else (other, one)


def _names(scene: Scene, approach: Approach, at: int) -> tuple[str, str]:
    return scene.names[approach.first[at]], scene.names[approach.second[at]]
