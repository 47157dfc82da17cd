"""Signed links: a pymavlink peer on a real socket, forgers beside it, and a clock that outlives the process."""

from __future__ import annotations

import asyncio
import os
import socket
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from ridlink.errors import ConfigError, LinkError
from ridlink.links import LinkUrl, Scheme, SigningOptions, open_signed_link, parse_link_url
from ridlink.links.signed import SignedLink
from ridlink.links.signing_clock import SAVED_EVERY_S, open_signing
from ridlink.mavlink.codec import CRC_EXTRAS, Encoder
from ridlink.mavlink.frames import Frame, parse_datagram
from ridlink.mavlink.signing import EPOCH_UTC_S, UNITS_PER_S, Signing
from tests.links.conftest import KEY
from tests.links.ends import PATIENCE_S, UTC_S, Inbox, signed

ANY = parse_link_url("udpin:127.0.0.1:0")


PEER = """
import sys
from pymavlink import mavutil
peer = mavutil.mavlink_connection("udpout:127.0.0.1:" + sys.argv[1], source_system=7)
peer.setup_signing(bytes.fromhex(sys.argv[2]), sign_outgoing=True, allow_unsigned_callback=None)
peer.mav.heartbeat_send(2, 12, 0, 0, 4)
for _ in range(2):
    heard = peer.recv_match(type="HEARTBEAT", blocking=True, timeout=20)
    print(heard.get_signed(), heard.get_link_id())
"""
"""A program of its own: which dialect and version pymavlink speaks is one choice a process."""


async def opened(inbox: Inbox, key_file: Path, url: LinkUrl = ANY, **options: object) -> SignedLink:
    return await open_signed_link(url, inbox, SigningOptions(key_file, **options), utc=lambda: UTC_S)  # type: ignore[arg-type]


def killed(link: SignedLink) -> None:
    """End a link without a word to the file, as kill -9 does."""
    link.clock.release()
    link.close()


def test_f23_what_cannot_be_signed_is_counted_and_does_not_leave(key_file: Path, tmp_path: Path) -> None:
    async def body() -> None:
        link = await opened(Inbox(), key_file, state_file=tmp_path / "ours")
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as peer:
            peer.bind(("127.0.0.1", 0))
            peer.setblocking(False)
            address = peer.getsockname()
            heartbeats = Encoder(1, 1)
            there = signed(heartbeats, Signing(KEY))
            assert not link.send(there, address) and not link.send(b"junk", address)
            assert link.counters["unsignable"] == 2
            assert link.send(there + heartbeats.encode("HEARTBEAT", type=2), address)
            [frame] = parse_datagram(await asyncio.get_running_loop().sock_recv(peer, 65535), CRC_EXTRAS)
            assert isinstance(frame, Frame) and frame.seq == 1 and frame.signature
        link.close()

    asyncio.run(body())


def test_f23_pymavlink_and_we_believe_each_other_over_udp(key_file: Path) -> None:
    async def test() -> None:
        inbox = Inbox()
        link = await open_signed_link(ANY, inbox, SigningOptions(key_file, required=True, link_id=3))
        peer = await asyncio.create_subprocess_exec(
            sys.executable, "-c", PEER, str(link.local_address[1]), KEY.hex(),
            stdout=subprocess.PIPE, env=os.environ | {"MAVLINK20": "1", "MAVLINK_DIALECT": "common"},
        )  # fmt: skip
        try:
            await inbox.count(1, 4 * PATIENCE_S)  # a program that begins
            beat = Encoder(7, 196).encode("HEARTBEAT", type=18)
            link.send(beat + beat)
            said, _ = await asyncio.wait_for(peer.communicate(), PATIENCE_S)
            assert said.split() == [b"True", b"3"] * 2
        finally:
            link.close()

    asyncio.run(test())


@pytest.mark.parametrize("required", [True, False])
def test_f23_what_is_not_signed_or_signed_wrongly_is_counted_and_changes_nothing(
    key_file: Path, required: bool
) -> None:
    async def test() -> None:
        inbox = Inbox()
        link = await opened(inbox, key_file, required=required)
        encoder = Encoder(7, 1)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as peer:
            peer.connect(("127.0.0.1", link.local_address[1]))
            good = Signing(KEY)
            first = signed(encoder, good)
            unsigned, forged = encoder.encode("HEARTBEAT", type=2), signed(encoder, Signing(bytes(32)))
            far_ahead = signed(encoder, Signing(KEY, link_id=2), UTC_S + 3600.0)
            before = link.clock.signing.timestamp
            for datagram in (unsigned, forged, far_ahead, first, first, b"noise" + signed(encoder, good)):
                peer.send(datagram)
            await inbox.count(2 if required else 3)
            causes = {"signature_wrong": 1, "signature_too_new": 1, "signature_replayed": 1}
            if required:
                assert inbox.heard[0] == first and b"noise" not in inbox.heard[1]
                causes |= {"unsigned": 1, "garbage": 1}
            assert dict(link.counters) == causes
            assert link.clock.signing.timestamp <= max(before, int(400_000_000 * UNITS_PER_S) + 10)
        link.close()

    asyncio.run(test())


def test_f23_a_restart_neither_signs_with_old_times_nor_believes_a_recording(key_file: Path) -> None:
    recorded = signed(Encoder(7, 1), Signing(KEY))

    async def live(life: int, utc_s: float) -> tuple[dict[str, int], int]:
        """One life of the program; what it refused, and the last timestamp that it signed with."""
        inbox = Inbox()
        link = await open_signed_link(ANY, inbox, SigningOptions(key_file, required=True), utc=lambda: utc_s)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as peer:
            peer.bind(("127.0.0.1", 0))
            peer.settimeout(PATIENCE_S)
            peer.sendto(recorded, link.local_address)
            new = signed(
                Encoder(9, 1), Signing(KEY, link_id=life), UTC_S + 1.0
            )  # not so late that the clock is kept for it
            peer.sendto(new, link.local_address)
            await inbox.until(lambda: bool(inbox.heard) and inbox.heard[-1] == new)
            link.send(Encoder(1, 196).encode("HEARTBEAT"), peer.getsockname())
            (frame,) = parse_datagram(peer.recv(500), CRC_EXTRAS)
        assert isinstance(frame, Frame)
        link.close()
        return dict(link.counters), int.from_bytes(frame.signature[1:7], "little")

    refused, first = asyncio.run(live(1, UTC_S))
    assert refused == {}
    refused, second = asyncio.run(live(2, 0.0))  # no battery: it is 1970 again
    assert refused == {"signature_replayed": 1}
    assert second > first
    assert (key_file.parent / "key.state").stat().st_mode & 0o777 == 0o600


def test_f23_a_crash_uses_no_timestamp_twice(key_file: Path) -> None:
    async def test() -> None:
        link = await opened(Inbox(), key_file)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as peer:
            peer.bind(("127.0.0.1", 0))
            peer.settimeout(PATIENCE_S)
            link.send(Encoder(1, 196).encode("HEARTBEAT"), peer.getsockname())
            sent = peer.recv(500)
        killed(link)
        again = signed(Encoder(1, 196), open_signing(SigningOptions(key_file)), 0.0)  # no battery: it is 1970 again
        first, second = (int.from_bytes(frame[-12:-6], "little") for frame in (sent, again))
        assert second - first > SAVED_EVERY_S * UNITS_PER_S, "later than all until the file is written again"

    asyncio.run(test())


def test_f23_a_crash_uses_no_timestamp_twice_behind_a_peer_whose_clock_is_ahead(key_file: Path) -> None:
    async def test() -> None:
        writer = ThreadPoolExecutor(1)
        asyncio.get_running_loop().set_default_executor(writer)
        inbox = Inbox()
        link = await opened(inbox, key_file)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as peer:
            peer.bind(("127.0.0.1", 0))
            peer.settimeout(PATIENCE_S)
            peer.sendto(signed(Encoder(7, 1), Signing(KEY), UTC_S + 100.0), link.local_address)
            await inbox.count(1)
            link.send(Encoder(1, 196).encode("HEARTBEAT"))
            sent = peer.recv(500)
        await asyncio.get_running_loop().run_in_executor(writer, lambda: None)  # what was asked of it before is done
        killed(link)
        again = signed(Encoder(1, 196), open_signing(SigningOptions(key_file)))
        first, second = (int.from_bytes(frame[-12:-6], "little") for frame in (sent, again))
        assert first > UNITS_PER_S * (UTC_S - EPOCH_UTC_S + 100.0) and second > first

    asyncio.run(test())


def test_a_clock_belongs_to_one_program_at_a_time(key_file: Path, tmp_path: Path) -> None:
    async def test() -> None:
        first = await opened(Inbox(), key_file)
        with pytest.raises(ConfigError, match=r"key\.state: is the clock of another program.* signing-state"):
            await opened(Inbox(), key_file, link_id=1)
        beside = await opened(Inbox(), key_file, state_file=tmp_path / "other")
        first.close()
        first.close()
        again = await opened(Inbox(), key_file)
        for link in (beside, again):
            link.close()
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
            other.bind(("127.0.0.1", 0))
            with pytest.raises(LinkError):
                await opened(Inbox(), key_file, LinkUrl(Scheme.UDPIN, *other.getsockname()))
        (await opened(Inbox(), key_file)).close()

    asyncio.run(test())
