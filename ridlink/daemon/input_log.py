"""A log of all inputs of an engine, in order and with times, so that the decisions of a flight can be replayed.

A tlog has the bytes on the wire. It does not have the link, the times of steps, or the clock of the daemon, and
decisions depend on all three. This log has them: MessagePack, one array per record, written by a thread of its own.

    ["ridlink-input", 2, configuration as TOML]
    ["v" | "a", now_s, utc_s or nil, address or nil, bytes]     a datagram of the vehicle link, of the air
    ["s", now_s, hold, warm, utc_s or nil]                      a step, which may have failed; whether the loop stood
                                                                still before it, and whether decisions could be made
    ["t", seconds]                                              what it took to compute, which RIDLINK_STATUS tells
    ["e", now_s]                                                the end of the stream
    ["d", steps, hash]                                          of the decisions, see `decision_log`; last
"""

from __future__ import annotations

import contextlib
import os
import queue
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Annotated, BinaryIO

import msgspec

from ridlink.daemon.config import daemon_config
from ridlink.daemon.config_file import LONGEST, read_config_text
from ridlink.engine import Engine, StepOutput
from ridlink.engine.decision_log import DecisionHash, decision_line
from ridlink.errors import CaptureError
from ridlink.files import open_at_once

MAGIC, VERSION = "ridlink-input", 2
QUEUE_LENGTH = 65_536
"""Records: five seconds of the heaviest traffic that a daemon is designed for."""
LONGEST_RECORD = 4 * LONGEST
"""Bytes: the first record contains the configuration as text."""

Seconds = Annotated[float, msgspec.Meta(ge=-1e18, le=1e18)]
"""Time of a clock; a number, not NaN."""


class _Head(msgspec.Struct, array_like=True, tag=MAGIC, frozen=True):
    version: int
    config: str


class _Datagram(msgspec.Struct, array_like=True, frozen=True):
    now_s: Seconds
    utc_s: Seconds | None
    source: tuple[str | int, ...] | None
    data: bytes


class FromVehicle(_Datagram, tag="v", frozen=True):
    """A datagram of the vehicle link."""


class FromAir(_Datagram, tag="a", frozen=True):
    """A datagram of the link on which others are received."""


class _Step(msgspec.Struct, array_like=True, tag="s", frozen=True):
    now_s: Seconds
    hold: bool
    warm: bool
    utc_s: Seconds | None


class _Took(msgspec.Struct, array_like=True, tag="t", frozen=True):
    seconds: Seconds


class _End(msgspec.Struct, array_like=True, tag="e", frozen=True):
    now_s: Seconds


class _Decided(msgspec.Struct, array_like=True, tag="d", frozen=True):
    steps: int
    digest: str


_Record = _Head | FromVehicle | FromAir | _Step | _Took | _End | _Decided
_encode = msgspec.msgpack.Encoder().encode
_decode = msgspec.msgpack.Decoder(_Record).decode


class InputLog:
    """Writes the inputs of an engine.

    Args:
        path: The file; replaced.
        config: Configuration of the daemon, as TOML.

    Attributes:
        dropped: Records lost because the disk was too slow: the flight can then not be replayed.
        error: The error that ended the log, such as a full disk.
        decisions: Hash of the decisions so far.

    Raises:
        OSError: If the file cannot be made.
    """

    def __init__(self, path: Path, config: str) -> None:
        self.dropped = 0
        self.error: OSError | None = None
        self.decisions = DecisionHash()
        self._file = open_at_once(path, "wb")
        self._queue: queue.Queue[_Record | None] = queue.Queue(QUEUE_LENGTH)
        self._put(_Head(VERSION, config))
        self._thread = threading.Thread(target=self._run, name="input-log", daemon=True)
        self._thread.start()

    def heard(self, datagram: FromVehicle | FromAir) -> None:
        """Record a datagram, before the engine gets it."""
        self._put(datagram)

    def step(self, now_s: float, hold: bool, warm: bool, utc_s: float | None) -> None:
        """Record a step, before the engine takes it, so that a failing step is replayed, too."""
        self._put(_Step(now_s, hold, warm, utc_s))

    def decided(self, output: StepOutput, reason: str) -> None:
        """Record the result of the step."""
        self.decisions.add(decision_line(output, reason))

    def took(self, seconds: float) -> None:
        """Record the duration of the last step."""
        self._put(_Took(seconds))

    def stop(self, now_s: float) -> None:
        """Record the end of the stream."""
        self._put(_End(now_s))

    def close(self, longest_s: float) -> None:
        """Write what is queued, within this time at most [s]."""
        self._put(_Decided(self.decisions.steps, self.decisions.digest))
        with contextlib.suppress(queue.Full):
            self._queue.put(None, timeout=longest_s)
            self._thread.join(longest_s)

    def _put(self, record: _Record) -> None:
        if self.error is not None:
            return
        try:
            self._queue.put_nowait(record)
        except queue.Full:
            self.dropped += 1

    def _run(self) -> None:
        try:
            with self._file as file:
                while (record := self._queue.get()) is not None:
                    data = _encode(record)
                    file.write(len(data).to_bytes(4, "little") + data)
                file.flush()
        except OSError as error:
            self.error = error
            while self._queue.get() is not None:
                continue


def read_records(file: BinaryIO, name: str) -> Iterator[_Record]:
    """Records of an input log, up to the first incomplete one.

    Raises:
        CaptureError: If it is no input log.
    """
    while len(head := file.read(4)) == 4:
        length = int.from_bytes(head, "little")
        if length > LONGEST_RECORD:
            raise CaptureError(f"{name}: is no input log of ridlink avoid, or a damaged one")
        data = file.read(length)
        if len(data) < length:
            return
        try:
            yield _decode(data)
        except (msgspec.DecodeError, UnicodeDecodeError) as error:
            raise CaptureError(f"{name}: is no input log of ridlink avoid, or a damaged one: {error}") from error


def replay(path: str | os.PathLike[str], on_line: Callable[[bytes], None] | None = None) -> tuple[DecisionHash, str]:
    """Replay the decisions of a recorded flight.

    Args:
        path: Its input log.
        on_line: Called with the line of every step.

    Returns:
        The hash of these decisions, and that of the flight, which is empty if the log ends early.

    Raises:
        CaptureError: If it is no input log, or one of another version.
        OSError: If it cannot be read.
    """
    name, decisions, flown = os.fspath(path), DecisionHash(), ""
    with open(path, "rb") as file:
        records = read_records(file, name)
        head = next(records, None)
        if not isinstance(head, _Head) or head.version != VERSION:
            raise CaptureError(f"{name}: is no input log of ridlink avoid of version {VERSION}")
        engine = Engine(daemon_config(read_config_text(head.config, name)).engine)
        for record in records:
            match record:
                case FromVehicle(now_s, utc_s, source, data):
                    with contextlib.suppress(Exception):  # as in the link
                        engine.receive_vehicle(data, now_s, source=source, utc_s=utc_s)
                case FromAir(now_s, utc_s, source, data):
                    with contextlib.suppress(Exception):
                        engine.receive_remote_id(data, now_s, source=source, utc_s=utc_s)
                case _Step(now_s, hold, warm, utc_s):
                    engine.warm = warm
                    if hold:
                        engine.hold_next()
                    try:
                        output = engine.step(now_s, utc_s=utc_s)
                    except Exception:  # as in the daemon: a step that fails decides nothing
                        continue
                    line = decision_line(output, engine.rung.reason)
                    decisions.add(line)
                    if on_line is not None:
                        on_line(line)
                case _Took(seconds):
                    engine.note_decision_time(seconds)
                case _End(now_s):
                    engine.stop(now_s)
                case _Decided(_, digest):
                    flown = digest
                case _Head():
                    raise CaptureError(f"{name}: is a damaged input log: it begins twice")
    return decisions, flown
