"""Exceptions that ridlink raises.

    RidlinkError
    |-- WireError (ValueError)        bytes that are not what they should be
    |   |-- FrameError                what makes no MAVLink frame: an id out of range, a payload too long, flags
    |   |-- PayloadError              the fields of one message
    |   `-- UnknownMessageError       a message that the dialect does not have
    |-- CaptureError (ValueError)     a file that is not a readable capture
    |-- ConfigError (ValueError)      configuration, scenario or connection string; the text shows what is right
    |-- MissingExtraError             an optional dependency is not installed
    `-- LinkError (OSError)           a socket, port or device

Readers of streams raise nothing for bad bytes: they yield what is good and count the rest by cause.
"""

from __future__ import annotations

from collections.abc import Iterable

from ridlink.words import did_you_mean


class RidlinkError(Exception):
    """Base class of all exceptions that ridlink raises on purpose. The text is one line that can be shown to a user."""


class WireError(RidlinkError, ValueError):
    """Bytes that are not what they should be."""


class FrameError(WireError):
    """A MAVLink frame that cannot be made or signed. One that cannot be read is a `BadFrame`, and raises nothing.

    Attributes:
        part: The part of the frame that is wrong.
    """

    def __init__(self, text: str, *, part: str = "") -> None:
        super().__init__(text)
        self.part = part


class PayloadError(WireError):
    """A message whose fields cannot be encoded or decoded.

    Attributes:
        message: Name of the message.
        field: Name of the field, empty if the error is about the whole payload.
    """

    def __init__(self, text: str, *, message: str = "", field: str = "") -> None:
        super().__init__(text)
        self.message = message
        self.field = field


class UnknownMessageError(WireError):
    """A message that the dialect does not have.

    Attributes:
        message: The name or id that was requested.
        known: Names of which one may have been meant. They are compared only when the text is read, which takes a
            millisecond.
    """

    def __init__(self, message: str | int, known: Iterable[str] = ()) -> None:
        super().__init__(f"the dialect has no message {message!r}")
        self.message = message
        self.known = known

    def __str__(self) -> str:
        return super().__str__() + did_you_mean(str(self.message), self.known)


class CaptureError(RidlinkError, ValueError):
    """A file that is not a readable capture."""


class ConfigError(RidlinkError, ValueError):
    """Configuration, a scenario file or a connection string that cannot be used; the text shows what is right.

    Attributes:
        others: Further mistakes of the same file, one line each, if the whole file was checked.
    """

    def __init__(self, text: str, *others: str) -> None:
        super().__init__(text)
        self.others = others


class MissingExtraError(RidlinkError):
    """An optional dependency is not installed, or is and cannot be loaded: then the cause of this error says why.

    Attributes:
        extra: The extra of ridlink that installs it.
    """

    def __init__(self, extra: str, purpose: str) -> None:
        super().__init__(f"{purpose} needs the extra '{extra}': pip install 'ridlink[{extra}]'")
        self.extra = extra

    def __str__(self) -> str:
        cause = self.__cause__
        if cause is None or isinstance(cause, ModuleNotFoundError):
            return super().__str__()
        return f"{super().__str__()} (what is installed cannot be loaded: {' '.join(str(cause).split())})"


class LinkError(RidlinkError, OSError):
    """A socket, port or device that cannot be opened or used."""

    def __str__(self) -> str:  # OSError would print a tuple when it has an errno
        return self.strerror or (str(self.args[0]) if self.args else "")
