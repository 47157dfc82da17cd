"""A link whose frames are signed: what leaves is signed, and what comes is heard only if its signature is right.

The signature is checked before anybody reads a frame; a forger moves no clock and costs one hash. Where signatures are
not required, unsigned frames pass and wrongly signed ones do not.

What was sent and believed last outlives the process: a file beside the key, written anew every few seconds and moved
into place whole. Restarted without a battery-backed clock, a program would else sign with times that its peers have
seen already, and believe what was recorded before. The file runs ahead by more than the time between two writes, and
is written at once where that was not enough (a clock that is set, a peer whose clock is ahead), so that no timestamp is
used twice after a crash either. It belongs to one program at a time: each would put its own streams over the other's.
"""

from __future__ import annotations

import asyncio
import contextlib
import fcntl
import os
import stat
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import msgspec

from ridlink.errors import ConfigError
from ridlink.links.link import Address, Link, OnDatagram
from ridlink.links.opening import open_link
from ridlink.links.url import LinkUrl
from ridlink.mavlink.codec import CRC_EXTRAS
from ridlink.mavlink.frames import BadFrame, parse_datagram
from ridlink.mavlink.signing import KEY_LENGTH, LATEST_CLOCK, UNITS_PER_S, SignatureCause, Signing, signing_timestamp

SAVED_EVERY_S = 5.0
AHEAD = 6 * UNITS_PER_S
"""What the file says is later than what was sent by this."""

ROOM = UNITS_PER_S // 10
"""The same as long as nothing was sent or believed that is later than the file said before: ten thousand frames, for
which a program that is started again and again must not run ahead of all others."""


@dataclass(frozen=True, slots=True)
class SigningOptions:
    """How a link is signed.

    Args:
        key_file: 32 bytes, or 64 hexadecimal digits, in a file that only its owner can read.
        required: Refuse what is not signed.
        link_id: Of our own signatures; every link that one component speaks on has its own.
        state_file: Where the clock is kept; None: beside the key, with `.state` after its name.
    """

    key_file: Path
    required: bool = False
    link_id: int = 0
    state_file: Path | None = None

    @classmethod
    def of(
        cls,
        signing_key: str | None,
        require_signature: bool | None = None,
        signing_link_id: int | None = None,
        signing_state: str | None = None,
    ) -> SigningOptions | None:
        """As the keys of a configuration say; None: not signed at all.

        Raises:
            ConfigError: If they do not go together.
        """
        if signing_key is None:
            if require_signature or signing_state is not None or signing_link_id is not None:
                raise ConfigError("require-signature, signing-link-id and signing-state need a key: give signing-key")
            return None
        link_id = signing_link_id or 0
        if not 0 <= link_id <= 255:
            raise ConfigError(f"signing-link-id must be between 0 and 255, got {link_id}")
        state = None if signing_state is None else Path(signing_state)
        return cls(Path(signing_key), bool(require_signature), link_id, state)

    @property
    def state(self) -> Path:
        """Where the clock is kept."""
        return self.key_file.with_name(self.key_file.name + ".state") if self.state_file is None else self.state_file


class _State(msgspec.Struct):
    timestamp: int
    streams: list[tuple[int, int, int, int]]


def read_key(path: Path) -> bytes:
    """The key in a file.

    Raises:
        ConfigError: If others can read it, or it is no key.
        OSError: If it cannot be read.
    """
    with path.open("rb") as file:
        status = os.fstat(file.fileno())  # of what is read, not of what the name led to a moment ago
        if not stat.S_ISREG(status.st_mode) or stat.S_IMODE(status.st_mode) not in (0o600, 0o400):
            raise ConfigError(f"{path}: a signing key must be a file of mode 0600; chmod 600 {path}")
        if status.st_uid not in (os.geteuid(), 0):
            raise ConfigError(f"{path}: a signing key must belong to who uses it; chown it")
        content = file.read(4 * KEY_LENGTH)
    if len(content) == KEY_LENGTH:
        return content
    with contextlib.suppress(ValueError):
        if len(key := bytes.fromhex(content.decode("ascii", "replace").strip())) == KEY_LENGTH:
            return key
    raise ConfigError(
        f"{path}: a signing key has {KEY_LENGTH} bytes or {2 * KEY_LENGTH} hexadecimal digits; make one with "
        f"(umask 077; head -c {KEY_LENGTH} /dev/urandom > {path})"
    )


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


class SignedLink(Link):
    """A link round another one; made by `open_signed_link`."""

    def __init__(
        self, on_datagram: OnDatagram, options: SigningOptions, signing: Signing, utc: Callable[[], float], claim: int
    ) -> None:
        super().__init__(on_datagram)
        self._options, self._signing, self._utc, self._claim = options, signing, utc, claim
        self._inner: Link | None = None
        self._found = self._kept = signing.timestamp
        self._closed = False
        self._saving = threading.Lock()
        self._asked = self._saved = 0
        self._timer: asyncio.TimerHandle | None = None

    def _use(self, inner: Link) -> None:
        self._inner, self.local_address = inner, inner.local_address
        self.counters = inner.counters
        self._timer = asyncio.get_running_loop().call_later(SAVED_EVERY_S, self._keep)

    def _keep(self) -> None:
        """Keep the clock, in a thread: a slow disk must not keep the loop."""
        if self._timer is not None:
            self._timer.cancel()
        loop = asyncio.get_running_loop()
        self._asked += 1
        loop.run_in_executor(None, self._save, self._asked, self._state())
        self._timer = loop.call_later(SAVED_EVERY_S, self._keep)

    def _keep_up(self) -> None:
        """Keep the clock now if it has overtaken what the file says."""
        if self._signing.timestamp > self._kept:
            self._keep()

    def _state(self, *, last: bool = False) -> bytes:
        signing = self._signing
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
                save_signing(self._options.state, content)
            except OSError:
                self.counters["signing_clock_not_kept"] += 1

    def _receive(self, data: bytes, address: Address) -> None:
        utc_s, good, refused = self._utc(), [], 0
        for found in parse_datagram(data, CRC_EXTRAS):
            if isinstance(found, BadFrame):
                if self._options.required:
                    self.counters[found.cause] += 1
                    refused += 1
                continue
            cause = self._signing.refusal(found, utc_s)
            if cause is None or (cause is SignatureCause.UNSIGNED and not self._options.required):
                good.append(found.raw)
            else:
                self.counters[cause] += 1
                refused += 1
        self._keep_up()
        if not (refused or self._options.required):
            self._deliver(data, address)
        elif good:
            self._deliver(b"".join(good), address)

    def send(self, data: bytes, address: Address | None = None) -> bool:
        """Sign every frame and send them; see `Link.send`."""
        if self._inner is None or self._closed:
            return False
        utc_s = self._utc()
        signed = [
            self._signing.sign(found.raw, CRC_EXTRAS[found.msgid], utc_s)
            for found in parse_datagram(data, CRC_EXTRAS)
            if not isinstance(found, BadFrame) and found.checked
        ]
        self._keep_up()
        return self._inner.send(b"".join(signed), address)

    def close(self) -> None:
        """Release the port and keep the clock as it stands."""
        if self._timer is not None:
            self._timer.cancel()
        if self._inner is not None:
            self._inner.close()
        if self._closed:
            return
        self._closed = True
        if self._inner is not None:
            self._save(self._asked + 1, self._state(last=True))
        os.close(self._claim)


async def open_signed_link(
    url: LinkUrl, on_datagram: OnDatagram, options: SigningOptions, *, utc: Callable[[], float] = time.time
) -> SignedLink:
    """Open a link whose frames are signed.

    Args:
        url: Where to.
        on_datagram: As for `open_link`; it sees what is believed.
        options: How it is signed.
        utc: Seconds since 1970.

    Raises:
        ConfigError: If the key or its state cannot be used.
        MissingExtraError: As `open_link`.
        LinkError: If the port, peer or device cannot be used.
        OSError: If the key cannot be read, or the clock not be kept.
    """
    read_key(options.key_file)  # before anything is written beside it
    claim = claim_clock(options.state)
    try:
        link = SignedLink(on_datagram, options, open_signing(options), utc, claim)
        save_signing(options.state, link._state())  # a clock that cannot be kept is a fault now, not after the flight
        link._use(await open_link(url, link._receive))
    except BaseException:
        os.close(claim)
        raise
    return link
