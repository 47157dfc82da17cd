"""Serial links to an autopilot's telemetry port, a Remote ID receiver or a transmitter: a byte stream cut into frames.

A device that disappears, for example because it is unplugged, is opened again when it is back. As on UDP, bytes that
the device does not take at once are dropped and counted; only a frame that was sent in part is completed.
"""

from __future__ import annotations

import array
import asyncio
import errno
import fcntl
import os
import termios
from typing import TYPE_CHECKING

from ridlink.errors import LinkError, MissingExtraError
from ridlink.links.link import Link, OnDatagram, whole_frames
from ridlink.links.url import LinkUrl
from ridlink.mavlink.codec import CRC_EXTRAS
from ridlink.mavlink.frames import FrameParser

if TYPE_CHECKING:
    from serial import Serial

READ_BYTES = 4096
"""Bytes read per wake-up: the size of the kernel's terminal buffer."""

LONGEST_QUEUE_S = 0.25
"""Longest transmission queue of the device: frames beyond it would come too late and are dropped."""

BITS_PER_BYTE = 10
"""Bits on the wire: a start bit, eight data bits, a stop bit."""

RECONNECT_S = 1.0


class SerialLink(Link):
    """One serial device; made by `open_serial_link`. Its one peer has the device and the baud rate as its address."""

    def __init__(self, url: LinkUrl, on_datagram: OnDatagram) -> None:
        super().__init__(on_datagram)
        self.local_address = (url.host, url.port)
        self._url = url
        self._loop = asyncio.get_running_loop()
        self._device: Serial | None = None
        self._parser = FrameParser(CRC_EXTRAS)
        self._rest = b""
        self._retry: asyncio.Task[None] | None = None
        self._closed = False

    def _use(self, device: Serial) -> None:
        self._device = device
        self._parser = FrameParser(CRC_EXTRAS)
        self._rest = b""
        self._loop.add_reader(device.fileno(), self._read)

    def _read(self) -> None:
        assert self._device is not None
        try:
            data = os.read(self._device.fileno(), READ_BYTES)
        except (BlockingIOError, InterruptedError):
            return
        except OSError:
            data = b""
        if not data:  # readable, but no data: the other end of this descriptor is gone
            self._lose()
            return
        for frame in whole_frames(self._parser, data, self.counters):
            if self._closed:
                return
            self._deliver(frame, self.local_address)

    def _release(self) -> None:
        if self._device is not None:
            self._loop.remove_reader(self._device.fileno())
            self._loop.remove_writer(self._device.fileno())
            self._device.close()
            self._device = None

    def _lose(self) -> None:
        self.counters["device_lost"] += 1
        self._release()
        self._retry = self._loop.create_task(self._reopen())

    async def _reopen(self) -> None:
        while self._device is None:
            await asyncio.sleep(RECONNECT_S)
            try:
                self._use(await asyncio.to_thread(_opened, self._url))
            except OSError:
                self.counters["device_absent"] += 1

    def send(self, data: bytes, address: tuple[str, int] | None = None) -> bool:
        """Send one frame; see `Link.send`."""
        if self._device is None:
            self.counters["no_peer"] += 1
            return False
        device = self._device.fileno()
        try:
            if self._rest or _waiting_s(device, len(data), self._url.port) > LONGEST_QUEUE_S:
                self.counters["send_buffer_full"] += 1
                return False
            sent = os.write(device, data)
        except (BlockingIOError, InterruptedError):
            self.counters["send_buffer_full"] += 1
            return False
        except OSError:
            self._lose()
            return False
        if sent < len(data):
            self._rest = data[sent:]
            self._loop.add_writer(device, self._write_rest)
        return True

    def _write_rest(self) -> None:
        assert self._device is not None
        try:
            self._rest = self._rest[os.write(self._device.fileno(), self._rest) :]
        except (BlockingIOError, InterruptedError):
            return
        except OSError:
            self._lose()
            return
        if not self._rest:
            self._loop.remove_writer(self._device.fileno())

    def close(self) -> None:
        """Release the device; bytes in its queue are still transmitted."""
        self._closed = True
        if self._retry is not None:
            self._retry.cancel()
        self._release()


def _waiting_s(device: int, more: int, baud: int) -> float:
    """Time that the device needs for its queue and this many more bytes [s]."""
    waiting = array.array("i", [0])
    fcntl.ioctl(device, termios.TIOCOUTQ, waiting)
    return (waiting[0] + more) * BITS_PER_BYTE / baud


def _opened(url: LinkUrl) -> Serial:
    """The device, raw, without flow control, for this program alone.

    Raises:
        OSError: If it cannot be opened.
    """
    from serial import Serial

    try:
        return Serial(url.host, url.port, timeout=0.0, exclusive=True)
    except ValueError as error:  # for the baud rate
        raise OSError(errno.EINVAL, str(error)) from error
    except termios.error as error:  # not an OSError: the device was unplugged during setup
        raise OSError(*error.args) from error
    except OSError as error:
        if isinstance(error.__context__, termios.error):  # pyserial keeps only the text of it
            raise OSError(*error.__context__.args) from error
        raise


async def open_serial_link(url: LinkUrl, on_datagram: OnDatagram) -> SerialLink:
    """Open a device at a baud rate, for this program alone.

    Raises:
        MissingExtraError: Without pyserial.
        LinkError: If the device does not exist or cannot be used.
    """
    try:
        import serial  # noqa: F401
    except ImportError as error:
        raise MissingExtraError("serial", f"{url}") from error
    link = SerialLink(url, on_datagram)
    try:
        link._use(await asyncio.to_thread(_opened, url))
    except OSError as error:
        raise LinkError(_open_failure(url, error)) from error
    return link


def _open_failure(url: LinkUrl, error: OSError) -> str:
    """One line that says why a device did not open and what to do about it."""
    device = url.host
    match error.errno:
        case errno.ENOENT | errno.ENODEV | errno.ENXIO:
            from serial.tools.list_ports import comports

            here = ", ".join(f"serial:{port.device}:{url.port}" for port in sorted(comports()))
            return f"{url}: there is no such device; {f'there is {here}' if here else 'no serial device is plugged in'}"
        case errno.EACCES | errno.EPERM:
            return f"{url}: not allowed to use {device}; become a member of its group: sudo usermod -aG dialout $USER"
        case errno.EAGAIN | errno.EBUSY:
            return f"{url}: {device} is in use by another program; stop it (fuser {device} shows which)"
        case errno.EINVAL:
            return f"{url}: {device} cannot be used at {url.port} baud; write for instance serial:{device}:57600"
        case errno.ENOTTY | errno.EISDIR:
            return f"{url}: {device} is no serial device"
        case _:
            return f"{url}: {error.strerror or error}"
