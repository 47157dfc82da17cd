"""Why no autopilot is heard: once it lasts, and never where one is."""

from __future__ import annotations

from ridlink.engine.intake import Intake
from ridlink.engine.unheard import ENOUGH, Unheard
from ridlink.mavlink.codec import Encoder
from ridlink.own_ship import OwnShipTelemetry
from tests.captures.drawn import version_1

OLD_HEARTBEAT = version_1(0, bytes(9), 50)


def test_an_autopilot_that_begins_with_mavlink_1_and_changes_is_no_news() -> None:
    intake, telemetry = Intake(), OwnShipTelemetry()
    unheard, told = Unheard(intake, telemetry), []
    for second in range(20):
        intake.messages(OLD_HEARTBEAT, frozenset((0,)))
        told.append(unheard.why())
        if second == 10:
            beat = Encoder(1, 1).encode("HEARTBEAT", type=2, autopilot=12)
            ((_, message),) = intake.messages(beat, frozenset((0,)))
            telemetry.receive(1, 1, message, float(second))
    assert [bool(text) for text in told] == [ENOUGH - 1 <= second <= 10 for second in range(20)]
    assert "MAVLink 1" in told[10]


def test_where_nobody_speaks_there_is_nothing_to_say() -> None:
    unheard = Unheard(Intake(), OwnShipTelemetry(7))
    assert {unheard.why() for _ in range(30)} == {""}


def test_others_are_none_of_ours() -> None:
    telemetry = OwnShipTelemetry(7)
    unheard = Unheard(Intake(), telemetry)
    ((_, message),) = Intake().messages(Encoder(3, 1).encode("HEARTBEAT", type=2, autopilot=3), frozenset((0,)))
    told = [telemetry.receive(3, 1, message, float(k)) or unheard.why() for k in range(10)]
    assert set(told[ENOUGH - 1 :]) == {"autopilots are heard, none of them with system id 7"}
    assert set(told[: ENOUGH - 1]) == {""}
