"""Opens the link to the autopilot, which may be signed."""

from __future__ import annotations

from ridlink.links import Link, LinkUrl, OnDatagram, SigningOptions, open_link, open_signed_link


async def open_vehicle_link(url: LinkUrl, on_datagram: OnDatagram, signing: SigningOptions | None) -> Link:
    """Open the link, signed if there is a key.

    Args:
        url: Connection string.
        on_datagram: Called with each datagram; on a signed link, only if its signature is right.
        signing: How it is signed; None: not at all.

    Raises:
        ConfigError, OSError: If the key or its clock cannot be used.
        MissingExtraError, LinkError: If the port, peer or device cannot be used.
    """
    if signing is None:
        return await open_link(url, on_datagram)
    return await open_signed_link(url, on_datagram, signing)
