"""Names from the air make no levels, wildcards or control characters; wrong brokers are refused with a right one."""

from __future__ import annotations

import re

import aiomqtt
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from ridlink.errors import ConfigError
from ridlink.mqtt import BrokerUrl, Topics, parse_broker_url
from ridlink.mqtt.topics import object_id

TOPICS = Topics("field-1")


@given(st.text(max_size=200))
def test_f32_no_name_leaves_its_level(name: str) -> None:
    for topic in (TOPICS.state(name), TOPICS.aircraft_availability(name), TOPICS.encounter((name, name))):
        assert topic.count("/") == TOPICS.root.count("/") + (3 if "/uas/" in topic else 2)
        assert topic.isascii() and topic.isprintable()
        assert not set(topic) & set("+#\0 ")
        assert len(topic) < 65536


def test_topics_are_those_of_the_documentation() -> None:
    assert TOPICS.state("1/1") == "ridlink/v1/field-1/uas/1%2F1/state"
    assert TOPICS.encounter(("A~B", "C")) == "ridlink/v1/field-1/encounter/A%7EB~C"
    assert TOPICS.availability == "ridlink/v1/field-1/availability"


@given(st.lists(st.sampled_from(["ridlink", "v1", "field-1", "uas", "x", "state", "+"]), max_size=6), st.booleans())
@example(["ridlink", "v1", "field-1", "uas", "ALPHA", "state"], False)
def test_a_filter_hears_us_if_it_matches_any_topic_below_our_root(levels: list[str], everything: bool) -> None:
    asked = "/".join([*levels, "#"] if everything or not levels else levels)
    below = [TOPICS.root + "".join(f"/{level.replace('+', 'y')}" for level in levels[3:]) + end for end in ("", "/z")]
    matched = any(aiomqtt.Topic(one).matches(asked) for one in below if one != TOPICS.root)
    assert TOPICS.are_heard_by(asked) == matched


@pytest.mark.parametrize("site", ["", "a/+/b", "#", "/a", "a\n", 70_000 * "a"])
def test_a_site_that_is_no_name_is_refused(site: str) -> None:
    with pytest.raises(ConfigError, match="site"):
        Topics(site)


@pytest.mark.parametrize(
    ("text", "broker"),
    [
        ("mqtt://127.0.0.1", BrokerUrl("127.0.0.1", 1883, False)),
        ("mqtts://me@broker.example:8884", BrokerUrl("broker.example", 8884, True, "me")),
        ("mqtt://[::1]:1884", BrokerUrl("::1", 1884, False)),
        ("mqtt://hub%3Ame%40site@broker", BrokerUrl("broker", 1883, False, "hub:me@site")),
    ],
)
def test_a_broker_is_read(text: str, broker: BrokerUrl) -> None:
    assert parse_broker_url(text) == broker


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("127.0.0.1:1883", "no scheme"),
        ("http://127.0.0.1", "is no scheme"),
        ("mqtt://", "no host"),
        ("mqtt://127.0.0.1:99999", "write mqtt://"),
        ("mqtt://[::1", "no host"),
        ("mqtt://me:secret@[::1", "no host"),
        ("mqtt://127.0.0.1:0", "no number from 1 to 65535"),
        ("mqtt://me:secret/@127.0.0.1", "no number from 1 to 65535"),
        ("mqtt://me:secret@127.0.0.1", "password-file"),
        ("mqtt://127.0.0.1/topic", "nothing may follow"),
    ],
)
def test_a_wrong_broker_is_refused_and_no_secret_is_repeated(text: str, says: str) -> None:
    with pytest.raises(ConfigError, match=says) as caught:
        parse_broker_url(text)
    assert "secret" not in str(caught.value)


@given(st.lists(st.text(max_size=30), min_size=2, max_size=2, unique=True))
@example(["A-1", "A_1"])
@example(["A_2D1", "A-1"])
@example(["a~b", "a_7Eb"])
def test_no_two_names_are_one_object_to_home_assistant(names: list[str]) -> None:
    one, other = map(object_id, names)
    assert one != other
    assert re.fullmatch(r"[A-Za-z0-9_-]*", one)
