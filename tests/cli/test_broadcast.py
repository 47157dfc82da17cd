"""``ridlink broadcast`` between an autopilot and whoever transmits, on real sockets."""

from __future__ import annotations

import json
import re
import select
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from ridlink.mavlink.codec import CRC_EXTRAS, Encoder, Message
from ridlink.mavlink.frames import Frame, parse_datagram
from tests.captures.drawn import version_1
from tests.cli.full_pipe import full_pipe
from tests.daemon.emulated import Emulated
from tests.daemon.invariants import messages

PATIENCE_S = 30.0
COMMAND = [sys.executable, "-m", "ridlink", "broadcast"]


@contextmanager
def transmitting(*options: str) -> Iterator[tuple[subprocess.Popen[str], socket.socket, socket.socket]]:
    """The program, its vehicle's socket and the socket of whoever transmits."""
    with (
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as air,
    ):
        for sock in (vehicle, air):
            sock.bind(("127.0.0.1", 0))
            sock.settimeout(PATIENCE_S)
        ports = (sock.getsockname()[1] for sock in (vehicle, air))
        urls = [f"udpout:127.0.0.1:{port}" for port in ports]
        command = [*COMMAND, "--vehicle", urls[0], "--to", urls[1], "--json", *options]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
            try:
                yield process, vehicle, air
            finally:
                process.kill()


def said_until(vehicle: socket.socket, air: socket.socket, autopilot: Emulated, wanted: set[str]) -> list[Message]:
    """Let the autopilot speak until all of these messages were transmitted."""
    heard: list[Message] = []
    data, daemon = vehicle.recvfrom(1000)
    assert messages(data)[0].name == "HEARTBEAT"
    now_s = 0.0
    while not wanted <= {message.name for message in heard}:
        vehicle.sendto(autopilot.telemetry(now_s), daemon)
        now_s += 0.05
        if select.select([air], [], [], 0.05)[0]:
            heard += messages(air.recv(2000))
        assert now_s < PATIENCE_S * 10
    return heard


def test_an_autopilots_state_goes_into_the_air_until_a_signal() -> None:
    with transmitting("--uas-id", "SERIAL-9", "--airframe", "1.2") as (process, vehicle, air):
        wanted = {"OPEN_DRONE_ID_LOCATION", "RIDLINK_SEPARATION", "OPEN_DRONE_ID_BASIC_ID", "OPEN_DRONE_ID_SYSTEM"}
        heard = said_until(vehicle, air, Emulated(9, error_m=4.2), wanted | {"HEARTBEAT"})
        by_name = {message.name: message for message in heard}
        assert by_name["HEARTBEAT"].type == 34  # MAV_TYPE_ODID: it steers nothing
        assert by_name["OPEN_DRONE_ID_BASIC_ID"].uas_id.rstrip(b"\x00") == b"SERIAL-9"
        assert by_name["RIDLINK_SEPARATION"].airframe_size == 120
        assert by_name["RIDLINK_SEPARATION"].horizontal_error == 420
        assert by_name["RIDLINK_SEPARATION"].flags == 2  # measured, and nobody avoids for it
        process.send_signal(signal.SIGTERM)
        output = process.communicate(timeout=PATIENCE_S)[0]
    lines = [json.loads(line) for line in output.splitlines()]
    assert process.returncode == 0
    assert lines[-1]["event"] == "final" and lines[-1]["sent"] >= 2


def test_a_module_is_fed_and_what_it_says_is_passed_on() -> None:
    with transmitting("--form", "module", "--operator-id", "OP-1") as (process, vehicle, module):
        assert process.stdout is not None
        wanted = {f"OPEN_DRONE_ID_{name}" for name in ("AUTHENTICATION", "SELF_ID", "OPERATOR_ID", "SYSTEM")}
        autopilot = Emulated(9)
        said_until(vehicle, module, autopilot, wanted)
        data, daemon = module.recvfrom(2000)
        assert messages(data)
        answer = Encoder(9, 236).encode("OPEN_DRONE_ID_ARM_STATUS", status=1, error=b"missing \x1bLOC")
        module.sendto(answer, daemon)
        lines = (json.loads(line) for line in process.stdout)
        told = next(line for line in lines if line["event"] == "module")
    assert (told["good_to_arm"], told["text"]) == (False, "missing \\x1bLOC")


def test_relayed_for_a_transmitter_that_was_heard() -> None:
    with transmitting("--relay-as", "02:52:49:44:00:07") as (_, vehicle, air):
        heard = said_until(vehicle, air, Emulated(9), {"RIDLINK_SEPARATION", "OPEN_DRONE_ID_SYSTEM"})
    bearing = [message for message in heard if message.name != "HEARTBEAT"]
    assert bearing and all(message.id_or_mac[:6] == bytes.fromhex("025249440007") for message in bearing)


class Old(Emulated):
    """An autopilot that speaks MAVLink 1 (as system 7, which is that of these frames)."""

    def telemetry(self, now_s: float) -> bytes:
        frames = [each for each in parse_datagram(super().telemetry(now_s), CRC_EXTRAS) if isinstance(each, Frame)]
        return b"".join(version_1(each.msgid, each.payload, CRC_EXTRAS[each.msgid]) for each in frames)


@pytest.mark.parametrize("allowed", [True, False])
def test_an_autopilot_that_speaks_mavlink_1_is_taken_when_that_is_allowed(allowed: bool) -> None:
    with transmitting(*["--allow-v1"] * allowed) as (process, vehicle, air):
        if allowed:
            said_until(vehicle, air, Old(7), {"OPEN_DRONE_ID_LOCATION", "RIDLINK_SEPARATION"})
            return
        assert process.stdout is not None
        lines, autopilot, why = iter(process.stdout.readline, ""), Old(7), None
        _, daemon = vehicle.recvfrom(1000)
        while not why:
            vehicle.sendto(autopilot.telemetry(0.0), daemon)
            why = json.loads(next(lines))["why"]
    assert why == "the vehicle speaks MAVLink 1, which is not taken: set it to MAVLink 2, or give --allow-v1"


@pytest.mark.parametrize(
    ("arguments", "code", "says"),
    [
        (["--vehicle", "udp:127.0.0.1:1"], 2, "udpin:127.0.0.1:1"),
        (["--relay-as", "zz"], 2, "'zz' is not an address in hexadecimal"),
        (["--to", "udpout:127.0.0.1:14540"], 2, "to udpout:127.0.0.1:14540 leads to the port that vehicle listens on"),
        (["--airframe", "-1"], 2, "airframe must lie between 0.1 and 30 m, got -1"),
        (["--uas-id", "x" * 21], 2, "uas-id must have at most 20 bytes"),
        (["--vehicle", "udpin:192.0.2.1:14540"], 3, "no address of this machine"),
    ],
)
def test_bad_input_is_one_line(arguments: list[str], code: int, says: str) -> None:
    done = subprocess.run([*COMMAND, *arguments], capture_output=True, text=True, timeout=PATIENCE_S)
    assert (done.returncode, done.stdout) == (code, "")
    assert says in done.stderr and len(re.findall("\n", done.stderr)) == 1


def test_a_reader_that_stops_reading_stops_no_transmission() -> None:
    with full_pipe() as writing, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as vehicle:
        vehicle.bind(("127.0.0.1", 0))
        vehicle.settimeout(PATIENCE_S)
        options = ("--vehicle", f"udpout:127.0.0.1:{vehicle.getsockname()[1]}", "--to", "udpout:127.0.0.1:9", "--json")
        with subprocess.Popen([*COMMAND, *options], stdout=writing) as process:
            try:
                for _ in range(2):
                    assert messages(vehicle.recv(1000))[0].name == "HEARTBEAT"
                process.send_signal(signal.SIGTERM)
                assert process.wait(PATIENCE_S) == 0
            finally:
                process.kill()
