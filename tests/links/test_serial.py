"""Serial links on pseudo-terminals: frames whole, devices that go and come, and no setpoint that is stale."""

from __future__ import annotations

import asyncio
import os
import random
import sys
import termios
from pathlib import Path
from typing import Any

import pytest

from ridlink.errors import LinkError, MissingExtraError
from ridlink.links import Link, SigningOptions, open_link, open_signed_link, parse_link_url
from ridlink.links import serial as serial_links
from ridlink.mavlink.codec import CRC_EXTRAS
from ridlink.mavlink.frames import Frame, parse_datagram
from tests.links.cable import Plugged, null_modem, plugged
from tests.links.ends import Inbox, counted, heartbeat
from tests.loopback import run, turn

BAUD = 57600


def url_of(device: Plugged) -> str:
    return f"serial:{device.name}:{BAUD}"


def test_frames_go_both_ways(tmp_path: Path) -> None:
    async def test() -> None:
        inbox = Inbox()
        with plugged(tmp_path / "ttyACM0") as device:
            link = await open_link(url_of(device), inbox)
            assert link.local_address == (str(device.name), BAUD)
            frames = [heartbeat(seq) for seq in range(20)]
            stream = b"noise" + b"".join(frames[:10]) + b"\xfd" + b"".join(frames[10:])
            cuts = sorted(random.Random(1).choices(range(len(stream)), k=30))
            for begin, end in zip([0, *cuts], [*cuts, len(stream)], strict=True):
                os.write(device.end, stream[begin:end])
                await turn()
            os.write(device.end, 300 * b"\0")  # what follows the last byte that could begin a frame
            assert await inbox.count(20) == frames
            assert {address for _, address in inbox.datagrams} == {link.local_address}
            assert link.send(frames[0]) and link.send(frames[1], link.local_address)
            assert await device.count(2) == frames[:2]
            link.close()
            link.close()
            assert not link.send(frames[0])

    run(test)


def test_two_links_and_a_cable(tmp_path: Path) -> None:
    async def test() -> None:
        at_a, at_b = Inbox(), Inbox()
        with null_modem(tmp_path) as (a, b):
            one, other = await open_link(f"serial:{a}:921600", at_a), await open_link(f"serial://{b}:921600", at_b)
            assert one.send(heartbeat(1)) and other.send(heartbeat(2))
            assert await at_b.count(1) == [heartbeat(1)]
            assert await at_a.count(1) == [heartbeat(2)]
            one.close()
            other.close()

    run(test)


def test_f24_a_device_that_is_unplugged_is_opened_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(serial_links, "RECONNECT_S", 0.01)

    async def test() -> None:
        inbox = Inbox()
        with plugged(tmp_path / "ttyACM0") as device:
            link = await open_link(url_of(device), inbox)
            os.write(device.end, heartbeat(0) + heartbeat(1)[:9])
            await inbox.count(1)
            device.unplug()
            await counted(link, "device_lost")
            assert not link.send(heartbeat(2))
            await counted(link, "device_absent")
        with plugged(tmp_path / "ttyACM0") as device:
            async with asyncio.timeout(5.0):
                while not link.send(heartbeat(3)):
                    await turn()
            assert await device.count(1) == [heartbeat(3)]
            os.write(device.end, heartbeat(4))
            assert await inbox.count(2) == [heartbeat(0), heartbeat(4)]  # half of a frame waits for no other half
            assert link.counters["device_lost"] == 1
            link.close()

    run(test)


def test_f24_a_device_that_is_unplugged_while_it_is_opened_again_is_opened_once_more(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(serial_links, "RECONNECT_S", 0.01)
    set_up = termios.tcsetattr

    async def test() -> None:
        with plugged(tmp_path / "ttyACM0") as device:
            link = await open_link(url_of(device), Inbox())
            device.unplug()
            await counted(link, "device_absent")
        before = link.counters["device_absent"]
        with plugged(tmp_path / "ttyACM0") as device:

            def unplugged(*arguments: Any) -> None:
                monkeypatch.undo()
                device.unplug()
                set_up(*arguments)

            monkeypatch.setattr(termios, "tcsetattr", unplugged)
            async with asyncio.timeout(20.0):
                while device.name.is_symlink() or link.counters["device_absent"] <= before + 1:
                    await turn()
        with plugged(tmp_path / "ttyACM0"):
            async with asyncio.timeout(20.0):
                while not link.send(heartbeat()):
                    await turn()
            link.close()

    run(test)


def test_a_write_finds_out_first_that_the_device_is_gone(tmp_path: Path) -> None:
    async def test() -> None:
        with plugged(tmp_path / "ttyACM0") as device:
            link = await open_link(url_of(device), Inbox())
            device.unplug()
            assert not link.send(heartbeat())
            assert link.counters["device_lost"] == 1
            link.close()
            for _ in range(3):
                await turn()

    run(test)


def test_f24_what_comes_too_late_is_not_sent_and_what_is_sent_is_whole(tmp_path: Path) -> None:
    """Nobody takes what is transmitted: the queue stops growing, and a frame that had begun is sent to its end."""

    async def test() -> None:
        with plugged(tmp_path / "ttyACM0") as device:
            link = await open_link(f"serial:{device.name}:4000000", Inbox())
            sent = []
            while link.send(frame := heartbeat(len(sent) % 256)):
                sent.append(frame)
                assert len(sent) < 10_000
            assert link.counters["send_buffer_full"] == 1
            assert await device.count(len(sent)) == sent
            async with asyncio.timeout(5.0):
                while not link.send(heartbeat(7)):
                    await turn()
            assert await device.count(1) == [heartbeat(7)]
            link.close()

    run(test)


def test_a_slow_device_is_handed_a_quarter_of_a_second(tmp_path: Path) -> None:
    async def test() -> None:
        with plugged(tmp_path / "ttyUSB0") as device:
            link = await open_link(f"serial:{device.name}:600", Inbox())
            # 60 bytes a second: 15 bytes are a quarter of a second, and a HEARTBEAT has 21
            assert not link.send(heartbeat())
            assert link.counters["send_buffer_full"] == 1
            link.close()

    run(test)


def test_a_handler_may_close_its_link(tmp_path: Path) -> None:
    async def test() -> None:
        heard: list[bytes] = []
        links: list[Link] = []

        def hear(data: bytes, _: object) -> None:
            heard.append(data)
            links[0].close()
            closed.set()

        closed = asyncio.Event()
        with plugged(tmp_path / "ttyACM0") as device:
            links.append(await open_link(url_of(device), hear))
            os.write(device.end, heartbeat(0) + heartbeat(1))
            async with asyncio.timeout(5.0):
                await closed.wait()
            assert heard == [heartbeat(0)]

    run(test)


def test_what_leaves_a_signed_link_is_signed(tmp_path: Path) -> None:
    async def test() -> None:
        key = tmp_path / "key"
        key.touch(0o600)
        key.write_bytes(bytes(range(32)))
        with plugged(tmp_path / "ttyACM0") as device:
            link = await open_signed_link(parse_link_url(url_of(device)), Inbox(), SigningOptions(key))
            assert link.send(heartbeat())
            (frame,) = parse_datagram((await device.count(1))[0], CRC_EXTRAS)
            assert isinstance(frame, Frame) and frame.signature is not None
            link.close()

    run(test)


def test_what_cannot_be_opened_is_one_line_with_a_remedy(tmp_path: Path) -> None:
    async def test() -> None:
        file = tmp_path / "file"
        file.write_text("no device")
        with plugged(tmp_path / "ttyACM0") as device:
            link = await open_link(url_of(device), Inbox())
            for what, text in [
                (f"{tmp_path}/ttyACM1:57600", "there is no such device"),
                (f"{file}:57600", "is no serial device"),
                (f"{tmp_path}:57600", "is no serial device"),
                ("/dev/null:57600", "is no serial device"),
                (f"{device.name}:57600", f"in use by another program; stop it (fuser {device.name}"),
            ]:
                with pytest.raises(LinkError) as caught:
                    await open_link(f"serial:{what}", Inbox())
                assert text in str(caught.value) and "\n" not in str(caught.value)
            link.close()

    run(test)


@pytest.mark.skipif(os.geteuid() == 0, reason="the superuser may open every device")
def test_a_device_of_somebody_else_says_which_group(tmp_path: Path) -> None:
    async def test() -> None:
        with plugged(tmp_path / "ttyACM0") as device:
            os.chmod(device.name, 0)
            with pytest.raises(LinkError, match="usermod -aG dialout"):
                await open_link(url_of(device), Inbox())

    run(test)


def test_without_pyserial_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "serial", None)

    async def test() -> None:
        with pytest.raises(MissingExtraError, match=r"pip install 'ridlink\[serial\]'"):
            await open_link("serial:/dev/ttyACM0:57600", Inbox())

    run(test)
