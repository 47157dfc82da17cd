"""Effects of a bad network on one stream of datagrams, drawn from a seed.

The faults apply in this order: rate cap, loss, truncation, corruption, duplication, delay. A model takes datagrams with
their time and returns what leaves and when; it opens no socket and reads no clock.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass, fields

import numpy as np

from ridlink.errors import ConfigError

HELD_BACK_S = 0.15
"""Extra delay of a datagram that later ones are to overtake: one and a half updates of a 10 Hz sender."""

LONGEST_QUEUE_S = 1.0
"""A datagram that would wait longer than this under a rate cap is dropped, as by a full buffer."""

SHARES = ("loss", "duplicate", "reorder", "truncate", "corrupt")


@dataclass(frozen=True, slots=True, kw_only=True)
class Impairment:
    """Settings of a bad network, for one direction.

    Args:
        loss: Share of datagrams that never arrive.
        burst: Mean number of datagrams lost in a row [1]; None: losses are independent. Otherwise loss follows the
            two-state model of Gilbert: everything is lost in the bad state and nothing in the good one.
        delay_s: Delay of every datagram [s].
        jitter_s: Standard deviation of the delay [s]; a delay is never negative. Later datagrams may overtake.
        duplicate: Share that arrives twice.
        reorder: Share that is held back for `HELD_BACK_S`, so that later ones overtake it.
        truncate: Share that is cut at a random byte.
        corrupt: Share in which one random byte is replaced by another.
        rate: Rate cap [B/s]; None for no cap.

    Raises:
        ConfigError: If a value is out of range; the text begins with its name.
    """

    loss: float = 0.0
    burst: float | None = None
    delay_s: float = 0.0
    jitter_s: float = 0.0
    duplicate: float = 0.0
    reorder: float = 0.0
    truncate: float = 0.0
    corrupt: float = 0.0
    rate: float | None = None

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if value is None:
                continue
            if not math.isfinite(value) or value < 0.0:
                raise ConfigError(f"{field.name} {value}: must be a number of at least 0")
            if field.name in SHARES and value > 1.0:
                raise ConfigError(f"{field.name} {value}: a share is at most 1 (30 % is 0.3)")
        if self.rate == 0.0:
            raise ConfigError("rate 0: nothing would ever pass; leave it out for no cap")
        if self.burst is not None:
            if self.burst < 1.0:
                raise ConfigError(f"burst {self.burst}: the mean number lost in a row is at least 1")
            if self.loss >= 1.0 or self.loss * self.burst == 0.0:
                raise ConfigError(f"burst {self.burst} with loss {self.loss}: bursts need a loss above 0 and below 1")
            longest = self.loss / (1.0 - self.loss)
            if self.burst < longest:
                raise ConfigError(f"loss {self.loss} needs bursts of at least {longest:.3g} in the mean")


class Impairer:
    """Applies an impairment to one direction of one stream.

    Attributes:
        counters: Datagrams by outcome: ``received``, ``passed`` (copies count), ``lost``, ``over_rate``,
            ``duplicated``, ``held_back``, ``truncated``, ``corrupted``.
    """

    def __init__(self, impairment: Impairment, seed: int | tuple[int, ...]) -> None:
        self.counters: Counter[str] = Counter()
        self._impairment = impairment
        self._random = np.random.default_rng(seed)
        self._in_burst = False
        self._free_at_s = -math.inf

    def take(self, data: bytes, now_s: float) -> list[tuple[float, bytes]]:
        """Times [s, on the caller's clock] and bytes at which copies of one datagram leave; none if it is lost."""
        how = self._impairment
        self.counters["received"] += 1
        sent_at_s = self._after_queue(len(data), now_s)
        if sent_at_s is None:
            self.counters["over_rate"] += 1
            return []
        if self._is_lost():
            self.counters["lost"] += 1
            return []
        if self._happens(how.truncate):
            data = data[: int(self._random.integers(0, max(1, len(data))))]
            self.counters["truncated"] += 1
        if data and self._happens(how.corrupt):
            where = int(self._random.integers(len(data)))
            other = data[where] ^ int(self._random.integers(1, 256))
            data = data[:where] + bytes([other]) + data[where + 1 :]
            self.counters["corrupted"] += 1
        copies = 1
        if self._happens(how.duplicate):
            copies = 2
            self.counters["duplicated"] += 1
        self.counters["passed"] += copies
        return [(sent_at_s + self._delay_s(), data) for _ in range(copies)]

    def _after_queue(self, size_bytes: int, now_s: float) -> float | None:
        """Time at which the last byte leaves under the rate cap; None if the queue is full."""
        if self._impairment.rate is None:
            return now_s
        starts_s = max(now_s, self._free_at_s)
        if starts_s - now_s > LONGEST_QUEUE_S:
            return None
        self._free_at_s = starts_s + size_bytes / self._impairment.rate
        return self._free_at_s

    def _is_lost(self) -> bool:
        how = self._impairment
        if how.burst is None:
            return self._happens(how.loss)
        # The stationary share of the bad state is `loss`, its mean duration `burst`.
        ends = 1.0 / how.burst
        begins = ends * how.loss / (1.0 - how.loss)
        self._in_burst = not self._happens(ends) if self._in_burst else self._happens(begins)
        return self._in_burst

    def _delay_s(self) -> float:
        how = self._impairment
        delay_s = how.delay_s
        if how.jitter_s:
            delay_s = max(0.0, delay_s + how.jitter_s * float(self._random.standard_normal()))
        if self._happens(how.reorder):
            self.counters["held_back"] += 1
            delay_s += HELD_BACK_S
        return delay_s

    def _happens(self, share: float) -> bool:
        return share > 0.0 and float(self._random.random()) < share
