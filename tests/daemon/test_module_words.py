"""What a transmitter module says is told when it is new, whatever else comes on its link."""

from __future__ import annotations

from collections import Counter
from typing import Any

from ridlink.daemon.events import Events
from ridlink.daemon.module_words import ModuleWords
from ridlink.mavlink.codec import Encoder

NOW_S = 1000.0


def test_each_answer_is_counted_and_the_last_one_told_if_it_is_new() -> None:
    told: list[dict[str, Any]] = []
    words, module = ModuleWords(Events(told.append, Counter())), Encoder(1, 236)

    def say(*answers: tuple[int, bytes]) -> list[tuple[bool, str]]:
        told.clear()
        for status, error in answers:
            answer = module.encode("OPEN_DRONE_ID_ARM_STATUS", status=status, error=error)
            damaged = answer[:-1] + bytes([answer[-1] ^ 1])
            words.receive(b"junk" + module.encode("HEARTBEAT") + answer + damaged, NOW_S)
        words.tell(NOW_S)
        return [(event["good_to_arm"], event["text"]) for event in told]

    assert say() == []
    assert say((1, b"missing LOC"), (1, b"missing \x1bLOC")) == [(False, "missing \\x1bLOC")]
    assert say((1, b"missing \x1bLOC")) == []
    assert say((0, b""), (1, b"missing \x1bLOC")) == []
    assert say((7, b"")) == [(False, "")], "a status that is not known is none to fly with"
    assert say((0, b"")) == [(True, "")]
    assert say() == []
    assert words.counters == {"module_not_ready": 5}


def test_one_that_has_answered_and_falls_silent_is_told_of_once_and_when_it_answers_again() -> None:
    """It may have lost its supply: nobody hears this vehicle then."""
    told: list[dict[str, Any]] = []
    words, module = ModuleWords(Events(told.append, Counter())), Encoder(1, 236)

    def at(time_s: float, status: int | None = None) -> list[tuple[bool, str]]:
        told.clear()
        if status is not None:
            words.receive(module.encode("OPEN_DRONE_ID_ARM_STATUS", status=status), time_s)
        words.tell(time_s)
        return [(event["good_to_arm"], event["text"]) for event in told]

    assert at(0.0) == at(9.0) == [], "one that never answers, as many do, is not missed"
    assert at(10.0, 0) == [(True, "")]
    assert at(13.0) == []
    assert at(13.1) == [(False, "nothing heard from it for 3 s")]
    assert at(14.0) == []
    words.receive(module.encode("HEARTBEAT"), 15.0)
    assert at(15.0) == [], "a router in between may still be there"
    assert at(16.0, 0) == [(True, "")], "the same answer as before is new now"
    assert at(16.5, 1) == [(False, "")]
    assert words.counters == {"module_not_ready": 1}
