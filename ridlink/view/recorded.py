"""Recordings as a history: walked once from their beginning to their end, on the grid that a live source has."""

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
"""Instants between two words about progress."""

BETWEEN_S = 1.0
"""Between two recordings of which the second one was begun earlier, by its own clock."""


class _Filling:
    """Puts the scenes of a walk into a history, times counted from the first."""

    def __init__(self, history: History, told: Callable[[float], None]) -> None:
        self.begin_s: float | None = None
        self._history = history
        self._told = told
        self._shift_s = 0.0
        self._last_s = 0.0
        self._seen = 0

    def step(self, scene: Scene) -> None:
        """A scene; where the history has become coarser, those between are left out."""
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
        """A recording is over; the next one goes on where it was."""


def read_history(
    paths: Sequence[str],
    kind: str = "auto",
    *,
    memory_bytes: int = MEMORY_BYTES,
    convention: AccuracyConvention | str = DEFAULT_CONVENTION,
    on_progress: Callable[[float, float], None] = lambda share, time_s: None,
) -> tuple[Scenery, History, list[Source]]:
    """Everything that recordings tell about who was in the air, and how reading them went.

    Args:
        paths: Files of one flight, or ``-`` for standard input.
        kind: As `open_capture` takes it.
        memory_bytes: Of the history; recordings that need more are kept in coarser steps.
        convention: What senders are taken to mean by their accuracy codes.
        on_progress: Called now and then with the share of the files that has been read, and how far they have come [s].

    Raises:
        CaptureError: If one is no capture that is read, has no times, or nobody tells a position.
        OSError: If one cannot be read.
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
        raise CaptureError(f"{title}: nobody in it tells a position by Remote ID")
    return Scenery(title, "file", live=False, utc0_s=filling.begin_s, origin=walk.sky.origin), history, sources
