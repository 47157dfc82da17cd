"""Metrics over HTTP while a daemon flies, and a daemon that only says what it would do."""

from __future__ import annotations

import asyncio
import socket
import struct
import urllib.error
import urllib.request
from typing import Any

import pytest
from prometheus_client.parser import text_string_to_metric_families

from ridlink.daemon.figures import figures
from ridlink.daemon.summary import Pace
from ridlink.engine import Engine, EngineConfig, Goal
from ridlink.errors import ConfigError, LinkError
from ridlink.metrics import AVOID_METRICS, MQTT_METRICS, Kind, MetricsServer, parse_metrics_address
from tests.daemon.emulated import PATIENCE_S, Emulated, at
from tests.daemon.harness import running
from tests.loopback import run


def read(port: int) -> dict[str, Any]:
    """Samples by name, with their labels."""
    with urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics", timeout=PATIENCE_S) as answer:
        families = text_string_to_metric_families(answer.read().decode())
        return {(s.name, *s.labels.values()): s.value for family in families for s in family.samples}  # type: ignore[misc]


def test_a_flight_is_seen_from_outside() -> None:
    async def test() -> None:
        async with running(metrics=("127.0.0.1", 0)) as flight:
            port = flight.daemon.metrics_port
            assert port is not None and flight.air.link is not None
            vehicle = flight.vehicle
            await vehicle.until(lambda: bool(flight.air.heard))
            flight.air.link.send(Emulated(9, ned_m=(250.0, 0.0, -50.0)).remote_id(0.0))
            flight.air.link.send(b"junk")
            found: dict[Any, float] = {}
            wanted = {("ridlink_events_total", "garbage"): 1.0, ("ridlink_state", "engaged"): 1.0}
            async with asyncio.timeout(4 * PATIENCE_S):
                while not wanted.items() <= found.items():  # a busy machine may hold it for a step
                    await vehicle.changed()
                    found = await asyncio.to_thread(read, port)
            assert found[("ridlink_setpoints_total",)] > 0.0
            assert found["ridlink_state", "hold"] == 0.0
            assert found[("ridlink_tracks",)] == 1.0
            assert found[("ridlink_reports_received_total",)] == 1.0
            assert 0.0 < found["ridlink_decision_seconds", "0.5"] <= found["ridlink_decision_seconds", "1"]
            assert found[("ridlink_own_error_metres",)] == pytest.approx(3.0, abs=0.1)
            await flight.end()
            with pytest.raises(urllib.error.URLError):
                await asyncio.to_thread(read, port)

    run(test)


def test_a_dry_run_says_what_it_would_send_and_sends_no_setpoint() -> None:
    async def test() -> None:
        engine = EngineConfig(goal=Goal(*at(300.0)), dry_run=True, broadcast=True)
        async with running(engine=engine, metrics=("127.0.0.1", 0)) as flight:
            vehicle = flight.vehicle
            await vehicle.until(lambda: any(event["event"] == "dry_run" for event in flight.events))
            await vehicle.until(lambda: flight.events[-1].get("velocity_ned_mps", [0.0])[0] > 1.0)
            assert not vehicle.setpoints()
            assert {event["setpoints"] for event in flight.events if event["event"] == "summary"} == {0}
            port = flight.daemon.metrics_port
            assert port is not None
            found = await asyncio.to_thread(read, port)
            assert found[("ridlink_setpoints_total",)] == 0.0
            assert ("ridlink_setpoint_gap_seconds", "0.5") not in found
            names = {message.name for message in vehicle.vehicle.heard}
            assert {"HEARTBEAT", "RIDLINK_STATUS"} <= names
            summary = await flight.end()
            assert summary.setpoints == 0 and summary.setpoint_gap_ms["max"] == 0.0
            assert summary.rejects["dry_run_withheld"] > 10
            assert any(len(data) > 60 for data in flight.air.heard)  # everything else leaves

    run(test)


def test_i7_whoever_goes_away_or_says_nothing_leaves_neither_a_traceback_nor_a_thread(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("ridlink.metrics.SILENT_S", 0.2)
    server = MetricsServer(("127.0.0.1", 0), MQTT_METRICS)
    try:
        for said in 5 * (b"GET /metrics HT", b"", b"GET /metrics HTTP/1.1\r\n\r\n"):
            with socket.create_connection(("127.0.0.1", server.port)) as gone:
                gone.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
                gone.sendall(said)
        with socket.create_connection(("127.0.0.1", server.port), PATIENCE_S) as silent:
            assert silent.recv(1) == b""
        monkeypatch.setattr("ridlink.metrics.MOST_THREADS", 0)
        with socket.create_connection(("127.0.0.1", server.port), PATIENCE_S) as one_too_many:
            assert one_too_many.recv(1) == b""
    finally:
        server.close()
    assert capfd.readouterr().err == ""


def test_figures_of_one_instant_with_their_kinds() -> None:
    server = MetricsServer(("127.0.0.1", 0), MQTT_METRICS)
    try:
        assert read(server.port) == {}
        server.publish({"ridlink_mqtt_waiting": 3, "ridlink_mqtt_events": {"refused": 2}, "ridlink_mqtt_published": 1})
        assert read(server.port) == {
            ("ridlink_mqtt_published_total",): 1.0,
            ("ridlink_mqtt_waiting",): 3.0,
            ("ridlink_mqtt_events_total", "refused"): 2.0,
        }
        with pytest.raises(LinkError, match="choose another address"):
            MetricsServer(("127.0.0.1", server.port), AVOID_METRICS)
        with pytest.raises(LinkError, match="label empty"):
            MetricsServer(("127..0.0.1", 0), AVOID_METRICS)
    finally:
        server.close()
    assert all(name.endswith(("metres", "seconds")) or metric.kind for name, metric in AVOID_METRICS.items())
    assert not [name for name in (*AVOID_METRICS, *MQTT_METRICS) if name.endswith("_total")]
    assert {metric.kind for metric in AVOID_METRICS.values()} == set(Kind)


def test_every_figure_of_a_flight_is_a_metric_and_every_metric_has_one() -> None:
    engine = Engine(EngineConfig(guard=True))
    assert engine.guard is not None
    engine.guard.takeovers = 3
    found = figures(engine, engine.step(0.0), pace=Pace(), broadcasts=0, events={})
    absent = {"ridlink_nearest_margin_metres", "ridlink_time_to_violation_seconds", "ridlink_own_error_metres"}
    assert {*found} | absent == {*AVOID_METRICS}, "a metric is named in ridlink/metrics.py, its figure in figures.py"
    assert found["ridlink_guard_takeovers"] == 3
    engine = Engine(EngineConfig())
    alone = figures(engine, engine.step(0.0), pace=Pace(), broadcasts=0, events={})
    assert {*found} - {*alone} == {"ridlink_guard_takeovers"}


def test_addresses_of_metrics() -> None:
    assert parse_metrics_address("9464") == parse_metrics_address(":9464") == ("127.0.0.1", 9464)
    assert parse_metrics_address("0.0.0.0:9464") == ("0.0.0.0", 9464)
    assert parse_metrics_address("[::1]:9464") == ("::1", 9464)
    for wrong in ("", "host", "host:", "host:70000", "host:-1", "1:1_0", "host:" + 5000 * "9"):
        with pytest.raises(ConfigError, match=r"127\.0\.0\.1:9464"):
            parse_metrics_address(wrong)
