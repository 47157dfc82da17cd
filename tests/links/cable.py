"""Serial devices without hardware: pseudo-terminals, which the kernel keeps as it keeps a serial port's driver."""

from __future__ import annotations

import asyncio
import contextlib
import os
import pty
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ridlink.mavlink.codec import CRC_EXTRAS
from ridlink.mavlink.frames import Frame, FrameParser
from tests.loopback import PATIENCE_S


class Plugged:
    """A device that can be unplugged, at a name of our choice; we hold the other end of its cable.

    Args:
        name: Where it appears, as a rule of udev would have it.
    """

    def __init__(self, name: Path) -> None:
        self.name = name
        self.end, device = pty.openpty()
        os.set_blocking(self.end, False)
        name.symlink_to(os.ttyname(device))
        os.close(device)
        self._parser = FrameParser(CRC_EXTRAS)

    def unplug(self) -> None:
        """Whoever has it open finds nobody behind it, and its name is gone."""
        self.name.unlink()
        os.close(self.end)

    def receive(self) -> list[bytes]:
        """Frames of what has been transmitted since the last time; anything else is an error."""
        data = b""
        with contextlib.suppress(BlockingIOError):
            while True:
                data += os.read(self.end, 65536)
        found = self._parser.feed(data)
        assert all(isinstance(each, Frame) for each in found)
        return [each.raw for each in found]

    async def count(self, number: int) -> list[bytes]:
        """So many frames, as they are transmitted."""
        frames: list[bytes] = []
        arrived = asyncio.Event()
        asyncio.get_running_loop().add_reader(self.end, arrived.set)
        try:
            async with asyncio.timeout(PATIENCE_S):
                while len(frames) < number:
                    await arrived.wait()
                    arrived.clear()
                    frames += self.receive()
        finally:
            asyncio.get_running_loop().remove_reader(self.end)
        return frames


@contextmanager
def plugged(name: Path) -> Iterator[Plugged]:
    """A device for a while."""
    device = Plugged(name)
    try:
        yield device
    finally:
        with contextlib.suppress(FileNotFoundError):
            device.unplug()


@contextmanager
def null_modem(folder: Path) -> Iterator[tuple[str, str]]:
    """Two devices, what one transmits the other receives; inside of a running loop."""
    loop = asyncio.get_running_loop()
    with plugged(folder / "ttyA") as a, plugged(folder / "ttyB") as b:

        def carry(source: int, target: int) -> None:
            with contextlib.suppress(OSError):  # nobody has the device open: what is on the cable is gone
                os.write(target, os.read(source, 65536))

        # A device that nobody has open is always readable, with an error: both stay open here.
        held = [os.open(device.name, os.O_RDWR | os.O_NOCTTY) for device in (a, b)]
        loop.add_reader(a.end, carry, a.end, b.end)
        loop.add_reader(b.end, carry, b.end, a.end)
        try:
            yield str(a.name), str(b.name)
        finally:
            for device, descriptor in zip((a, b), held, strict=True):
                loop.remove_reader(device.end)
                os.close(descriptor)
