"""Give the readers of captures bytes that nobody meant: ``python -m tests.soak.fuzz [INPUTS]`` (1,000,000 unless said).

Inputs are random bytes, valid captures of every format, made here, and their JSON lines, with damage. Each goes through
every reader, whole and in pieces; what comes out is decoded and written as lines, and the lines of inputs are encoded.
Ends with 1 where a reader raises anything but `CaptureError`, or the encoder anything but `WireError`, an input takes
more than 5 s of CPU time, or memory grows by more than 50 MB.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import random
import signal
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from ridlink.captures import Capture, CaptureKind, columns, decode_records
from ridlink.captures.export.block_lines import BlockLines
from ridlink.captures.export.framed import framed_line
from ridlink.captures.export.from_lines import frame_of_line
from ridlink.captures.export.selection import Selection
from ridlink.captures.fast import datagrams
from ridlink.captures.fast.blocks import BlockReader
from ridlink.captures.lines import json_line, table_line
from ridlink.errors import CaptureError, WireError
from ridlink.mavlink.codec import Encoder
from tests.captures.conftest import flight, tlog_bytes
from tests.captures.pcap_files import ethernet, ipv4, ipv6, pcap, pcapng, timed, udp
from tests.soak.__main__ import resident_mb

INPUTS = 1_000_000
HANG_S = 5.0
"""CPU time: the machine may have others to serve."""
SHOWN_BYTES = 200
GROWTH_MB = 50.0
WARM_UP = 2_000
"""Inputs before memory counts: caches fill and libraries are imported."""
BLOCKS_EVERY = 50
"""The compiled reader and writer take paths and large buffers, and get one input in so many."""
PROGRESS_EVERY = 500

KINDS = (*CaptureKind, None)
INTERESTING = (b"\x00", b"\xff", b"\xfd", b"\xfe", b"\xff\xff\xff\xff", b"\x00\x00\x00\x00", b"\x80", b"\x7f", b"\n")


class Hang(Exception):
    """An input takes too long."""


def seeds() -> list[bytes]:
    """Valid captures of every format."""
    records = flight(8)
    frames = [frame for _, frame in records]
    pack = b"".join(bytes((kind << 4 | 2,)) + bytes(range(24)) for kind in (0, 1, 3, 4, 5))
    message_pack = b"\xf2\x19\x05" + pack
    tunnel = Encoder(3, 1).encode("OPEN_DRONE_ID_MESSAGE_PACK", single_message_size=25, msg_pack_size=5, messages=pack)
    beacon = (
        b"\x80\x00\x00\x00" + b"\xff" * 6 + b"\x02\x00\x00\x00\x00\x01" * 2 + b"\x00\x00" + bytes(8) + b"\x64\x00"
        + b"\x21\x04\xdd" + bytes((5 + len(message_pack),)) + b"\xfa\x0b\xbc\x0d\x07" + message_pack
    )  # fmt: skip
    service = b"\x16\xfa\xff\x0d\x07" + pack[:25]
    advertisement = bytes((len(service),)) + service
    bluetooth = b"\xd6\xbe\x89\x8e\x02" + bytes((6 + len(advertisement),)) + bytes(6) + advertisement + bytes(3)
    network = timed([ethernet(ipv4(udp(frame))) for frame in [*frames, tunnel]])
    return [
        tlog_bytes([*records, (records[-1][0], tunnel)]),
        b"".join([*frames, tunnel]),
        b"".join(frame.hex().encode() + b"\n" for frame in frames) + message_pack.hex(":").encode() + b" # a pack\n",
        pcap(network),
        pcap(network, order=">", nanoseconds=True),
        pcap(timed([ipv6(udp(frame)) for frame in frames]), 101),
        pcapng(network),
        pcapng(network, order=">"),
        pcap(timed([beacon] * 3), 105),
        pcapng(timed([b"\x00\x00\x08\x00" + bytes(4) + beacon] * 3), 127),
        pcap(timed([bluetooth] * 3), 251),
        pcapng(timed([bytes(8) + b"\x01\x00" + bluetooth] * 3), 256),
    ]


def mutated(data: bytes, others: list[bytes], rng: random.Random) -> bytes:
    """A capture with one to eight kinds of damage."""
    found = bytearray(data)
    for _ in range(rng.randint(1, 8)):
        at = rng.randrange(len(found) + 1)
        end = min(at + rng.choice((1, 1, 2, 4, 8, 25, 300)), len(found))
        match rng.randrange(7):
            case 0 if found:
                found[at % len(found)] ^= 1 << rng.randrange(8)
            case 1:
                value = rng.choice(INTERESTING)
                found[at : at + len(value)] = value
            case 2:
                del found[at:end]
            case 3:
                found[at:at] = rng.randbytes(end - at)
            case 4:
                found[at:at] = found[at:end] * rng.randint(1, 8)
            case 5 if rng.random() < 0.3:
                del found[at:]
            case 6 if rng.random() < 0.3:
                other = rng.choice(others)
                found[at:] = other[rng.randrange(len(other)) :]
    return bytes(found)


def input_of(seed: int, index: int, valid: list[bytes]) -> tuple[bytes, random.Random]:
    """The input of this number, and what chooses how it is cut into pieces; the same whatever came before."""
    rng = random.Random(seed << 32 | index)
    if rng.random() < 0.1:
        data = rng.randbytes(rng.randrange(600))
        return rng.choice((b"", rng.choice(valid)[:24])) + data, rng
    return mutated(rng.choice(valid), valid, rng), rng


class Pieces(io.BytesIO):
    """A file that comes in pieces."""

    def __init__(self, data: bytes, length: int) -> None:
        super().__init__(data)
        self._length = length

    def read1(self, size: int | None = -1, /) -> bytes:
        return super().read1(self._length)


def read(make: Callable[[], Capture]) -> int:
    """Messages of a capture, each written as lines; none where it is no capture."""
    count = 0
    try:
        for record in decode_records(make()):
            count += 1
            json_line(record)
            table_line(record)
    except CaptureError:
        pass
    return count


def read_all(data: bytes, rng: random.Random) -> int:
    """The input through the readers of every kind, and through the one that its content asks for."""
    length = rng.choice((7, 64, 1000, 1 << 20))
    return sum(read(lambda kind=kind: Capture("input", Pieces(data, length), kind)) for kind in KINDS)


def read_blocks(data: bytes, path: Path) -> None:
    """The input through the compiled reader, as columns and as lines."""
    path.write_bytes(data)
    for kind in ("auto", "tlog", "mavlink"):
        with contextlib.suppress(CaptureError):
            columns.decode(path, kind=kind)
        with contextlib.suppress(CaptureError):
            forms = BlockLines(Selection(), frames=kind == "tlog"), BlockLines(Selection(), "table")
            for block in BlockReader(path, kind):
                for lines in forms:
                    lines.of(block)


def read_lines(data: bytes) -> None:
    """The lines of the input through the encoder."""
    for line in data.splitlines():
        with contextlib.suppress(WireError):
            frame_of_line(line)


def as_lines(capture: bytes) -> bytes:
    """A capture as JSON lines, one with and one without its frame in turn."""
    records = decode_records(Capture("seed", io.BytesIO(capture), None))
    lines = [(json_line(record), record) for record in records]
    return b"".join(framed_line(line, record) if at % 2 else line for at, (line, record) in enumerate(lines))


def show_progress(done: int, of: int, start_s: float) -> None:
    rate = done / (time.monotonic() - start_s)
    sys.stderr.write(f"\r{done / of:4.0%}  {done:,} inputs, {rate:,.0f} per s\x1b[K")
    sys.stderr.flush()


def fuzz(seed: int, numbers: range) -> int:
    """Exit code."""
    datagrams.FEWEST = 1  # for inputs are short
    valid = seeds()
    for data in valid:
        if not read(lambda data=data: Capture("seed", io.BytesIO(data), None)):
            print(f"a capture made to be valid is none: {data.hex()}")
            return 1
    valid += [as_lines(valid[0]), as_lines(valid[-1])]

    def hang(*_: object) -> None:
        raise Hang(f"took more than {HANG_S:g} s")

    signal.signal(signal.SIGPROF, hang)
    failures: list[str] = []
    messages, first_mb, slowest_s, done = 0, 0.0, 0.0, 0
    start_s = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "input"
        for done, index in enumerate(numbers, 1):
            data, rng = input_of(seed, index, valid)
            began_s = time.process_time()
            signal.setitimer(signal.ITIMER_PROF, 60.0 if done == 1 else HANG_S)  # the first one may compile
            try:
                messages += read_all(data, rng)
                read_lines(data)
                if (index - numbers.start) % BLOCKS_EVERY == 0:
                    read_blocks(data, path)
            except Exception as error:
                failures.append(f"input {index}: {type(error).__name__}: {error}")
                print(f"{failures[-1]} (--seed {seed} --first {index} 1)", file=sys.stderr)
                print(f"  {len(data):,} bytes: {data[:SHOWN_BYTES].hex()}", file=sys.stderr)
            finally:
                signal.setitimer(signal.ITIMER_PROF, 0)
            if done > 1:
                slowest_s = max(slowest_s, time.process_time() - began_s)
            if done == min(WARM_UP, len(numbers)):
                first_mb = resident_mb()
            if sys.stderr.isatty() and done % PROGRESS_EVERY == 0:
                show_progress(done, len(numbers), start_s)
    if sys.stderr.isatty():
        sys.stderr.write("\r\x1b[K")
    grown_mb = resident_mb() - first_mb
    failed = bool(failures) or grown_mb > GROWTH_MB
    print(
        f"seed {seed}: {done:,} inputs, {messages:,} messages, {len(failures)} failed, "
        f"slowest {slowest_s * 1000:.0f} ms, memory grew by {grown_mb:.1f} MB, {time.monotonic() - start_s:.0f} s"
    )
    return 1 if failed else 0


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m tests.soak.fuzz", description="Damaged captures for every reader.")
    parser.add_argument("inputs", nargs="?", type=int, default=INPUTS, help="how many")
    parser.add_argument("--seed", type=int, default=random.SystemRandom().randrange(1 << 31), help="to see it again")
    parser.add_argument("--first", type=int, default=0, help="number of the first input")
    options = parser.parse_args()
    if options.inputs < 1 or options.first < 0 or options.seed < 0:
        parser.error("numbers cannot be negative, and one input is the least")
    return fuzz(options.seed, range(options.first, options.first + options.inputs))


if __name__ == "__main__":
    sys.exit(main())
