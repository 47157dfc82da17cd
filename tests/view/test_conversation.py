"""What a page is told next, whatever happens meanwhile."""

from __future__ import annotations

import json
from typing import Any

import pytest

pytest.importorskip("uvicorn", reason="needs ridlink[web]")

from ridlink.separation.definitions import Definition
from ridlink.view.conversation import Conversation
from tests.view.serving import a_show


def test_where_there_is_always_a_newer_instant_everything_else_is_told_nevertheless() -> None:
    show = a_show(live=True)
    book = show.book(show.definition)
    while book.read():
        continue
    conversation, told = Conversation(show), set()
    conversation.take('{"at":1,"series":[0,3],"window":[0,3]}')
    for _ in range(200):
        conversation.step()
        if message := conversation.next():
            told.add(json.loads(message)["type"])
    assert told == {"hello", "instant", "encounters", "series", "instants"}


def test_encounters_say_whether_the_history_was_read_to_its_end_and_come_again_when_it_was() -> None:
    show = a_show()
    conversation = Conversation(show)

    def told() -> dict[str, Any]:
        found = {}
        for _ in range(20):
            if message := conversation.next():
                found[json.loads(message)["type"]] = json.loads(message)
        return found

    conversation.take('{"definition":"snmac","series":[0,3]}')
    first = told()
    assert first["encounters"]["encounters"] == []
    assert not first["encounters"]["complete"] and not first["series"]["complete"]
    book = show.book(Definition.SNMAC)
    while book.read():
        continue
    conversation.take('{"series":[0,3]}')
    second = told()
    assert second["series"]["complete"] and second["encounters"]["complete"], "one with the other, not a second later"
    assert len(second["encounters"]["encounters"]) == 1
