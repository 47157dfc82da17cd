"""RIDLINK_SEPARATION among the 25-byte messages: recognised when it is ours, never understated, dated by the hour."""

from __future__ import annotations

import math

from hypothesis import given
from hypothesis import strategies as st

from ridlink.remote_id.astm import decode_message, encode_message
from ridlink.remote_id.messages import Authentication, Separation
from ridlink.remote_id.separation import separation_of
from tests.remote_id.vectors import SINGLE, message_of

lengths = st.none() | st.floats(0, 1e5)
speeds = st.none() | st.floats(-400, 400)
separations = st.builds(
    Separation, timestamp_s=st.none() | st.floats(0, 3599), horizontal_error_m=lengths, vertical_error_m=lengths,
    velocity_error_mps=lengths, airframe_size_m=lengths, airframe_height_m=lengths, update_interval_s=lengths,
    commanded_vx_mps=speeds, commanded_vy_mps=speeds, commanded_vz_mps=speeds, flags=st.integers(0, 255),
)  # fmt: skip


def test_only_our_own_letters_layout_and_length_are_a_separation() -> None:
    ours = decode_message(encode_message(Separation(horizontal_error_m=3.0)))
    assert isinstance(ours, Separation) and ours.horizontal_error_m == 3.0
    others = [message_of(vector) for vector in SINGLE if vector["note"].endswith("somebody else's")]
    assert len(others) == 3, "letters, layout, length"
    for message in others:
        assert isinstance(message, Authentication) and separation_of(message) is None


@given(separations)
def test_an_uncertainty_is_never_understated(sent: Separation) -> None:
    got = decode_message(encode_message(sent))
    assert isinstance(got, Separation)
    for name, most, known_at_zero in (
        ("horizontal_error_m", 655.35, True), ("vertical_error_m", 127.5, True), ("velocity_error_mps", 25.5, True),
        ("airframe_size_m", 25.5, False), ("airframe_height_m", 25.5, False), ("update_interval_s", 5.1, False),
    ):  # fmt: skip
        value, received = getattr(sent, name), getattr(got, name)
        if value is None or (value == 0.0 and not known_at_zero):
            assert received is None
        else:
            assert received is not None and received >= min(value, most) - 1e-6


@given(separations, st.integers(0, 1_000_000))
def test_the_time_of_a_separation_needs_the_hour(sent: Separation, hours: int) -> None:
    without = decode_message(encode_message(sent))
    having = decode_message(encode_message(sent, hour_start_s=hours * 3600))
    assert isinstance(without, Separation) and isinstance(having, Separation)
    assert without.timestamp_s is None
    whole = None if sent.timestamp_s is None else float(math.floor(sent.timestamp_s))
    assert having.timestamp_s == (whole if hours or whole else None)
