"""A link with signed frames: sent frames are signed, and received frames are delivered only if their signature is
right.

The signature is checked before a frame is read, so a forger cannot move the clock and costs one hash. If signatures are
not required, unsigned frames pass, but wrongly signed ones do not. The clock of the signatures is kept in a file, see
`signing_clock`.
"""

from __future__ import annotations

import time
from collections.abc import Callable

from ridlink.links.link import Address, Link, OnDatagram
from ridlink.links.opening import open_link
from ridlink.links.signing_clock import SigningClock
from ridlink.links.signing_options import SigningOptions
from ridlink.links.url import LinkUrl
from ridlink.mavlink.codec import CRC_EXTRAS
from ridlink.mavlink.frames import BadFrame, parse_datagram
from ridlink.mavlink.signing import SignatureCause


class SignedLink(Link):
    """A link that wraps another one; made by `open_signed_link`.

    Attributes:
        clock: Clock of its signatures.
    """

    def __init__(self, on_datagram: OnDatagram, clock: SigningClock, utc: Callable[[], float], required: bool) -> None:
        super().__init__(on_datagram)
        self.clock = clock
        self._utc, self._required = utc, required
        self._inner: Link | None = None
        self._closed = False

    async def _open(self, url: LinkUrl) -> None:
        self._inner = inner = await open_link(url, self._receive)
        self.local_address, self.counters = inner.local_address, inner.counters
        self.clock.run(inner.counters)

    def _receive(self, data: bytes, address: Address) -> None:
        utc_s, good, refused = self._utc(), [], 0
        for found in parse_datagram(data, CRC_EXTRAS):
            if isinstance(found, BadFrame):
                if self._required:
                    self.counters[found.cause] += 1
                    refused += 1
                continue
            cause = self.clock.signing.refusal(found, utc_s)
            if cause is None or (cause is SignatureCause.UNSIGNED and not self._required):
                good.append(found.raw)
            else:
                self.counters[cause] += 1
                refused += 1
        self.clock.keep_up()
        if not (refused or self._required):
            self._deliver(data, address)
        elif good:
            self._deliver(b"".join(good), address)

    def send(self, data: bytes, address: Address | None = None) -> bool:
        """Sign every frame and send them; see `Link.send`. Frames that cannot be signed are counted and not sent."""
        if self._inner is None or self._closed:
            return False
        utc_s, signed = self._utc(), []
        for found in parse_datagram(data, CRC_EXTRAS, limit=None):
            if isinstance(found, BadFrame) or not found.checked or found.version == 1 or found.signature:
                self.counters["unsignable"] += 1
            else:
                signed.append(self.clock.signing.sign(found.raw, CRC_EXTRAS[found.msgid], utc_s))
        self.clock.keep_up()
        return bool(signed) and self._inner.send(b"".join(signed), address)

    def close(self) -> None:
        """Release the port and save the clock."""
        self._closed = True
        if self._inner is not None:
            self._inner.close()
        self.clock.close()


async def open_signed_link(
    url: LinkUrl, on_datagram: OnDatagram, options: SigningOptions, *, utc: Callable[[], float] = time.time
) -> SignedLink:
    """Open a link whose frames are signed.

    Args:
        url: Where to.
        on_datagram: As for `open_link`; it gets only frames that are believed.
        options: How it is signed.
        utc: Seconds since 1970.

    Raises:
        ConfigError: If the key or its clock cannot be used.
        MissingExtraError: As `open_link`.
        LinkError: If the port, peer or device cannot be used.
        OSError: If the key cannot be read, or the clock cannot be saved.
    """
    clock = SigningClock(options, utc)
    link = SignedLink(on_datagram, clock, utc, options.required)
    try:
        await link._open(url)
    except BaseException:
        clock.release()
        raise
    return link
