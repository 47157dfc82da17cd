"""What a page is told next, whatever happens meanwhile."""

from __future__ import annotations

import json

import pytest

pytest.importorskip("uvicorn", reason="needs ridlink[web]")

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
