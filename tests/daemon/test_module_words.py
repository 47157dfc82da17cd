"""What a transmitter module says is told when it is new, whatever else comes on its link."""

from __future__ import annotations

from collections import Counter
from typing import Any

from ridlink.daemon.events import Events
from ridlink.daemon.module_words import ModuleWords
from ridlink.mavlink.codec import Encoder

MODULE = ("127.0.0.1", 14560)


def test_each_answer_is_counted_and_the_last_one_told_if_it_is_new() -> None:
    told: list[dict[str, Any]] = []
    words, module = ModuleWords(Events(told.append, Counter())), Encoder(1, 236)

    def say(*answers: tuple[int, bytes]) -> list[tuple[bool, str]]:
        told.clear()
        for status, error in answers:
            answer = module.encode("OPEN_DRONE_ID_ARM_STATUS", status=status, error=error)
            damaged = answer[:-1] + bytes([answer[-1] ^ 1])
            words.receive(b"junk" + module.encode("HEARTBEAT") + answer + damaged, MODULE)
        words.tell()
        return [(event["good_to_arm"], event["text"]) for event in told]

    assert say() == []
    assert say((1, b"missing LOC"), (1, b"missing \x1bLOC")) == [(False, "missing \\x1bLOC")]
    assert say((1, b"missing \x1bLOC")) == []
    assert say((0, b""), (1, b"missing \x1bLOC")) == []
    assert say((7, b"")) == [(False, "")], "a status that is not known is none to fly with"
    assert say((0, b"")) == [(True, "")]
    assert say() == []
    assert words.counters == {"module_not_ready": 5}
