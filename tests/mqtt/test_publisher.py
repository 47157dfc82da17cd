"""What is published of what is heard."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ridlink.errors import ConfigError
from ridlink.mqtt import Publisher, PublisherSettings, Topics
from ridlink.mqtt.outbox import Outgoing
from tests.observer.flights import Flyer, frames

TOPICS = Topics("here")
ONE = Flyer(1, (-100.0, 0.0), (10.0, 0.0), b"ALPHA")
TWO = Flyer(2, (100.0, 5.0), (-10.0, 0.0), b"BRA/VO#")
UTC_S = 1_700_000_000.0


def published(flyers: list[Flyer], until_s: float, **options: Any) -> list[Outgoing]:
    publisher = Publisher(PublisherSettings(TOPICS, **options), "9.9")
    out: list[Outgoing] = []
    heard = list(frames(flyers, until_s))
    for step in range(round(until_s * 10)):
        now_s = round(0.1 * step, 6)
        for time_s, frame in heard:
            if time_s == now_s:
                publisher.receive(frame, now_s)
        out += publisher.step(now_s, UTC_S + now_s)
    return out


def of(messages: list[Outgoing], topic: str) -> list[Any]:
    return [json.loads(message.payload) for message in messages if message.topic == topic]


def test_states_have_the_names_of_the_decoder_and_no_nan() -> None:
    states = of(published([ONE, TWO], 3.0), TOPICS.state("ALPHA"))
    assert len(states) == 3, "one a second"
    last = states[-1]
    assert last["uas"] == "ALPHA" and last["source"] == "1/1"
    assert last["t"] == pytest.approx(UTC_S + 2.0, abs=0.15)
    assert last["direction_deg"] == 0.0 and last["speed_horizontal_mps"] == 10.0
    assert last["horizontal_error_m"] == 10.5 and last["altitude_barometric_m"] is None
    assert last["disc_radius_m"] == pytest.approx(0.3 + 10.5 + 1.0, abs=0.1)
    assert last["nearest"]["uas"] == "BRA/VO#"
    assert last["nearest"]["distance_m"] == pytest.approx(160.0, abs=3.0)


@settings(max_examples=20)
@given(rate=st.sampled_from([1.0, 3.0, 10.0]), late=st.lists(st.floats(0.0, 0.03), min_size=100, max_size=100))
def test_the_rate_is_kept_on_a_machine_whose_steps_are_a_little_late(rate: float, late: list[float]) -> None:
    publisher = Publisher(PublisherSettings(TOPICS, rate_hz=rate))
    for _, frame in frames([ONE], 0.1):
        publisher.receive(frame, 0.0)
    steps = [publisher.step(0.1 * number + delay, UTC_S) for number, delay in enumerate(late)]
    told = [len([one for one in step if one.topic.endswith("/state")]) for step in steps]
    assert abs(sum(told) - 10.0 * rate) <= 1.0 and max(told) == 1


def test_names_are_escaped_in_topics_only() -> None:
    topics = {message.topic for message in published([ONE, TWO], 0.5)}
    assert "ridlink/v1/here/uas/BRA%2FVO%23/state" in topics


def test_a_batch_is_one_message_an_instant() -> None:
    messages = published([ONE, TWO], 3.0, batch=True, rate_hz=2.0)
    batches = of(messages, TOPICS.batch)
    assert len(batches) == 6
    assert [state["uas"] for state in batches[-1]["states"]] == ["ALPHA", "BRA/VO#"]
    assert not of(messages, TOPICS.state("ALPHA"))


def test_an_encounter_opens_is_followed_and_closes_and_a_disc_entered_is_one_alert() -> None:
    messages = published([ONE, TWO], 20.0)
    phases = [encounter["phase"] for encounter in of(messages, TOPICS.encounter(("ALPHA", "BRA/VO#")))]
    assert phases[0] == "open" and phases[-1] == "close" and set(phases[1:-1]) == {"update"}
    [alert] = of(messages, TOPICS.alert)
    assert alert["kind"] == "disc_entered" and alert["uas"] == ["ALPHA", "BRA/VO#"]


def test_airframes_that_touch_are_an_alert_of_their_own_after_that_of_the_disc() -> None:
    alerts = of(published([ONE, replace(TWO, start_ne_m=(100.0, 0.0))], 20.0), TOPICS.alert)
    assert [alert["kind"] for alert in alerts] == ["disc_entered", "mac"]
    assert alerts[0]["distance_m"] > 20.0 and alerts[1]["distance_m"] <= 0.6
    assert 0.5 < alerts[1]["t"] - alerts[0]["t"] < 1.5, "22 m at 20 m/s"


def test_an_encounter_goes_on_under_the_identity_that_is_heard_late() -> None:
    messages = published([replace(ONE, identity_from_s=2.0), TWO], 20.0)
    before = [one["phase"] for one in of(messages, TOPICS.encounter(("1/1", "BRA/VO#")))]
    after = [one["phase"] for one in of(messages, TOPICS.encounter(("BRA/VO#", "ALPHA")))]
    assert (before[0], before[-1]) == ("open", "close") == (after[0], after[-1])
    assert before.count("close") == after.count("open") == 1


def test_who_comes_and_goes_is_retained_availability() -> None:
    publisher = Publisher(PublisherSettings(TOPICS))
    for time_s, frame in frames([ONE], 0.3):
        publisher.receive(frame, time_s)
    here = [message for message in publisher.step(0.3, UTC_S) if message.topic.endswith("ALPHA/availability")]
    gone = [message for message in publisher.step(30.0, UTC_S) if message.topic.endswith("ALPHA/availability")]
    assert [(one.payload, one.retain) for one in (*here, *gone)] == [(b"online", True), (b"offline", True)]
    assert any(message.topic == TOPICS.availability for message in publisher.greeting())


def test_home_assistant_keeps_no_tracker_under_the_name_before_the_identity() -> None:
    trackers: dict[str, bytes] = {}
    for message in published([replace(ONE, identity_from_s=2.0), TWO], 15.0, home_assistant=True):
        if message.topic.startswith("homeassistant/"):
            assert message.retain
            trackers[message.topic.split("/")[2]] = message.payload
    assert trackers["ridlink_1_2F1"] == b"", "a broker forgets what is empty, and Home Assistant takes it back"
    assert b"ALPHA" in trackers["ridlink_ALPHA"] and sum(map(bool, trackers.values())) == 2


def test_home_assistant_keeps_no_tracker_of_a_relayed_aircraft_that_turns_out_to_be_a_known_one() -> None:
    relayed = replace(ONE, sysid=200, start_ne_m=(-99.0, 0.0), identity_from_s=2.0, id_or_mac=b"relay".ljust(20, b"\0"))
    trackers: dict[str, bytes] = {}
    for message in published([ONE, relayed], 5.0, home_assistant=True):
        if message.topic.startswith("homeassistant/"):
            trackers[message.topic.split("/")[2]] = message.payload
    assert len(trackers) == 2 and [name for name, config in trackers.items() if config] == ["ridlink_ALPHA"]


def test_home_assistant_gets_a_device_tracker_for_each() -> None:
    messages = published([replace(ONE, identity=b"A+#/<b>")], 0.5, home_assistant=True)
    [config] = [message for message in messages if message.topic.startswith("homeassistant/")]
    assert config.topic == "homeassistant/device_tracker/ridlink_A_2B_23_2F_3Cb_3E/config" and config.retain
    announced = json.loads(config.payload)
    assert announced["json_attributes_topic"] == TOPICS.state("A+#/<b>")
    hangs_on = [TOPICS.availability, TOPICS.aircraft_availability("A+#/<b>")]
    assert [one["topic"] for one in announced["availability"]] == hangs_on and announced["availability_mode"] == "all"


def test_trackers_read_states_that_a_batch_replaces_so_that_both_are_refused() -> None:
    with pytest.raises(ConfigError, match="batch"):
        PublisherSettings(TOPICS, batch=True, home_assistant=True)


def test_a_broker_that_kept_nothing_is_told_again_who_is_there_and_at_the_end_that_nobody_is() -> None:
    publisher = Publisher(PublisherSettings(TOPICS, home_assistant=True))
    for time_s, frame in frames([ONE], 0.3):
        publisher.receive(frame, time_s)
    arrival = {one for one in publisher.step(0.3, UTC_S) if one.retain and "ALPHA" in one.topic}
    assert len(arrival) == 2 and arrival < set(publisher.greeting())
    farewell = {message.topic: message for message in publisher.farewell()}
    assert farewell.keys() == {TOPICS.availability, TOPICS.aircraft_availability("ALPHA")}
    assert all(message.payload == b"offline" and message.retain for message in farewell.values())


@pytest.mark.parametrize("rate", [0.0, -1.0, 11.0, float("nan")])
def test_a_rate_that_is_none_is_refused(rate: float) -> None:
    with pytest.raises(ConfigError, match="rate"):
        PublisherSettings(TOPICS, rate_hz=rate)
