"""Checks of this machine: interpreter, extras, ports, receive buffer, clocks, kernels."""

from __future__ import annotations

import contextlib
import ctypes
import importlib.util
import platform
import socket
import sys
import time
from collections.abc import Iterator
from importlib.metadata import version

from numba import config

from ridlink.avoidance.solver import warm_up
from ridlink.avoidance.types import SolverKind
from ridlink.compiled import can_be_kept
from ridlink.doctor.finding import Finding, Verdict
from ridlink.links.udp import RECEIVE_BUFFER_BYTES

PORTS = {
    14540: "telemetry of the first vehicle (ridlink avoid)",
    14580: "commands to the first emulated vehicle (ridlink sim)",
    14650: "the air (ridlink sim)",
}
"""UDP ports on 127.0.0.1, with what uses them by default."""

EXTRAS = {
    "mavsdk": ("mavsdk", "flying vehicles with MAVSDK"),
    "web": ("starlette", "the page in the browser"),
    "metrics": ("prometheus_client", "metrics for Prometheus"),
    "mqtt": ("aiomqtt", "publishing the traffic on a broker"),
    "export": ("pyarrow", "Parquet and MCAP, campaigns"),
    "plot": ("matplotlib", "figures"),
    "cluster": ("distributed", "campaigns on many machines"),
    "serial": ("serial", "links over serial devices"),
}
"""Extras, each with a module that shows that it is installed, and its purpose."""

SLEEPS = 20
SLEEP_S = 0.005
LATEST_WAKE_S = 0.02
"""Largest delay of a wake-up: a fifth of the time between two setpoints."""

CLOCK_UNSYNCHRONISED = 5
"""TIME_ERROR of adjtimex(2)."""

COMPILED_S = 2.0
"""Loading kernels from disk takes less, compiling them more."""


def examine_machine() -> Iterator[Finding]:
    """All checks of this machine that matter for a flight; kernels come last, since they may take seconds."""
    yield _interpreter()
    yield from _extras()
    yield from (_port(port, use) for port, use in PORTS.items())
    yield _receive_buffer()
    yield _wall_clock()
    yield _punctuality()
    yield _kernels()


def _interpreter() -> Finding:
    text = f"Python {platform.python_version()}, ridlink {version('ridlink')}, pymavlink {version('pymavlink')}"
    if sys.platform != "linux":
        return Finding("interpreter", Verdict.WARNING, f"{text} on {sys.platform}", "ridlink is tested on Linux")
    return Finding("interpreter", Verdict.OK, text)


def _extras() -> Iterator[Finding]:
    for extra, (module, purpose) in EXTRAS.items():
        if importlib.util.find_spec(module) is None:
            yield Finding(
                f"extra {extra}", Verdict.NOTE, f"not installed: {purpose}", f"pip install 'ridlink[{extra}]'"
            )
        else:
            yield Finding(f"extra {extra}", Verdict.OK, f"installed: {purpose}")


def _port(port: int, use: str) -> Finding:
    name = f"port {port}"
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        try:
            sock.bind(("127.0.0.1", port))
        except OSError as error:
            return Finding(
                name, Verdict.WARNING, f"{error.strerror}: {use}", f"ss -ulpn 'sport = :{port}' shows who has it"
            )
    return Finding(name, Verdict.OK, f"free: {use}")


def _receive_buffer() -> Finding:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES)
        granted = sock.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF) // 2  # Linux reports twice what it gives
    text = f"{granted / 2**20:.2f} of {RECEIVE_BUFFER_BYTES / 2**20:.0f} MiB granted"
    if granted >= RECEIVE_BUFFER_BYTES:
        return Finding("receive buffer", Verdict.OK, text)
    return Finding(
        "receive buffer",
        Verdict.WARNING,
        f"{text}: in dense traffic a busy moment loses messages",
        f"sysctl -w net.core.rmem_max={RECEIVE_BUFFER_BYTES}",
    )


def _wall_clock() -> Finding:
    state = None
    with contextlib.suppress(AttributeError, OSError):  # not every C library has it
        # struct ntptimeval is well below 256 bytes on every Linux.
        state = ctypes.CDLL(None).ntp_gettime(ctypes.create_string_buffer(256))
    now = time.strftime("%Y-%m-%d %H:%M:%S", time.gmtime())
    if state == CLOCK_UNSYNCHRONISED:
        return Finding(
            "wall clock",
            Verdict.WARNING,
            f"{now} UTC, not synchronised: reports are as old as their arrival says, signatures may be refused",
            "run chrony, or another NTP client",
        )
    if state is None:
        return Finding("wall clock", Verdict.NOTE, f"{now} UTC, whether synchronised is not known here")
    return Finding("wall clock", Verdict.OK, f"{now} UTC, synchronised")


def _punctuality() -> Finding:
    latest_s = 0.0
    for _ in range(SLEEPS):
        due_s = time.monotonic() + SLEEP_S
        time.sleep(SLEEP_S)
        latest_s = max(latest_s, time.monotonic() - due_s)
    text = f"woken at most {latest_s * 1e3:.1f} ms late in {SLEEPS} sleeps"
    if latest_s <= LATEST_WAKE_S:
        return Finding("punctuality", Verdict.OK, text)
    return Finding(
        "punctuality", Verdict.WARNING, f"{text}: setpoints will be as late", "give the daemon a core of its own"
    )


def _kernels() -> Finding:
    if config.DISABLE_JIT:
        text = "kernels are not compiled, as NUMBA_DISABLE_JIT says: decisions take many times as long"
        return Finding("solver", Verdict.WARNING, text, "unset NUMBA_DISABLE_JIT")
    begun_s = time.monotonic()
    warm_up(SolverKind.HALFPLANE)
    took_s = time.monotonic() - begun_s
    if took_s < COMPILED_S:
        return Finding("solver", Verdict.OK, f"kernels ready in {took_s:.2f} s")
    if not can_be_kept():
        return Finding(
            "solver",
            Verdict.WARNING,
            f"kernels compiled in {took_s:.1f} s, as at every start: they can be kept nowhere",
            "name a folder in NUMBA_CACHE_DIR, or make the home directory writable",
        )
    return Finding("solver", Verdict.NOTE, f"kernels compiled in {took_s:.1f} s, and kept for the next start")
