"""A clock that outlives the process, whatever ended it, and belongs to one program at a time."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from ridlink.errors import ConfigError
from ridlink.links import SigningOptions
from ridlink.links.signing_clock import SigningClock, open_signing, save_signing
from ridlink.mavlink.codec import CRC_EXTRAS, Encoder
from ridlink.mavlink.frames import Frame, parse_datagram
from ridlink.mavlink.signing import Signing
from tests.links.conftest import KEY
from tests.links.ends import UTC_S, signed


def test_f23_who_crashes_again_and_again_still_hears_a_vehicle_for_the_first_time(key_file: Path) -> None:
    options = SigningOptions(key_file, required=True)

    def live(utc_s: float) -> None:
        clock = SigningClock(options, lambda: utc_s)
        signed(Encoder(1, 196), clock.signing, utc_s)
        clock.keep_up()
        clock.release()

    for life in range(40):
        live(UTC_S + life)
    (frame,) = parse_datagram(signed(Encoder(7, 1), Signing(KEY), UTC_S + 40.0), CRC_EXTRAS)
    assert isinstance(frame, Frame)
    assert open_signing(options).refusal(frame, UTC_S + 40.0) is None


@pytest.mark.parametrize(
    "content",
    [b"", b"{}", b'{"timestamp":-1,"streams":[]}', b'{"timestamp":1,"streams":[[1]]}', b'{"timestamp":1,"\xfd":[]}'],
)
def test_a_damaged_clock_is_said_and_not_begun_anew(key_file: Path, content: bytes) -> None:
    options = SigningOptions(key_file)
    options.state.write_bytes(content)
    with pytest.raises(ConfigError, match=r"key\.state"):
        open_signing(options)


def test_the_clock_is_put_into_place_whole(tmp_path: Path) -> None:
    path = tmp_path / "state"
    save_signing(path, b"one")
    save_signing(path, b"two")
    assert path.read_bytes() == b"two" and os.listdir(tmp_path) == ["state"]
    with pytest.raises(OSError):
        save_signing(tmp_path / "no" / "state", b"three")
