"""The channel between a sender and its receivers: reports are lost, late or out of range.

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
    """The channel of a report to one receiver; receivers are independent of each other.

    Args:
        loss: Share of reports that a receiver in range misses.
        burst: Mean number of reports lost in a row, from a model of two states with geometric durations (Gilbert and
            Elliott); None: independent losses, with a mean of `1 / (1 - loss)`.
        latency_s: Time from sending to receipt, uniform between the two values.
        edge_loss: Additional share lost at the end of the range; it grows with the fourth power of the distance.
        crowding: Probability that one more sender in range of the receiver destroys a report.

    Raises:
        ValueError: If a figure is not finite or out of range, or no two-state model has this loss in such bursts.
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
        """Whether every report is received at once."""
        return self.loss == 0.0 and self.latency_s[1] == 0.0 and not self.depends_on_others

    @property
    def depends_on_others(self) -> bool:
        """Whether losses depend on the positions of the vehicles."""
        return self.edge_loss > 0.0 or self.crowding > 0.0

    def share(self, distance_m: FloatArray, range_m: float, heard: BoolArray) -> FloatArray:
        """Share of reports that arrive, of those not lost for other reasons; the same formula as in
        `ridlink.technologies`.

        Args:
            distance_m: Distance between receiver and sender, shape (W, N, N).
            range_m: Radio range.
            heard: Mask of pairs in range, without the diagonal, shape (W, N, N).

        Returns:
            Share, shape (W, N, N).
        """
        others = np.maximum(heard.sum(axis=2) - 1, 0)[:, :, None]
        edge: FloatArray = 1.0 - self.edge_loss * np.minimum(distance_m / range_m, 1.0) ** EDGE_POWER
        crowd: FloatArray = np.exp(-self.crowding * others)
        return edge * crowd


PERFECT = Channel()


class Reception:
    """Losses and latencies of a batch of runs, independent for every pair of sender and receiver.

    Args:
        channel: The channel.
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
        """Draw for the next reports: losses and latencies; the axis of receivers comes before that of senders.

        Args:
            sending: Vehicles that report, shape (W, N); None: all. Bursts count reports, so the state of the others
                does not change.

        Returns:
            Losses, latencies [s], and a uniform number below 1 that `Channel.share` must exceed, shape (W, N, N) each.
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
        """Keep only some runs of the batch."""
        self._random = [random for random, kept in zip(self._random, runs, strict=True) if kept]
        self._drawn = self._drawn[runs]
        if self._channel.burst is not None:
            self._bad = self._bad[runs]
