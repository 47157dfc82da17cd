"""What is said of everybody in the air, by the names that the decoder has."""

from __future__ import annotations

import pytest

from ridlink.mavlink.codec import decode_message
from ridlink.observer import Sky, aircraft_states
from ridlink.remote_id.accuracy import AccuracyConvention
from ridlink.remote_id.bridge import messages_of
from ridlink.remote_id.messages import Location
from ridlink.separation.definitions import Definition
from tests.observer.flights import HOME, Flyer, frames


@pytest.mark.parametrize("convention", AccuracyConvention)
def test_the_accuracy_is_the_bound_of_the_code_as_the_decoder_has_it(convention: AccuracyConvention) -> None:
    """Not what is made of it for discs: 10 m, code 10, are 12.3 m of three sigma by the letter."""
    sky, decoded = Sky(origin=HOME, convention=convention), set()
    for time_s, frame in frames([Flyer(1, (0.0, 0.0), (10.0, 0.0), b"ALPHA")], 1.0):
        sky.receive(frame, time_s)
        decoded |= {each.horizontal_accuracy_m for each in messages_of(decode_message(frame)) if type(each) is Location}
    [state] = aircraft_states(sky, sky.at(1.0), Definition.ODID_ACCURACY, 0.0)
    assert state["horizontal_accuracy_m"] == 10.0 and decoded == {10.0}
