"""Recordings as a history: read once from beginning to end, on the time grid of a live source."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import replace

from ridlink.errors import CaptureError
from ridlink.observer import Scene
from ridlink.remote_id.accuracy import DEFAULT_CONVENTION, AccuracyConvention
from ridlink.remote_id.text import display_name
from ridlink.review.source import Source, together
from ridlink.review.walk import Walk
from ridlink.view.instants import MEMORY_BYTES, History, instant_of
from ridlink.view.scenery import Scenery

TOLD_EVERY = 1024
"""Instants between two reports of progress."""

BETWEEN_S = 1.0
"""Time between two recordings if the second one began earlier, by its own clock."""


class _Filling:
    """Puts the scenes of a walk into a history, with times from the first one."""

    def __init__(self, history: History, told: Callable[[float], None]) -> None:
        self.begin_s: float | None = None
        self._history = history
        self._told = told
        self._shift_s = 0.0
        self._last_s = 0.0
        self._seen = 0

    def step(self, scene: Scene) -> None:
        """Add a scene; if the history has become coarser, scenes in between are left out."""
        if self.begin_s is None:
            self.begin_s = self._shift_s = scene.time_s
        if scene.time_s - self._shift_s < self._last_s:
            self._shift_s = scene.time_s - self._last_s - BETWEEN_S
        self._last_s = scene.time_s - self._shift_s
        history, self._seen = self._history, self._seen + 1
        if (self._seen - 1) % 2**history.thinned == 0:
            before = history.at(history.end - 1) if len(history) else None
            history.add(instant_of(replace(scene, time_s=self._last_s), None, before))
        if self._seen % TOLD_EVERY == 0:
            self._told(self._last_s)

    def end(self) -> None:
        """A recording is over; the times of the next one continue."""


def read_history(
    paths: Sequence[str],
    kind: str = "auto",
    *,
    memory_bytes: int = MEMORY_BYTES,
    convention: AccuracyConvention | str = DEFAULT_CONVENTION,
    on_progress: Callable[[float, float], None] = lambda share, time_s: None,
) -> tuple[Scenery, History, list[Source]]:
    """Read recordings; returns the history of the traffic, and the result of reading.

    Args:
        paths: Files of one flight, or ``-`` for standard input.
        kind: As `open_capture` takes it.
        memory_bytes: Memory limit of the history; longer recordings are kept in coarser steps.
        convention: How accuracy codes are read.
        on_progress: Called now and then with the share of the files that has been read, and the time reached [s].

    Raises:
        CaptureError: If a file is not a supported capture or has no times, or there are no positions.
        OSError: If a file cannot be read.
    """
    sources = [Source(path, kind) for path in paths]

    def told(time_s: float) -> None:
        size = sum(source.size or 0 for source in sources)
        if size:
            on_progress(sum(source.position for source in sources) / size, time_s)

    history = History(memory_bytes, keeps_all=True)
    filling = _Filling(history, told)
    walk = Walk([filling], convention=convention)
    walk.through(together(sources))
    for source in sources:
        if source.error is not None and not len(history):
            raise source.error
    title = ", ".join(
        display_name(os.path.basename(source.name)) + (" (in part)" if source.error is not None else "")
        for source in sources
    )
    if not len(history):
        raise CaptureError(f"{title}: nobody in it tells a position, by Remote ID or by telemetry")
    return Scenery(title, "file", live=False, utc0_s=filling.begin_s, origin=walk.sky.origin), history, sources
