"""One source, and the answers to all requests about it: no clock, no socket.

Results for one page are kept for the others: the scene, the pairs, the text of an instant under a definition, the
velocity space of a vehicle. A server of many pages calls these methods one at a time, with other work in between.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable, Mapping
from dataclasses import replace
from typing import Any, TypeVar

from ridlink.geodesy import Geodetic
from ridlink.observer import Pairs, Scene, least_margin, pairs_of
from ridlink.separation.definitions import Definition
from ridlink.view import wire
from ridlink.view.book import Book
from ridlink.view.instants import MEMORY_BYTES, History, Instant, instant_of
from ridlink.view.scenery import Pair, Scenery
from ridlink.view.velocity_space import NOTHING, VelocitySpace

KEPT_BYTES = 4 * 2**20
"""Bytes of cached texts, which may be requested again."""

Value = TypeVar("Value")


class Show:
    """The data of the page: a source, its history, and cached results.

    Args:
        scenery: The source.
        definition: Definition of the discs until a page requests another one.
        memory_bytes: Memory limit of the history.
        history: Existing instants.

    Attributes:
        scenery: The source, as far as known.
        history: The instants.
        greetings: Counter of changes after which pages need a new `hello`.
    """

    def __init__(
        self,
        scenery: Scenery,
        definition: Definition = Definition.CANDIDATE2,
        *,
        memory_bytes: int = MEMORY_BYTES,
        history: History | None = None,
    ) -> None:
        self.definition = definition
        self.greetings = 0
        self._memory_bytes = memory_bytes
        self._space: VelocitySpace | None = None
        self._begin(scenery, history)

    def restart(self, scenery: Scenery) -> None:
        """Begin another source; the previous one is forgotten."""
        self.greetings += 1
        self._begin(scenery, None)

    def _begin(self, scenery: Scenery, history: History | None) -> None:
        self.scenery = scenery
        self.history = history if history is not None else History(self._memory_bytes)
        self._books: dict[Definition, Book] = {}
        self._counted = 0, 0
        self._seen: tuple[int, dict[Hashable, Any]] = -1, {}
        self._texts: OrderedDict[tuple[Hashable, ...], bytes] = OrderedDict()
        self._texts_bytes = 0

    def finish(self) -> None:
        """The source has ended; its history is a recording now."""
        self.scenery = replace(self.scenery, live=False)
        for book in self._books.values():
            while book.read():
                continue
            book.end()

    def look_at_vehicles(self) -> None:
        """Compute velocity spaces from now on; the kernels of the solver must have been loaded."""
        self._space = VelocitySpace()

    def locate(self, origin: Geodetic) -> None:
        """Set the origin, which has become known."""
        self.greetings += 1
        self.scenery = replace(self.scenery, origin=origin)

    def add(self, scene: Scene, truth: Mapping[str, Pair] | None = None) -> None:
        """Add the next instant."""
        history = self.history
        before = history.at(history.end - 1) if len(history) else None
        if len(scene) or (before is not None and len(before)):
            history.add(instant_of(scene, truth, before))

    def hello(self) -> bytes:
        """The first message to a page."""
        return wire.hello(self.scenery, self.definition, self.history.extent_s)

    @property
    def vehicles(self) -> int:
        """Number of vehicles in the history, by their last names."""
        at, known = self._counted
        if at != self.history.end:
            unlike = {(id(one.numbers), id(one.names), id(one.merged)): one for one in self.history}.values()
            names = {number: name for one in unlike for number, name in zip(one.numbers, one.names, strict=True)}
            known = len({names[number] for number in names.keys() - set().union(*(one.merged for one in unlike))})
            self._counted = self.history.end, known
        return known

    def book(self, definition: Definition) -> Book:
        """The history under a definition; the caller must let it read."""
        if definition not in self._books:
            self._books[definition] = Book(
                definition,
                self.history,
                lambda moment: (
                    self._scene(moment),
                    self._pairs(moment, definition),
                    self._tightest(moment, definition),
                ),
            )
        return self._books[definition]

    def latest(self, definition: Definition, selected: str | None) -> bytes | None:
        """The newest instant as a message; None if there is none."""
        extent = self.history.extent_s
        if extent is None:
            return None
        number = self.history.end - 1
        body, space = self._body(number, definition), self._selected(number, definition, selected)
        return wire.pushed(body, space, extent)

    def answer(self, number: int, definition: Definition, selected: str | None) -> bytes:
        """An instant of the history as part of an answer.

        Raises:
            IndexError: If it is not kept.
        """
        extent = self.history.extent_s or (0.0, 0.0)
        body, space = self._body(number, definition), self._selected(number, definition, selected)
        return wire.answered(body, space, extent)

    def _body(self, number: int, definition: Definition) -> bytes:
        live = self.scenery.live and number == self.history.end - 1
        moment = self.history.at(number)

        def text() -> bytes:
            pairs, tightest = self._pairs(moment, definition), self._tightest(moment, definition)
            return wire.instant(moment, self._scene(moment), pairs, tightest, definition, live=live)

        return self._text((number, definition, live), text)

    def _selected(self, number: int, definition: Definition, name: str | None) -> bytes:
        space = self._space
        moment = self.history.at(number)
        if name is None or space is None or name not in moment.names:
            return NOTHING

        def text() -> bytes:
            return space.of(name, self._scene(moment), definition, self.scenery)

        return self._text((number, definition, "space", name), text)

    def _scene(self, moment: Instant) -> Scene:
        return self._once(moment, "scene", moment.scene)

    def _pairs(self, moment: Instant, definition: Definition) -> Pairs:
        return self._once(moment, ("pairs", definition), lambda: pairs_of(self._scene(moment), definition))

    def _tightest(self, moment: Instant, definition: Definition) -> Pairs:
        return self._once(moment, ("tightest", definition), lambda: least_margin(self._scene(moment), definition))

    def _once(self, moment: Instant, what: Hashable, work_out: Callable[[], Value]) -> Value:
        """Compute once, and keep the result while the same instant is used."""
        if self._seen[0] != id(moment):
            self._seen = id(moment), {"moment": moment}
        kept = self._seen[1]
        if what not in kept:
            kept[what] = work_out()
        value: Value = kept[what]
        return value

    def _text(self, key: tuple[Hashable, ...], write: Callable[[], bytes]) -> bytes:
        text = self._texts.get(key)
        if text is None:
            self._texts[key] = text = write()
            self._texts_bytes += len(text)
            while self._texts_bytes > KEPT_BYTES:
                self._texts_bytes -= len(self._texts.popitem(last=False)[1])
        return text
