"""Prometheus metrics over HTTP, off the control path: the loop publishes figures once a second, threads serve them.

All figures are replaced together, so a reader sees the figures of one instant, and the loop never waits. The server
listens on loopback unless the address says otherwise. Needs the extra `metrics` (prometheus-client).
"""

from __future__ import annotations

import contextlib
import re
import threading
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import StrEnum
from types import MappingProxyType
from typing import Any

from ridlink.errors import ConfigError, LinkError, MissingExtraError

DEFAULT_HOST = "127.0.0.1"
SILENT_S = 5.0
"""A connection that sends nothing for this long is closed, and its thread ends."""

MOST_THREADS = 64
"""Threads of the process; with this many, no further connection is served."""

Value = float | Mapping[str, float]
"""One figure, or figures by the value of a label."""


class Kind(StrEnum):
    """Kind of a metric: whether its figure only grows."""

    GAUGE = "gauge"
    COUNTER = "counter"


@dataclass(frozen=True, slots=True)
class Metric:
    """One metric.

    Args:
        kind: Whether it only grows.
        text: What it means.
        label: Name of its label; empty for none.
    """

    kind: Kind
    text: str
    label: str = ""


AVOID_METRICS: Mapping[str, Metric] = MappingProxyType(
    {
        "ridlink_state": Metric(Kind.GAUGE, "1 for the state of the failsafe ladder, 0 for the others.", "state"),
        "ridlink_tracks": Metric(Kind.GAUGE, "Aircraft that are followed."),
        "ridlink_tracks_doubtful": Metric(Kind.GAUGE, "Of these, ones that do not move as they say."),
        "ridlink_conflicts": Metric(Kind.GAUGE, "Neighbours whose disc is entered within the horizon if all fly on."),
        "ridlink_nearest_margin_metres": Metric(Kind.GAUGE, "Distance to the nearest disc; absent without traffic."),
        "ridlink_time_to_violation_seconds": Metric(Kind.GAUGE, "Until the first disc is entered; absent if never."),
        "ridlink_own_error_metres": Metric(
            Kind.GAUGE, "Own position error, three standard deviations; absent if unknown."
        ),
        "ridlink_setpoints": Metric(Kind.COUNTER, "Setpoints sent."),
        "ridlink_reports_received": Metric(Kind.COUNTER, "LOCATION messages taken."),
        "ridlink_infeasible_steps": Metric(Kind.COUNTER, "Decisions without an admissible velocity."),
        "ridlink_guard_takeovers": Metric(
            Kind.COUNTER, "Conflicts for which the guard took over; absent without --guard."
        ),
        "ridlink_broadcasts": Metric(Kind.COUNTER, "Datagrams of the own Remote ID sent."),
        "ridlink_decision_seconds": Metric(Kind.GAUGE, "Time of a step, of the last minute.", "quantile"),
        "ridlink_setpoint_gap_seconds": Metric(Kind.GAUGE, "Between two setpoints, of the last minute.", "quantile"),
        "ridlink_events": Metric(Kind.COUNTER, "What was dropped, clamped, refused or noticed.", "cause"),
    }
)
"""Metrics of `ridlink avoid`. Names of counters get the suffix `_total`."""

MQTT_METRICS: Mapping[str, Metric] = MappingProxyType(
    {
        "ridlink_mqtt_published": Metric(Kind.COUNTER, "Messages that the broker took."),
        "ridlink_mqtt_connections": Metric(Kind.COUNTER, "Times that the broker was reached."),
        "ridlink_mqtt_waiting": Metric(Kind.GAUGE, "Messages that wait for the broker."),
        "ridlink_mqtt_overtaken": Metric(Kind.COUNTER, "Messages for which a newer one of their topic went."),
        "ridlink_mqtt_dropped": Metric(Kind.COUNTER, "Messages for which there was no room."),
        "ridlink_mqtt_events": Metric(Kind.COUNTER, "What was refused or noticed.", "cause"),
    }
)
"""Metrics of `ridlink mqtt`."""


def parse_metrics_address(text: str) -> tuple[str, int]:
    """Host and port of ``HOST:PORT``, ``:PORT`` or ``PORT``.

    Raises:
        ConfigError: If the text has none of these forms.
    """
    host, _, port = text.strip().rpartition(":")
    if not (re.fullmatch(r"[0-9]{1,5}", port) and int(port) <= 65535):
        raise ConfigError(f"metrics {text!r}: write HOST:PORT, as in {DEFAULT_HOST}:9464")
    return host.strip("[]") or DEFAULT_HOST, int(port)


class MetricsServer:
    """Serves metrics until it is closed.

    Args:
        address: Host and port; port 0 lets the kernel choose.
        metrics: The metrics to serve.

    Raises:
        MissingExtraError: If prometheus-client is not installed.
        LinkError: If the port cannot be opened.

    Attributes:
        port: The port it listens on.
    """

    def __init__(self, address: tuple[str, int], metrics: Mapping[str, Metric]) -> None:
        try:
            from prometheus_client import CollectorRegistry, start_http_server
        except ImportError as error:
            raise MissingExtraError("metrics", "--metrics") from error
        self._metrics = metrics
        self._values: Mapping[str, Value] = {}
        registry = CollectorRegistry()
        registry.register(self)  # type: ignore[arg-type]
        host, port = address
        try:
            self._server, self._thread = start_http_server(port, host, registry)
        except (OSError, UnicodeError) as error:  # a host name with an empty label raises no OSError
            reason = getattr(error, "strerror", None) or error
            raise LinkError(f"metrics {host}:{port}: {reason}; choose another address") from error
        self._server.RequestHandlerClass = _patient(self._server.RequestHandlerClass)
        self._server.verify_request = lambda *_: threading.active_count() < MOST_THREADS  # type: ignore[method-assign]
        self.port = int(self._server.server_port)

    def publish(self, values: Mapping[str, Value]) -> None:
        """Replace all figures; a metric that is not in ``values`` is absent."""
        self._values = values

    def describe(self) -> list[object]:
        """An empty list: nothing is collected at registration. Part of prometheus-client's interface."""
        return []

    def collect(self) -> Iterator[object]:
        """The figures published last. Part of prometheus-client's interface, called by its threads."""
        from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily

        values = self._values
        for name, metric in self._metrics.items():
            if name not in values:
                continue
            family = CounterMetricFamily if metric.kind is Kind.COUNTER else GaugeMetricFamily
            found = family(name, metric.text, labels=[metric.label] if metric.label else None)
            value = values[name]
            if isinstance(value, Mapping):
                for label, figure in value.items():
                    found.add_metric([label], figure)
            else:
                found.add_metric([], value)
            yield found

    def close(self) -> None:
        """Release the port."""
        self._server.shutdown()
        self._server.server_close()
        self._thread.join(1.0)


def _patient(handler: Any) -> Any:
    """The class of a request handler with a timeout, which stays silent when the peer has disconnected."""

    class Patient(handler):  # type: ignore[misc]
        timeout = SILENT_S

        def handle(self) -> None:
            with contextlib.suppress(OSError):
                super().handle()

    return Patient
