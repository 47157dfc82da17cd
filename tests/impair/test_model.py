"""The bad network does what it was asked for, no more, and the same again from the same seed."""

from __future__ import annotations

import itertools
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ridlink.errors import ConfigError
from ridlink.impair import Impairer, Impairment
from ridlink.impair.model import HELD_BACK_S, LONGEST_QUEUE_S

DATAGRAMS = [bytes([n % 251]) * (1 + n % 40) for n in range(20_000)]

shares = st.floats(0.0, 1.0)
impairments = st.builds(
    Impairment,
    loss=shares,
    delay_s=st.floats(0.0, 2.0),
    jitter_s=st.floats(0.0, 1.0),
    duplicate=shares,
    reorder=shares,
    truncate=shares,
    corrupt=shares,
    rate=st.none() | st.floats(1.0, 1e6),
)


def within_four_sigma(count: int, trials: int, share: float) -> bool:
    return abs(count - trials * share) <= 4.0 * math.sqrt(trials * share * (1.0 - share)) + 1.0


@given(impairments, st.integers(0, 2**32), st.lists(st.binary(max_size=30), max_size=40))
def test_one_seed_is_one_network_and_nothing_leaves_early_or_uncounted(
    impairment: Impairment, seed: int, datagrams: list[bytes]
) -> None:
    first, again = Impairer(impairment, seed), Impairer(impairment, seed)
    left = 0
    for number, data in enumerate(datagrams):
        now_s = 0.1 * number
        leaving = first.take(data, now_s)
        assert leaving == again.take(data, now_s)
        assert all(due_s >= now_s and len(out) <= len(data) for due_s, out in leaving)
        left += len(leaving)
    counts = first.counters
    assert counts["received"] == len(datagrams)
    assert counts["passed"] == left
    assert counts["passed"] - counts["duplicated"] + counts["lost"] + counts["over_rate"] == len(datagrams)


def test_a_perfect_network_changes_nothing() -> None:
    network = Impairer(Impairment(), 1)
    assert [network.take(data, 7.0) for data in DATAGRAMS[:100]] == [[(7.0, data)] for data in DATAGRAMS[:100]]


@pytest.mark.parametrize("share", [0.05, 0.3, 0.9])
def test_shares_are_kept(share: float) -> None:
    network = Impairer(Impairment(loss=share, duplicate=share, reorder=share, truncate=share, corrupt=share), seed=11)
    for number, data in enumerate(DATAGRAMS):
        network.take(data, 0.01 * number)
    counts = network.counters
    arrived = counts["received"] - counts["lost"]
    assert within_four_sigma(counts["lost"], len(DATAGRAMS), share)
    assert within_four_sigma(counts["duplicated"], arrived, share)
    assert within_four_sigma(counts["held_back"], counts["passed"], share)
    assert within_four_sigma(counts["truncated"], arrived, share)


@pytest.mark.parametrize(("loss", "burst"), [(0.3, 5.0), (0.1, 3.0), (0.5, 20.0)])
def test_bursts_have_their_mean_length_and_the_loss_stays_what_it_is(loss: float, burst: float) -> None:
    network = Impairer(Impairment(loss=loss, burst=burst), seed=3)
    lost = [not network.take(data, 0.0) for data in DATAGRAMS * 5]
    runs = [sum(1 for _ in group) for is_lost, group in itertools.groupby(lost) if is_lost]
    assert sum(runs) / len(runs) == pytest.approx(burst, rel=0.1)
    assert sum(lost) / len(lost) == pytest.approx(loss, rel=0.1)


def test_what_is_held_back_is_overtaken() -> None:
    network = Impairer(Impairment(reorder=0.2, delay_s=0.05), seed=5)
    delays_s = {round(network.take(data, 0.0)[0][0], 6) for data in DATAGRAMS[:200]}
    assert delays_s == {0.05, round(0.05 + HELD_BACK_S, 6)}


def test_a_rate_cap_queues_then_drops() -> None:
    network = Impairer(Impairment(rate=1000.0), seed=1)
    dues_s = [leaving[0][0] for _ in range(50) if (leaving := network.take(bytes(100), 0.0))]
    assert dues_s == pytest.approx([0.1 * (n + 1) for n in range(len(dues_s))])
    assert dues_s[-1] <= LONGEST_QUEUE_S + 0.1 + 1e-9
    assert network.counters["over_rate"] == 50 - len(dues_s) > 0


def test_corruption_replaces_exactly_one_byte() -> None:
    network = Impairer(Impairment(corrupt=1.0), seed=2)
    for data in DATAGRAMS[:500]:
        [(_, out)] = network.take(data, 0.0)
        assert len(out) == len(data)
        assert sum(a != b for a, b in zip(out, data, strict=True)) == 1
    assert network.take(b"", 0.0) == [(0.0, b"")]


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"loss": 30.0}, "loss 30.0: a share is at most 1"),
        ({"loss": -0.1}, "loss -0.1"),
        ({"loss": math.nan}, "loss nan"),
        ({"delay_s": math.inf}, "delay_s inf"),
        ({"rate": 0.0}, "rate 0"),
        ({"burst": 5.0}, "bursts need a loss"),
        ({"burst": 0.5, "loss": 0.1}, "burst 0.5"),
        ({"burst": 2.0, "loss": 0.9}, "bursts of at least 9"),
    ],
)
def test_what_cannot_be_is_refused_by_name(options: dict[str, float], says: str) -> None:
    with pytest.raises(ConfigError, match=says):
        Impairment(**options)
