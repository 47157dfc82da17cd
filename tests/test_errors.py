"""The tree of errors is the one drawn at the top of errors.py, and each error keeps its facts."""

from __future__ import annotations

import errno
import pickle

import pytest

from ridlink import errors
from ridlink.errors import (
    CaptureError,
    ConfigError,
    FrameError,
    LinkError,
    MissingExtraError,
    PayloadError,
    RidlinkError,
    UnknownMessageError,
    WireError,
)


def all_errors() -> list[type[Exception]]:
    return [value for value in vars(errors).values() if isinstance(value, type) and issubclass(value, Exception)]


@pytest.mark.parametrize("error", all_errors(), ids=lambda error: error.__name__)
def test_every_error_is_one_of_ours_and_drawn(error: type[Exception]) -> None:
    assert issubclass(error, RidlinkError)
    assert error.__doc__
    assert errors.__doc__ is not None and error.__name__ in errors.__doc__


@pytest.mark.parametrize(
    ("error", "base"),
    [
        (WireError, ValueError),
        (FrameError, WireError),
        (PayloadError, WireError),
        (UnknownMessageError, WireError),
        (CaptureError, ValueError),
        (ConfigError, ValueError),
        (LinkError, OSError),
        (MissingExtraError, RidlinkError),
    ],
)
def test_bases(error: type[Exception], base: type[Exception]) -> None:
    assert issubclass(error, base)


def test_facts_are_attributes() -> None:
    frame = FrameError("bad", part="sysid")
    assert (str(frame), frame.part) == ("bad", "sysid")
    payload = PayloadError("bad", message="HEARTBEAT", field="type")
    assert (payload.message, payload.field) == ("HEARTBEAT", "type")
    assert (PayloadError("bad").message, PayloadError("bad").field) == ("", "")
    unknown = UnknownMessageError(77_777)
    assert (unknown.message, str(unknown)) == (77_777, "the dialect has no message 77777")
    assert str(UnknownMessageError("PIN", ("PING", "PONG"))) == "the dialect has no message 'PIN': did you mean 'PING'?"


def test_a_missing_extra_says_how_to_install_it() -> None:
    error = MissingExtraError("export", "Parquet output")
    assert error.extra == "export"
    says = "Parquet output needs the extra 'export': pip install 'ridlink[export]'"
    assert str(error) == says
    error.__cause__ = ModuleNotFoundError("No module named 'pyarrow'")
    assert str(error) == says
    error.__cause__ = ImportError("libarrow.so:\n undefined symbol")
    assert str(error) == f"{says} (what is installed cannot be loaded: libarrow.so: undefined symbol)"


def test_a_link_error_prints_its_text_alone() -> None:
    assert str(LinkError("udpin:127.0.0.1:1: in use")) == "udpin:127.0.0.1:1: in use"
    assert str(LinkError()) == ""
    with pytest.raises(OSError):
        raise LinkError("gone")


@pytest.mark.parametrize(
    "error", [FrameError("bad"), PayloadError("bad"), CaptureError("bad"), ConfigError("bad"), LinkError("bad")]
)
def test_errors_cross_process_borders(error: RidlinkError) -> None:
    twin = pickle.loads(pickle.dumps(error))
    assert type(twin) is type(error)
    assert str(twin) == str(error)


def test_a_link_error_may_carry_an_errno() -> None:
    error = LinkError(errno.EADDRINUSE, "in use")
    assert error.errno == errno.EADDRINUSE
    assert str(error) == "in use"
