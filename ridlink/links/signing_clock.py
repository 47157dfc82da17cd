"""The clock of a link's signatures, in a file that outlives the process.

Restarted without a battery-backed clock, a program would else sign with times that its peers have seen already, and
believe what was recorded before. The file lies beside the key, is written anew every few seconds and moved into place
whole. It runs ahead by more than the time between two writes, and is written at once where that was not enough (a clock
that is set, a peer whose clock is ahead), so that no timestamp is used twice after a crash either. It belongs to one
program at a time: each would put its own streams over the other's.
"""

from __future__ import annotations

import asyncio
import fcntl
import os
import threading
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import msgspec

from ridlink.errors import ConfigError
from ridlink.links.signing_options import SigningOptions, read_key
from ridlink.mavlink.signing import LATEST_CLOCK, UNITS_PER_S, Signing, signing_timestamp

SAVED_EVERY_S = 5.0
AHEAD = 6 * UNITS_PER_S
"""What the file says is later than what was sent by this."""

ROOM = UNITS_PER_S // 10
"""The same as long as nothing was sent or believed that is later than the file said before: ten thousand frames, for
which a program that is started again and again must not run ahead of all others."""


class _State(msgspec.Struct):
    timestamp: int
    streams: list[tuple[int, int, int, int]]


class SigningClock:
    """A clock that is this program's until it is released, and the signatures that are made and judged by it.

    Args:
        options: Where key and clock are.
        utc: Seconds since 1970.

    Attributes:
        signing: Signs and judges; after either, `keep_up` is due.

    Raises:
        ConfigError: If the key or the clock cannot be used, or another program has the clock.
        OSError: If the key cannot be read, or the clock not be kept: a fault now, not after the flight.
    """

    def __init__(self, options: SigningOptions, utc: Callable[[], float]) -> None:
        read_key(options.key_file)  # before anything is written beside it
        self._file, self._utc = options.state, utc
        self._claim: int | None = claim_clock(options.state)
        self._saving = threading.Lock()
        self._asked = self._saved = 0
        self._counters: Counter[str] = Counter()
        self._timer: asyncio.TimerHandle | None = None
        try:
            self.signing = open_signing(options)
            self._found = self._kept = self.signing.timestamp
            save_signing(self._file, self._state())
        except BaseException:
            self.release()
            raise

    def run(self, counters: Counter[str]) -> None:
        """Keep the clock from now on, every few seconds.

        Args:
            counters: Where a write that fails is counted, as `signing_clock_not_kept`.
        """
        self._counters = counters
        self._keep_later()

    def keep_up(self) -> None:
        """Keep the clock now if it has overtaken what the file says."""
        if self.signing.timestamp > self._kept:
            self._keep()

    def close(self) -> None:
        """Keep the clock as it stands, and release it; may be called twice."""
        if self._claim is not None:
            self._save(self._asked + 1, self._state(last=True))
            self.release()

    def release(self) -> None:
        """Leave the file as it is, as a crash would, and the clock to others; may be called twice."""
        if self._timer is not None:
            self._timer.cancel()
        if self._claim is not None:
            os.close(self._claim)
        self._claim = None

    def _keep(self) -> None:
        """Keep the clock, in a thread: a slow disk must not keep the loop."""
        self._asked += 1
        asyncio.get_running_loop().run_in_executor(None, self._save, self._asked, self._state())
        self._keep_later()

    def _keep_later(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
        self._timer = asyncio.get_running_loop().call_later(SAVED_EVERY_S, self._keep)

    def _state(self, *, last: bool = False) -> bytes:
        signing = self.signing
        ours, latest = signing_timestamp(self._utc()), signing.timestamp
        if not last:
            ours, latest = ours + AHEAD, latest + (AHEAD if latest > self._found else ROOM)
        self._kept = min(max(ours, latest), LATEST_CLOCK)
        return msgspec.json.encode(_State(self._kept, [(*stream, at) for stream, at in signing.streams.items()]))

    def _save(self, number: int, content: bytes) -> None:
        with self._saving:
            if number < self._saved:  # a thread that was overtaken
                return
            self._saved = number
            try:
                save_signing(self._file, content)
            except OSError:
                self._counters["signing_clock_not_kept"] += 1


def open_signing(options: SigningOptions) -> Signing:
    """Key and clock as they were left.

    Raises:
        ConfigError: If the key is none, others can read it, or the state is damaged: then nobody knows what was sent.
        OSError: If the key cannot be read.
    """
    key = read_key(options.key_file)
    try:
        state = msgspec.json.decode(options.state.read_bytes(), type=_State)
    except FileNotFoundError:
        state = _State(0, [])
    except (msgspec.MsgspecError, UnicodeDecodeError) as error:
        raise ConfigError(
            f"{options.state}: is damaged ({error}); remove it if nobody can have recorded this link"
        ) from error
    if not 0 <= state.timestamp <= LATEST_CLOCK:
        raise ConfigError(f"{options.state}: holds a time that cannot be; remove it")
    try:
        streams = {(sysid, compid, link): at for sysid, compid, link, at in state.streams}
        return Signing(key, link_id=options.link_id, timestamp=state.timestamp, streams=streams)
    except ValueError as error:
        raise ConfigError(f"signing: {error}") from error


def claim_clock(state: Path) -> int:
    """Keep other programs from a clock until the handle is closed, or this one ends in whatever way.

    Raises:
        ConfigError: If another program, or another link of this one, has it.
        OSError: If it cannot be kept.
    """
    handle = os.open(state.with_name(state.name + ".lock"), os.O_RDWR | os.O_CREAT, 0o600)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        os.close(handle)
        if not isinstance(error, BlockingIOError):
            raise
        raise ConfigError(
            f"{state}: is the clock of another program that signs; give this one its own with signing-state"
        ) from error
    return handle


def save_signing(path: Path, content: bytes) -> None:
    """Put the state into its place, whole or not at all.

    Raises:
        OSError: If that is not possible.
    """
    draft = path.with_name(path.name + ".new")
    handle = os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
    with os.fdopen(handle, "wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())
    os.replace(draft, path)
