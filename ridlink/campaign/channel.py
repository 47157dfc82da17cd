"""What becomes of reports between a sender and its receivers: lost, late, out of range.

Units: seconds; shares within 0 and 1.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ridlink.campaign.chance import Source, generator
from ridlink.technologies import EDGE_POWER

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Channel:
    """The way of a report to one receiver; each receiver has its own luck with it.

    Args:
        loss: Share of reports that a receiver in range misses.
        burst: Mean number of reports that are lost in a row, as two states make them that each last for geometric
            times (Gilbert and Elliott); None: independently, which is `1 / (1 - loss)` in the mean.
        latency_s: Time from sending to hearing, uniform between the two.
        edge_loss: Share lost besides at the end of the range, less with the fourth power of the distance.
        crowding: How likely one more sender in range of the receiver destroys a report.

    Raises:
        ValueError: If a figure is not finite or out of range, or no two states have that loss in such bursts.
    """

    loss: float = 0.0
    burst: float | None = None
    latency_s: tuple[float, float] = (0.0, 0.0)
    edge_loss: float = 0.0
    crowding: float = 0.0

    def __post_init__(self) -> None:
        if not 0.0 <= self.loss < 1.0:
            raise ValueError(f"loss must lie within 0 and 1, 1 excluded, got {self.loss}")
        if not (0.0 <= self.latency_s[0] <= self.latency_s[1] < math.inf):
            raise ValueError(f"latency_s must be two times, the first not above the second, got {self.latency_s}")
        if not (0.0 <= self.edge_loss <= 1.0 and 0.0 <= self.crowding < math.inf):
            raise ValueError(f"edge_loss must lie within 0 and 1, crowding must not be negative, got {self}")
        if self.burst is not None:
            shortest = max(1.0, self.loss / (1.0 - self.loss))
            if not shortest <= self.burst < math.inf:
                raise ValueError(
                    f"burst must be at least {shortest:g} reports at a loss of {self.loss:g}, got {self.burst:g}"
                )

    @property
    def is_perfect(self) -> bool:
        """Whether every report is heard as it is sent."""
        return self.loss == 0.0 and self.latency_s[1] == 0.0 and not self.depends_on_others

    @property
    def depends_on_others(self) -> bool:
        """Whether losses depend on where everybody is."""
        return self.edge_loss > 0.0 or self.crowding > 0.0

    def share(self, distance_m: FloatArray, range_m: float, heard: BoolArray) -> FloatArray:
        """What arrives of reports that are not lost for other reasons; see `ridlink.technologies`, which has the same.

        Args:
            distance_m: Between receiver and sender, shape (W, N, N).
            range_m: Radio range.
            heard: Who is in range of whom, oneself excluded, shape (W, N, N).

        Returns:
            Share, shape (W, N, N).
        """
        others = np.maximum(heard.sum(axis=2) - 1, 0)[:, :, None]
        edge: FloatArray = 1.0 - self.edge_loss * np.minimum(distance_m / range_m, 1.0) ** EDGE_POWER
        crowd: FloatArray = np.exp(-self.crowding * others)
        return edge * crowd


PERFECT = Channel()


class Reception:
    """Losses and latencies of a batch of runs: every pair of sender and receiver on its own.

    Args:
        channel: What becomes of reports.
        count: Vehicles in a run, N.
        seed: Seed of the campaign.
        runs: The runs of the batch, W of them.
    """

    _BLOCK = 16

    def __init__(self, channel: Channel, *, count: int, seed: int, runs: range) -> None:
        self._channel = channel
        self._random = [generator(seed, run, Source.RADIO) for run in runs]
        self._shape = (count, count)
        self._figures = 3 if channel.depends_on_others else 2
        self._drawn = np.empty((len(runs), 0, count, count, self._figures))
        self._next = 0
        if channel.burst is not None:
            drawn: FloatArray = np.stack([random.random(self._shape) for random in self._random])
            self._bad: BoolArray = drawn < channel.loss

    def next(self, sending: BoolArray | None = None) -> tuple[BoolArray, FloatArray, FloatArray]:
        """What the next reports meet: who misses them, and how late the others hear them; receiver before sender.

        Args:
            sending: Who reports, shape (W, N); None: everybody. Bursts are of reports: those of the others wait.

        Returns:
            Lost, latencies [s], and a figure below 1 which `Channel.share` must exceed, shape (W, N, N) each.
        """
        channel = self._channel
        if channel.is_perfect:
            shape = (len(self._random), *self._shape)
            return np.zeros(shape, np.bool_), np.zeros(shape), np.zeros(shape)
        if self._next == self._drawn.shape[1]:
            self._drawn = np.stack(
                [random.random((self._BLOCK, *self._shape, self._figures)) for random in self._random]
            )
            self._next = 0
        drawn = self._drawn[:, self._next]
        self._next += 1
        low, high = channel.latency_s
        latency = low + (high - low) * drawn[..., 1]
        luck = drawn[..., 2] if channel.depends_on_others else np.zeros_like(latency)
        if channel.burst is None:
            return drawn[..., 0] < channel.loss, latency, luck
        leave = 1.0 / channel.burst
        enter = leave * channel.loss / (1.0 - channel.loss)
        lost = self._bad
        after = np.where(lost, drawn[..., 0] >= leave, drawn[..., 0] < enter)
        self._bad = after if sending is None else np.where(sending[:, None, :], after, lost)
        return lost, latency, luck

    def keep(self, runs: BoolArray) -> None:
        """Go on with some runs of the batch only."""
        self._random = [random for random, kept in zip(self._random, runs, strict=True) if kept]
        self._drawn = self._drawn[runs]
        if self._channel.burst is not None:
            self._bad = self._bad[runs]
