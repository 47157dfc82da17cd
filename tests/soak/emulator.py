"""Hostile datagrams to one vehicle of an emulated fleet: ``python -m tests.soak.emulator [DATAGRAMS]`` (100,000).

Random bytes, frames of every message with random fields from anybody, commands of every number, and frames with a
flipped bit, over real UDP to the port of vehicle 1. Ends with 1 unless both vehicles answer afterwards, the fleet ends
with exit code 0 and no internal error, and what was damaged has been counted.
"""

from __future__ import annotations

import json
import math
import random
import socket
import subprocess
import sys
import time

from ridlink.mavlink.codec import CRC_EXTRAS, MESSAGES, Encoder, decode_message
from ridlink.mavlink.frames import Frame, encode_frame, parse_datagram

DATAGRAMS = 100_000
AT_ONCE = 20
TIMESYNC = 111
PATIENCE_S = 10.0
VALUES = (0.0, 1.0, math.nan, math.inf, 3e38, -1.0)

client = Encoder(255, 190)


def hostile(rng: random.Random) -> bytes:
    kind = rng.random()
    if kind < 0.3:
        return rng.randbytes(rng.randrange(400))
    if kind < 0.8:
        spec = rng.choice(list(MESSAGES.values()))
        sender = {"seq": rng.randrange(256), "sysid": rng.randrange(256), "compid": rng.randrange(256)}
        return encode_frame(spec.msgid, rng.randbytes(spec.size), spec.crc_extra, **sender)
    if kind < 0.9:
        return client.encode("COMMAND_LONG", target_system=1, command=rng.randrange(65536), param1=rng.choice(VALUES))
    damaged = bytearray(client.encode("HEARTBEAT"))
    damaged[rng.randrange(len(damaged))] ^= 1 << rng.randrange(8)
    return bytes(damaged)


def answers(port: int) -> bool:
    """Whether a vehicle still answers TIMESYNC."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asker:
        asker.settimeout(PATIENCE_S)
        asker.sendto(client.encode("TIMESYNC", tc1=0, ts1=77), ("127.0.0.1", port))
        end = time.monotonic() + PATIENCE_S
        while time.monotonic() < end:
            for frame in parse_datagram(asker.recv(65535), CRC_EXTRAS):
                if isinstance(frame, Frame) and frame.msgid == TIMESYNC and decode_message(frame).ts1 == 77:
                    return True
    return False


def free_ports() -> int:
    """The first of two free ports in a row."""
    while True:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as one, socket.socket(type=socket.SOCK_DGRAM) as two:
            one.bind(("127.0.0.1", 0))
            port: int = one.getsockname()[1]
            try:
                two.bind(("127.0.0.1", port + 1))
            except OSError:
                continue
            return port


def main() -> int:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else DATAGRAMS
    port, rng = free_ports(), random.Random(1)
    ports = ["--vehicle-port", str(port), "--companion-port", "0", "--air-port", "0"]
    command = [sys.executable, "-m", "ridlink", "sim", "-n", "2", "--airborne", "--json", *ports]
    fleet = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert fleet.stderr is not None
    print(fleet.stderr.readline().strip())
    begun = time.monotonic()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as attacker:
        for sent in range(count):
            attacker.sendto(hostile(rng), ("127.0.0.1", port))
            if sent % AT_ONCE == 0:
                time.sleep(0.002)
    print(f"{count} datagrams in {time.monotonic() - begun:.0f} s")
    alive = [answers(port), answers(port + 1)]
    fleet.terminate()
    output, complaints = fleet.communicate(timeout=60)
    verdict = json.loads(output.splitlines()[-1])
    print(
        f"answers {alive}, exit {fleet.returncode}, errors {verdict['internal_errors']}, refused {verdict['refused']}"
    )
    well = all(alive) and fleet.returncode == 0 and verdict["internal_errors"] == 0 and not complaints
    return 0 if well and verdict["refused"]["bad_frame"] > 0 else 1


if __name__ == "__main__":
    sys.exit(main())
