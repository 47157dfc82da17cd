"""Frames in, messages for the broker out: states, encounters, alerts, arrivals, departures. No socket, no clock.

The schema of every payload is in docs/mqtt.md. A payload is one JSON object without NaN; unknown values are ``null``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import msgspec

from ridlink.errors import ConfigError
from ridlink.mavlink.frames import Frame
from ridlink.mqtt.outbox import Outgoing
from ridlink.mqtt.topics import Topics, object_id
from ridlink.observer import Encounter, EncounterLog, Phase, Scene, Sky, aircraft_states
from ridlink.observer.states import rounded
from ridlink.periodic import Periodic
from ridlink.remote_id.accuracy import DEFAULT_CONVENTION, AccuracyConvention
from ridlink.separation.definitions import Definition

SCHEMA = 1
STEP_S = 0.1
"""Time between two steps. Every step updates encounters; states are published in the steps nearest to their rate."""

MOST_ENCOUNTERS = 500
"""Most encounters at a time; the queue for the broker holds twice as many messages."""

MEETINGS_HZ = 1.0
"""Highest rate at which an ongoing encounter is published; dense traffic has many more pairs than aircraft."""

ONLINE, OFFLINE = b"online", b"offline"
DISC_ENTERED, MAC = "disc_entered", "mac"
"""Kinds of alerts, the graver one last: a pair with a disc entered gets a second alert if the airframes touch."""


@dataclass(frozen=True, slots=True)
class PublisherSettings:
    """Settings of a publisher.

    Args:
        topics: Topics to publish on.
        definition: Definition of the separation discs.
        convention: Assumed meaning of the senders' accuracy codes.
        rate_hz: States of every aircraft a second.
        batch: All states of an instant in one message, instead of one message for each aircraft.
        home_assistant: Announce every aircraft as a device tracker as well.

    Raises:
        ConfigError: If the rate is not above 0 and at most 10, or a batch is to feed device trackers.
    """

    topics: Topics
    definition: Definition = Definition.CANDIDATE2
    convention: AccuracyConvention | str = DEFAULT_CONVENTION
    rate_hz: float = 1.0
    batch: bool = False
    home_assistant: bool = False

    def __post_init__(self) -> None:
        if not 0.0 < self.rate_hz <= 10.0:
            raise ConfigError(f"rate {self.rate_hz:g}: must be above 0 and at most 10 a second")
        if self.batch and self.home_assistant:
            raise ConfigError("home-assistant reads the state of each aircraft, which batch replaces: leave one out")


class Publisher:
    """Turns received frames into messages for the broker.

    Args:
        settings: Settings.
        version: Version of this program, for the ``info`` topic.

    Attributes:
        sky: Aircraft that are heard.
    """

    def __init__(self, settings: PublisherSettings, version: str = "") -> None:
        self.sky = Sky(convention=settings.convention)
        self._settings = settings
        self._version = version
        self._encounters = EncounterLog(settings.definition, most=MOST_ENCOUNTERS)
        self._states_due = Periodic(1.0 / settings.rate_hz, early_s=STEP_S / 2.0)
        self._known: dict[int, str] = {}
        self._alerted: dict[tuple[int, int], str] = {}
        self._updated_s: dict[tuple[int, int], float] = {}
        self._called: dict[tuple[int, int], tuple[str, str]] = {}
        self._origin_told = False

    def receive(self, frame: Frame, now_s: float) -> None:
        """Take a frame."""
        self.sky.receive(frame, now_s)

    def greeting(self) -> list[Outgoing]:
        """Messages after every connection: that the bridge is online, what it publishes, and which aircraft are heard.

        All of them are retained, but a broker that was restarted may have kept none.
        """
        origin = self.sky.origin
        info = {
            "schema": SCHEMA,
            "version": self._version,
            "definition": str(self._settings.definition),
            "rate_hz": self._settings.rate_hz,
            "batch": self._settings.batch,
            "origin_deg": None if origin is None else [origin.latitude_deg, origin.longitude_deg],
        }
        topics = self._settings.topics
        known = [message for name in self._known.values() for message in self._arrival(name)]
        return [
            Outgoing(topics.availability, ONLINE, 1, True),
            Outgoing(topics.info, msgspec.json.encode(info), 1, True),
            *known,
        ]

    def step(self, now_s: float, utc_s: float) -> list[Outgoing]:
        """Messages to publish now. Call it every `STEP_S`, as far as a busy machine allows.

        Args:
            now_s: The clock of `receive`.
            utc_s: Seconds since 1970-01-01 UTC, for the payloads.
        """
        self.sky.forget_silent(now_s)
        scene = self.sky.at(now_s)
        out = self._arrivals_and_departures(scene.merged)
        out += self._meetings(scene, utc_s)
        if self._states_due.due(now_s):
            out += self._states(scene, utc_s)
        return out

    def farewell(self) -> list[Outgoing]:
        """Messages at the end: that the bridge is offline, and no aircraft is heard any more."""
        topics = self._settings.topics
        known = [_availability(topics, name, online=False) for name in self._known.values()]
        return [Outgoing(topics.availability, OFFLINE, 1, True), *known]

    def _arrival(self, name: str) -> list[Outgoing]:
        topics = self._settings.topics
        out = [_availability(topics, name, online=True)]
        if self._settings.home_assistant:
            out.append(_device_tracker(topics, name))
        return out

    def _arrivals_and_departures(self, merged: frozenset[int]) -> list[Outgoing]:
        topics = self._settings.topics
        present = {one.number: one.name for one in self.sky.aircraft.values()}
        if present == self._known:
            return []
        out = [] if self._origin_told or self.sky.origin is None else self.greeting()
        self._origin_told = self._origin_told or self.sky.origin is not None
        before, now = set(self._known.values()), set(present.values())
        out += [_availability(topics, name, online=False) for name in sorted(before - now)]
        for name in sorted(now - before):
            out += self._arrival(name)
        if self._settings.home_assistant:  # a name from before the identity is no second tracker of an aircraft
            renamed = {
                name for number, name in self._known.items() if number in merged or present.get(number, name) != name
            }
            out += [_no_device_tracker(name) for name in sorted(renamed - now)]
        self._known = present
        return out

    def _states(self, scene: Scene, utc_s: float) -> list[Outgoing]:
        definition, topics = self._settings.definition, self._settings.topics
        states = [
            (topics.state(state["uas"]), {"schema": SCHEMA} | state)
            for state in aircraft_states(self.sky, scene, definition, utc_s)
        ]
        if self._settings.batch:
            whole = {"schema": SCHEMA, "t": round(utc_s, 3), "states": [state for _, state in states]}
            return [Outgoing(topics.batch, msgspec.json.encode(whole))] if states else []
        return [Outgoing(topic, msgspec.json.encode(state)) for topic, state in states]

    def _meetings(self, scene: Scene, utc_s: float) -> list[Outgoing]:
        out = []
        for phase, encounter in self._encounters.step(scene):
            key, pair = encounter.numbers, encounter.pair
            called = self._called.setdefault(key, pair)
            if called != pair:  # an identity was heard: the pair has another topic from now on
                self._called[key] = pair
                out.append(self._meeting(Phase.CLOSE, encounter, called, scene.time_s, utc_s))
                phase = Phase.OPEN if phase is Phase.UPDATE else phase
            told_s = self._updated_s.get(key, -math.inf)
            if phase is not Phase.UPDATE or scene.time_s - told_s >= 1.0 / min(self._settings.rate_hz, MEETINGS_HZ):
                self._updated_s[key] = scene.time_s
                out.append(self._meeting(phase, encounter, pair, scene.time_s, utc_s))
            kind = MAC if encounter.collided else DISC_ENTERED if encounter.entry_in_s == 0.0 else None
            if kind is not None and self._alerted.get(key) not in (kind, MAC):
                self._alerted[key] = kind
                out.append(self._alert(kind, encounter, utc_s))
            if phase is Phase.CLOSE:
                for kept in (self._updated_s, self._called, self._alerted):
                    kept.pop(key, None)
        return out

    def _meeting(
        self, phase: Phase, encounter: Encounter, pair: tuple[str, str], now_s: float, utc_s: float
    ) -> Outgoing:
        payload = self._encounter_payload(phase, encounter, pair, now_s, utc_s)
        return Outgoing(self._settings.topics.encounter(pair), msgspec.json.encode(payload), 1)

    def _encounter_payload(
        self, phase: Phase, encounter: Encounter, pair: tuple[str, str], now_s: float, utc_s: float
    ) -> dict[str, Any]:
        definition = self._settings.definition
        return {
            "schema": SCHEMA,
            "t": round(utc_s, 3),
            "phase": str(phase),
            "uas": list(pair),
            "definition": str(definition),
            "opened_t": round(utc_s - (now_s - encounter.opened_s), 3),
            "closest_t": rounded(utc_s - (now_s - encounter.closest_s), 3),
            "closest_m": rounded(encounter.closest_m),
            "margin_m": rounded(encounter.margin_m.get(definition, math.inf)),
            "entry_in_s": rounded(encounter.entry_in_s),
        }

    def _alert(self, kind: str, encounter: Encounter, utc_s: float) -> Outgoing:
        payload = {
            "schema": SCHEMA,
            "t": round(utc_s, 3),
            "kind": kind,
            "uas": list(encounter.pair),
            "definition": str(self._settings.definition),
            "distance_m": rounded(encounter.closest_m),
        }
        return Outgoing(self._settings.topics.alert, msgspec.json.encode(payload), 1, about="~".join(encounter.pair))


def _availability(topics: Topics, name: str, *, online: bool) -> Outgoing:
    return Outgoing(topics.aircraft_availability(name), ONLINE if online else OFFLINE, 1, True)


def _device_tracker(topics: Topics, name: str) -> Outgoing:
    """Announces an aircraft to Home Assistant, which shows it on its map."""
    attributes = (
        "{{ {'latitude': value_json.latitude_deg, 'longitude': value_json.longitude_deg, "
        "'gps_accuracy': value_json.horizontal_error_m or 0, 'altitude_m': value_json.altitude_geodetic_m, "
        "'speed_mps': value_json.speed_horizontal_mps} | tojson }}"
    )
    config = {
        "name": name,
        "unique_id": f"ridlink_{object_id(name)}",
        "source_type": "gps",
        "json_attributes_topic": topics.state(name),
        "json_attributes_template": attributes,
        "availability": [{"topic": topics.availability}, {"topic": topics.aircraft_availability(name)}],
        "availability_mode": "all",  # a killed bridge goes offline by its last will, on its own topic only
    }
    return Outgoing(_tracker_topic(name), msgspec.json.encode(config), 1, True)


def _no_device_tracker(name: str) -> Outgoing:
    """Withdraws the announcement from Home Assistant and from the broker."""
    return Outgoing(_tracker_topic(name), b"", 1, True)


def _tracker_topic(name: str) -> str:
    return f"homeassistant/device_tracker/ridlink_{object_id(name)}/config"
