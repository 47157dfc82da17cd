"""What waits for a broker is bounded and new."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ridlink.mqtt.outbox import Outbox, Outgoing

topics = st.sampled_from(["a", "b", "c", "d", "e"])


def drained(outbox: Outbox) -> list[Outgoing]:
    return list(iter(outbox.take, None))


@given(st.lists(topics, max_size=60), st.integers(1, 4))
def test_f30_the_newest_of_each_topic_waits_and_never_more_than_there_is_room_for(put: list[str], room: int) -> None:
    outbox = Outbox(room)
    newest: dict[str, bytes] = {}
    for number, topic in enumerate(put):
        newest[topic] = b"%d" % number
        outbox.put(Outgoing(topic, newest[topic]))
        assert len(outbox) <= room
    left = drained(outbox)
    assert len({message.topic for message in left}) == len(left)
    assert all(message.payload == newest[message.topic] for message in left)
    assert len(left) + outbox.replaced + outbox.dropped == len(put)
    assert len(left) == min(room, len(newest))


@pytest.mark.parametrize("qos", [0, 1])
def test_f30_where_there_is_no_room_the_oldest_gives_way(qos: int) -> None:
    outbox = Outbox(3)
    for topic in ("a", "b", "c", "d", "e"):
        outbox.put(Outgoing(topic, b"", qos))
    assert [message.topic for message in drained(outbox)] == ["c", "d", "e"] and outbox.dropped == 2


def test_alerts_about_different_pairs_do_not_replace_each_other() -> None:
    outbox = Outbox()
    outbox.put(Outgoing("alert", b"1", about="a~b"))
    outbox.put(Outgoing("alert", b"2", about="c~d"))
    assert [message.payload for message in drained(outbox)] == [b"1", b"2"]


def test_what_could_not_be_sent_goes_first_unless_there_is_something_newer() -> None:
    outbox = Outbox()
    outbox.put(Outgoing("a", b"1"))
    outbox.put(Outgoing("b", b"2"))
    taken = outbox.take()
    assert taken is not None
    outbox.put_back(taken)
    assert [message.payload for message in drained(outbox)] == [b"1", b"2"]
    outbox.put(Outgoing("a", b"3"))
    outbox.put_back(taken)
    assert [message.payload for message in drained(outbox)] == [b"3"]


def test_what_could_not_be_sent_and_has_no_room_any_more_is_dropped_not_overtaken() -> None:
    outbox = Outbox(1)
    outbox.put(Outgoing("a", b"1"))
    taken = outbox.take()
    assert taken is not None
    outbox.put(Outgoing("b", b"2"))
    outbox.put_back(taken)
    assert (outbox.replaced, outbox.dropped) == (0, 1)


def test_what_the_broker_retains_and_could_not_be_sent_finds_room_though_others_have_filled_it() -> None:
    outbox = Outbox(3)
    gone = Outgoing("uas/a/availability", b"offline", 1, True)
    outbox.put(gone)
    assert outbox.take() == gone
    for number in range(3):
        outbox.put(Outgoing(f"uas/{number}/state", b""))
    outbox.put_back(gone)
    assert sorted(message.topic for message in drained(outbox)) == ["uas/1/state", "uas/2/state", gone.topic]
    assert outbox.dropped == 1


def test_what_the_broker_retains_is_not_given_up_for_what_is_worth_nothing_later() -> None:
    outbox = Outbox(10)
    gone = Outgoing("uas/a/availability", b"offline", 1, True)
    outbox.put(gone)
    for number in range(1000):  # while the broker is away
        outbox.put(Outgoing(f"encounter {number}", b"", 1))
    assert gone in drained(outbox)


def test_no_room_at_all_is_refused() -> None:
    with pytest.raises(ValueError, match="at least 1"):
        Outbox(0)


@given(st.integers(1, 40), st.integers(1, 40), st.integers(1, 5))
def test_no_topic_goes_unheard_however_fast_the_others_are_renewed(states: int, meetings: int, at_once: int) -> None:
    outbox = Outbox(100)
    told: set[str] = set()
    for _ in range(2 * max(states, meetings)):  # a broker too slow for all of them, a tick after the other
        for number in range(meetings):
            outbox.put(Outgoing(f"meeting {number}", b"", 1))
        for number in range(states):
            outbox.put(Outgoing(f"state {number}", b""))
        told.update(message.topic for _ in range(at_once) if (message := outbox.take()) is not None)
    assert len(told) == states + meetings


def test_too_much_of_one_kind_pushes_out_none_of_the_other() -> None:
    outbox = Outbox(10)
    outbox.put(Outgoing("state", b""))
    for number in range(1000):
        outbox.put(Outgoing(f"meeting {number}", b"", 1))
    assert "state" in {message.topic for message in drained(outbox)} and outbox.dropped == 991
