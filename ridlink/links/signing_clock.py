"""The clock of a link's signatures, kept in a file so that it survives a restart.

Without this file, a program that restarts without a battery-backed clock would sign with times that its peers have
already seen, and believe replayed frames. The file is beside the key. It is written every few seconds and replaced as a
whole. Its time runs ahead by more than the time between two writes. If that is not enough (a clock is set, or a peer's
clock is ahead), it is written at once. So no timestamp is used twice, even after a crash. Only one program at a time
may use the file: two would overwrite each other's streams.
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
"""The file's time is later than the last sent timestamp by this much."""

ROOM = UNITS_PER_S // 10
"""The smaller lead that is used until a timestamp later than the one found in the file was sent or believed: room for
ten thousand frames. So a program that restarts again and again does not run ahead of all others."""


class _State(msgspec.Struct):
    timestamp: int
    streams: list[tuple[int, int, int, int]]


class SigningClock:
    """A clock that this program owns until it is released, and the signatures that use it.

    Args:
        options: Files of key and clock.
        utc: Seconds since 1970.

    Attributes:
        signing: Signs and verifies; call `keep_up` after either.

    Raises:
        ConfigError: If the key or the clock cannot be used, or another program has the clock.
        OSError: If the key cannot be read, or the clock cannot be saved: this shows now, not after the flight.
    """

    def __init__(self, options: SigningOptions, utc: Callable[[], float]) -> None:
        read_key(options.key_file)  # before any file is written beside it
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
        """Save the clock from now on, every few seconds.

        Args:
            counters: Counts failed writes, as `signing_clock_not_kept`.
        """
        self._counters = counters
        self._keep_later()

    def keep_up(self) -> None:
        """Save the clock now if it has overtaken the time in the file."""
        if self.signing.timestamp > self._kept:
            self._keep()

    def close(self) -> None:
        """Save the clock and release it; may be called twice."""
        if self._claim is not None:
            self._save(self._asked + 1, self._state(last=True))
            self.release()

    def release(self) -> None:
        """Release the clock without saving it, as after a crash; may be called twice."""
        if self._timer is not None:
            self._timer.cancel()
        if self._claim is not None:
            os.close(self._claim)
        self._claim = None

    def _keep(self) -> None:
        """Save the clock in a thread, since a slow disk must not block the loop."""
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
            if number < self._saved:  # a newer thread was faster
                return
            self._saved = number
            try:
                save_signing(self._file, content)
            except OSError:
                self._counters["signing_clock_not_kept"] += 1


def open_signing(options: SigningOptions) -> Signing:
    """Key and clock as last saved.

    Raises:
        ConfigError: If the key is invalid, others can read it, or the state is damaged, so that the last timestamp is
            unknown.
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
    """Lock a clock against other programs until the handle is closed or this program ends in any way.

    Raises:
        ConfigError: If another program, or another link of this one, has it.
        OSError: If the lock file cannot be opened or locked.
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
    """Write the state, completely or not at all.

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
