"""Requests of one page, and the next message to it. No socket: requests are text, messages are fetched one at a time.

Nothing queues up. Only the latest instant, encounters and health are kept, and a request replaces an older one of its
kind. A message is written only when the page reads it, so a slow page skips instants and costs nothing.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import msgspec

from ridlink.separation.definitions import Definition
from ridlink.view import wire
from ridlink.view.show import Show

LONGEST_REQUEST = 4096
MOST_INSTANTS = 300
PART_BYTES = 64 * 1024
MOST_MISTAKES = 10
"""Wrong requests in a row, after which the connection ends."""

Window = tuple[float, float]


class Request(msgspec.Struct, forbid_unknown_fields=True):
    """Keys of a request; a page may send several at once."""

    definition: Definition | msgspec.UnsetType = msgspec.UNSET
    select: str | msgspec.UnsetType | None = msgspec.UNSET
    follow: bool | msgspec.UnsetType = msgspec.UNSET
    at: float | msgspec.UnsetType = msgspec.UNSET
    window: Window | msgspec.UnsetType = msgspec.UNSET
    step: float | None = None
    series: Window | msgspec.UnsetType = msgspec.UNSET
    id: int | str | None = None


_decode = msgspec.json.Decoder(Request).decode


class Conversation:
    """One page.

    Args:
        show: The show that it displays.

    Attributes:
        definition: Definition of the discs that it displays.
        selected: The selected vehicle.
        following: Whether it gets new instants.
        hopeless: Whether it has sent too many wrong requests in a row.
    """

    def __init__(self, show: Show) -> None:
        self.definition = show.definition
        self.selected: str | None = None
        self.following = True
        self.hopeless = False
        self._show = show
        self._mistakes = 0
        self._waiting: dict[str, bytes] = {}
        self._answers: dict[str, Iterator[bytes]] = {}
        self._instant_due = self._others_turn = False
        self._encounters_due = True
        self._told: tuple[int, bool] | None = None
        self._greeted = -1

    def take(self, text: str | bytes) -> None:
        """Receive a request; an error in it is reported to the page."""
        try:
            if len(text) > LONGEST_REQUEST:
                raise ValueError(f"a request has at most {LONGEST_REQUEST} characters")
            self._take(_decode(text))
            self._mistakes = 0
        except (ValueError, RecursionError) as error:  # msgspec's own errors are ValueErrors, too
            self._mistakes += 1
            self.hopeless = self._mistakes >= MOST_MISTAKES
            self._waiting["error"] = wire.error(f"request not understood: {error}"[:300])

    def _take(self, request: Request) -> None:
        if not any(
            getattr(request, name) is not msgspec.UNSET
            for name in request.__struct_fields__
            if name not in ("id", "step")
        ):
            raise ValueError("asks for nothing")
        if isinstance(request.id, str) and len(request.id) > 64:
            raise ValueError("an id has at most 64 characters")
        if not isinstance(request.definition, msgspec.UnsetType):
            self.definition = request.definition
            self._encounters_due = self._instant_due = True
            self._told = None
        if not isinstance(request.select, msgspec.UnsetType):
            self.selected = request.select
            self._instant_due = True
        if not isinstance(request.follow, msgspec.UnsetType):
            self.following = self._instant_due = request.follow
        if not isinstance(request.at, msgspec.UnsetType):
            self._answers["at"] = self._at(request.at, request.id)
        if not isinstance(request.window, msgspec.UnsetType):
            self._answers["window"] = self._window(request.window, request.step or 0.0, request.id)
        if not isinstance(request.series, msgspec.UnsetType):
            self._answers["series"] = self._series(request.series)

    def step(self) -> None:
        """Note a new instant."""
        self._instant_due = self._instant_due or self.following

    def second(self, health: bytes) -> None:
        """Note that a second has passed."""
        self._encounters_due = True
        self._waiting["health"] = health

    def next(self) -> bytes | None:
        """The next message; empty if work was done but there is no message yet, None if there is nothing to do."""
        show = self._show
        if self._greeted != show.greetings:
            if self._greeted >= 0:  # requests about another source
                self._answers.clear()
            self._greeted = show.greetings
            self._told = None
            self._instant_due = self._encounters_due = True
            return show.hello()
        if self._waiting:
            return self._waiting.pop(next(iter(self._waiting)))
        if self._instant_due and not self._others_turn:
            return self._instant()
        self._others_turn = False
        if self._encounters_due:
            self._encounters_due = False
            book = show.book(self.definition)
            state = book.changes, book.caught_up
            if state != self._told:
                self._told = state
                return wire.encounters(self.definition, book.encounters(), complete=book.caught_up)
            return b""
        for kind in ("at", "series", "window"):
            if kind in self._answers:
                part = next(self._answers[kind], None)
                if part is not None:
                    return part
                del self._answers[kind]
                return b""
        return self._instant() if self._instant_due else None

    def _instant(self) -> bytes:
        """The newest instant; other messages that are due come next, however fast instants follow each other."""
        self._instant_due, self._others_turn = False, True
        return self._show.latest(self.definition, self.selected) or b""

    def _at(self, time_s: float, request: int | str | None) -> Iterator[bytes]:
        number = self._show.history.find(time_s)
        found = [] if number is None else [self._show.answer(number, self.definition, self.selected)]
        yield wire.instants(request, self.definition, found, done=True)

    def _window(self, window: Window, step_s: float, request: int | str | None) -> Iterator[bytes]:
        show, definition = self._show, self.definition
        from_s, to_s = min(window), max(window)
        first, last = show.history.find(from_s), show.history.find(to_s)
        numbers = self._chosen(first, last, step_s) if first is not None and last is not None else []
        parts: list[bytes] = []
        for number in numbers:
            if number < show.history.first:  # forgotten in the meantime
                continue
            part = show.answer(number, definition, self.selected)
            if parts and sum(map(len, parts)) + len(part) > PART_BYTES:
                yield wire.instants(request, definition, parts, done=False)
                parts = []
            parts.append(part)
            yield b""
        yield wire.instants(request, definition, parts, done=True)

    def _chosen(self, first: int, last: int, step_s: float) -> list[int]:
        """Numbers of instants at least this far apart, up to the limit."""
        history = self._show.history
        if last > first and step_s > 0.0:
            lasts_s = history.at(last).time_s - history.at(first).time_s
            step_s = max(step_s, lasts_s / MOST_INSTANTS)
            count = max(1, round(lasts_s / step_s))
            begin_s = history.at(first).time_s
            found = [history.find(begin_s + place * step_s + 1e-3) for place in range(count + 1)]
            return sorted({number for number in found if number is not None and number <= last} | {last})[
                -MOST_INSTANTS:
            ]
        return _thinned(range(first, last + 1))

    def _series(self, window: Window) -> Iterator[bytes]:
        book = self._show.book(self.definition)
        self._encounters_due = True  # both messages are about the same time
        yield wire.series(self.definition, *book.series(min(window), max(window)))


def _thinned(numbers: range) -> list[int]:
    """At most MOST_INSTANTS of them, including the first and the last."""
    every = max(1.0, (len(numbers) - 1) / (MOST_INSTANTS - 1))
    count = math.floor((len(numbers) - 1) / every + 1e-6) + 1
    return [numbers[round(place * every)] for place in range(count)]
