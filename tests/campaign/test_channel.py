"""How many reports are lost, how many in a row, and how late the others are."""

import numpy as np
import pytest

from ridlink.campaign import tracks
from ridlink.campaign.cell import BASELINE
from ridlink.campaign.chance import ErrorModel
from ridlink.campaign.channel import Channel, Reception
from ridlink.campaign.flight import PairBatch
from ridlink.campaign.plan import Plan
from ridlink.campaign.response import Dynamics
from ridlink.campaign.scene import circle
from ridlink.campaign_runner.choice import SOLVERS
from ridlink.cli import campaign_options
from ridlink.cli.campaign import run
from ridlink.separation import Definition
from ridlink.technologies import TECHNOLOGIES


def lost_reports(channel: Channel, reports: int = 4000) -> np.ndarray:
    reception = Reception(channel, count=6, seed=2, runs=range(2))
    return np.array([reception.next()[0] for _ in range(reports)]).reshape(reports, -1)


@pytest.mark.parametrize(("burst", "mean"), [(None, 1.0 / 0.7), (5.0, 5.0), (20.0, 20.0)])
def test_losses_have_their_share_and_their_length(burst, mean):
    lost = lost_reports(Channel(0.3, burst))
    assert lost.mean() == pytest.approx(0.3, abs=0.01)
    bursts = (np.diff(lost.astype(int), axis=0) == 1).sum() + lost[0].sum()
    assert lost.sum() / bursts == pytest.approx(mean, rel=0.05)
    assert lost[0].mean() == pytest.approx(0.3, abs=0.15), "the first one is as likely lost as any other"


@pytest.mark.parametrize("interval_s", [0.1, 0.3, 1.0])
def test_bursts_count_reports_however_often_vehicles_decide(interval_s):
    plan = Plan(
        circle(6), channel=Channel(0.3, 5.0), interval_s=interval_s, step_s=0.1, displaced_s=0.1, range_m=1e6, seed=3
    )  # fmt: skip
    batch = PairBatch(plan, range(2))
    reports = 1500
    heard = [[[] for _ in range(6)] for _ in range(2)]
    for step in range(1, round(reports * interval_s / 0.1)):
        sending = batch._send(step, 0.1 * step, batch.position)
        for world, sender in np.argwhere(sending).tolist():
            row = batch.tracks[world, :, sender, tracks.AT] == 0.1 * step
            heard[world][sender].append(np.delete(row, sender))
    lost = ~np.concatenate([np.array(rows)[: reports - 1] for world in heard for rows in world], axis=1)
    bursts = (np.diff(lost.astype(int), axis=0) == 1).sum() + lost[0].sum()
    assert lost.mean() == pytest.approx(0.3, abs=0.02)
    assert lost.sum() / bursts == pytest.approx(5.0, rel=0.07)


def test_receivers_have_their_own_luck_and_runs_their_own_draws():
    lost = lost_reports(Channel(0.5), 2000)
    agree = (lost[:, :1] == lost[:, 1:]).mean(axis=0)
    assert np.all(np.abs(agree - 0.5) < 0.06)
    together = Reception(Channel(0.3, 4.0, (0.1, 0.3)), count=3, seed=1, runs=range(5, 9))
    alone = Reception(Channel(0.3, 4.0, (0.1, 0.3)), count=3, seed=1, runs=range(7, 8))
    for k in range(60):
        if k == 7:
            together.keep(np.array([True, False, True, True]))
        row = 2 if k < 7 else 1
        for both, one in zip(together.next(), alone.next(), strict=True):
            assert np.array_equal(both[row], one[0])


def test_latencies_lie_between_the_two():
    _, late, _ = Reception(Channel(latency_s=(0.1, 0.3)), count=9, seed=1, runs=range(1)).next()
    assert 0.1 <= late.min() < 0.15 < 0.25 < late.max() <= 0.3
    lost, late, _ = Reception(Channel(), count=9, seed=1, runs=range(2)).next()
    assert not lost.any() and not late.any()


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ((1.0,), "loss"), ((-0.1,), "loss"), ((float("nan"),), "loss"), ((0.3, 0.9), "burst"), ((0.9, 2.0), "burst"),
        ((0.0, None, (0.2, 0.1)), "latency_s"), ((0.0, None, (0.0, float("inf"))), "latency_s"),
    ],
)  # fmt: skip
def test_channels_that_cannot_be(arguments, text):
    with pytest.raises(ValueError, match=text):
        Channel(*arguments)


@pytest.mark.parametrize("technology", TECHNOLOGIES.values(), ids=lambda technology: technology.name)
def test_every_technology_is_a_channel_with_its_losses(technology):
    channel = Channel(technology.loss, None, technology.latency_s, technology.edge_loss, technology.crowding)
    assert channel.is_perfect == (technology.name == "ideal")
    distance = np.array([[[0.0, 0.5, 1.0], [0.5, 0.0, 0.9], [1.0, 0.9, 0.0]]]) * technology.range_m
    heard = np.broadcast_to(~np.eye(3, dtype=bool), distance.shape)
    arrives = technology.link_share(distance) / (1.0 - technology.loss) * technology.collision_share(1)
    assert channel.share(distance, technology.range_m, heard) == pytest.approx(arrives)


def test_the_command_offers_what_campaigns_know():
    assert set(campaign_options.TECHNOLOGIES) == set(TECHNOLOGIES)
    assert set(campaign_options.SOLVERS) == set(SOLVERS)
    assert set(campaign_options.DEFINITIONS) == {*Definition, BASELINE}
    assert set(campaign_options.DYNAMICS) == set(Dynamics)
    assert set(campaign_options.GNSS_MODELS) == set(ErrorModel)


def test_errors_are_said_to_a_campaign_as_to_the_emulator_too():
    emulators, ours = (
        run.make_context("run", [correlation, "3", common, "0.5"]).params
        for correlation, common in (("--gnss-time", "--gnss-common"), ("--correlation", "--common-mode"))
    )
    assert emulators == ours and (ours["correlation_s"], ours["common_share"]) == (3.0, 0.5)
