"""Events of the daemon's steps: a change of state at once, a summary every second, a warning when it occurs."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence

from ridlink.daemon.events import Events, rounded, summary_facts
from ridlink.daemon.far_away import FarAway
from ridlink.daemon.module_words import ModuleWords
from ridlink.engine import Engine, StepOutput
from ridlink.periodic import Periodic

MOST_STACKS = 4
"""Stacks kept of stalls that are not reported yet; the latest ones."""


class Telling:
    """Called after every step to report what is new.

    Args:
        engine: The engine that decides.
        events: Receives the reports.
        module: What a transmitter module says.
        rejects: Everything that was dropped, clamped, rejected or noticed so far, by cause; called once a second.
    """

    def __init__(
        self, engine: Engine, events: Events, module: ModuleWords, rejects: Callable[[], dict[str, int]]
    ) -> None:
        self._engine, self._events, self._module, self._rejects = engine, events, module, rejects
        self._announced: tuple[str, str, str | None] | None = None
        self._recording_ended = False
        self._told_of_signatures = False
        self._told_of_unheard = ""
        self._far_away = FarAway(engine)
        self._stalls: deque[str] = deque(maxlen=MOST_STACKS)
        self._summary_due = Periodic(1.0)

    def stalled(self, stack: str) -> None:
        """Note the stack of a stall; may be called from any thread."""
        self._stalls.append(stack)

    def tell_state(self) -> None:
        """Report the state and its reason, if the state has changed."""
        rung, guard = self._engine.rung, self._engine.guard
        told = rung.state.name.lower(), rung.reason, None if guard is None else str(guard.phase)
        if told != self._announced:
            self._announced = told
            self._events.emit("state", state=told[0], reason=told[1], guard=told[2])

    def tell(self, output: StepOutput, *, recording_error: OSError | None, refused_signatures: Sequence[str]) -> None:
        """Report what is new.

        Args:
            output: Output of the step.
            recording_error: The error that ended the recording early; None while it continues.
            refused_signatures: Causes for which frames of the vehicle link were refused so far.
        """
        if self._events.sink is None:
            return
        record, engine, emit = output.decision, self._engine, self._events.emit
        self.tell_state()
        if recording_error is not None and not self._recording_ended:
            self._recording_ended = True
            emit("recording_ended", reason=_words(recording_error))
        for text in output.warnings:
            emit("warning", text=text)
        if said := engine.telemetry.words.take(record.time_s):
            emit("warning", text=f"vehicle: {said}")
        if refused_signatures and not self._told_of_signatures:  # otherwise a wrong key looks like silence
            self._told_of_signatures = True
            emit("warning", text=f"frames on the vehicle link are refused: {', '.join(refused_signatures)}")
        while self._stalls:
            emit("stalled", stack=self._stalls.popleft())
        if not self._summary_due.due(record.time_s):
            return
        self._module.tell(record.time_s)
        if (why := engine.unheard.why()) and why != self._told_of_unheard:
            self._told_of_unheard = why
            emit("warning", text=why)
        for text in () if record.own is None else self._far_away.found(record.own.position):
            emit("warning", text=text)
        emit("summary", **summary_facts(engine, record, self._rejects()))
        if engine.config.dry_run and record.commanded_ned_mps is not None:
            emit("dry_run", velocity_ned_mps=rounded(record.commanded_ned_mps))


def _words(error: OSError) -> str:
    return f"{error.filename}: {error.strerror}" if error.filename else str(error)
