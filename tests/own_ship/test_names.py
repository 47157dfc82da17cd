"""What the own vehicle is called: its serial number before any other name, and never what the last one was called."""

from __future__ import annotations

from ridlink.own_ship import OwnShipTelemetry
from ridlink.own_ship.names import MOST_NAMES, OwnNames
from ridlink.remote_id.messages import BasicId
from tests.own_ship.autopilot import Autopilot, flying

SERIAL, REGISTRATION = BasicId(1, 2, b"SERIAL"), BasicId(2, 2, b"REGISTRATION")


def test_a_serial_number_is_the_name_and_all_of_them_are_known() -> None:
    for told in ((SERIAL, REGISTRATION), (REGISTRATION, SERIAL, REGISTRATION)):
        names = OwnNames(flying()[0])
        assert names.uas_id is None and names.known == set()
        names.hear(told[0])
        assert names.uas_id == told[0].uas_id
        for each in told[1:]:
            names.hear(each)
        assert (names.uas_id, names.id_type) == (b"SERIAL", 1) and names.known == {b"SERIAL", b"REGISTRATION"}


def test_a_name_that_is_configured_stays_and_the_vehicles_own_are_known_as_well() -> None:
    names = OwnNames(flying()[0], b"CONFIGURED")
    names.hear(SERIAL)
    assert names.uas_id == b"CONFIGURED" and names.known == {b"CONFIGURED", b"SERIAL"}
    names.hear(REGISTRATION)
    assert names.id_type == 1


def test_no_name_is_none_and_there_are_not_too_many() -> None:
    names = OwnNames(flying()[0])
    names.hear(BasicId(0, 2, b"NONE"))
    names.hear(BasicId(1, 2, b""))
    assert names.known == set()
    for k in range(MOST_NAMES + 2):
        names.hear(BasicId(3, 2, b"%d" % k))
    assert names.known == {b"%d" % k for k in range(8)}


def test_another_vehicle_has_other_names() -> None:
    telemetry = OwnShipTelemetry()
    names, second = OwnNames(telemetry, None), OwnNames(telemetry, b"CONFIGURED")
    Autopilot(telemetry, sysid=1).heartbeat(0.0)
    for each in (names, second):
        each.hear(SERIAL)
    Autopilot(telemetry, sysid=2).heartbeat(4.0)
    assert names.uas_id is None and names.known == set()
    assert second.uas_id == b"CONFIGURED" and second.known == {b"CONFIGURED"}
    names.hear(REGISTRATION)
    assert (names.uas_id, names.id_type) == (b"REGISTRATION", 2), "no serial number of this one is known"
