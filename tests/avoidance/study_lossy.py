"""Eight vehicles through one point that hear little of each other: python -m tests.avoidance.study_lossy [runs].

Circle of 100 m at 10 m/s, Gauss-Markov errors of 3.5 m, airframes of 0.5 to 2 m, latencies of 0.1 to 0.3 s. Printed for
both autopilots, with 10 reports a second and with one of which 30 % are lost: runs in which two reported positions came
nearer than the disc, 5th percentile of the smallest reported margin, collisions, vehicles that did not arrive, median
time.
"""

from __future__ import annotations

import sys

import numpy as np

from ridlink.avoidance import HalfplaneSettings
from ridlink.campaign.channel import Channel
from ridlink.campaign.flight import fly
from ridlink.campaign.plan import Plan
from ridlink.campaign.scene import Scene
from ridlink.campaign.worlds import Instant
from tests.avoidance.exact import on_circle

SIGMA_M, SPEED_MPS, VEHICLES = 3.5, 10.0, 8


class Margins:
    """Smallest reported margin of each run of a batch; worlds that are over leave it, the others keep their order."""

    def __init__(self, runs: int) -> None:
        self.least_m = np.full(runs, np.inf)
        self._run, self._before = np.arange(runs), np.empty((0, 0, 2))

    def __call__(self, now: Instant) -> None:
        if self._before.size and len(now.position_ne_m) < len(self._before):
            self._run = self._run[self._staying(now.position_ne_m)]
        self._before = now.position_ne_m.copy()
        apart = np.linalg.norm(now.reported_ne_m[:, :, None] - now.reported_ne_m[:, None], axis=-1)
        speed = np.linalg.norm(now.velocity_ne_mps, axis=-1)
        disc = (now.airframe_m[:, :, None] + now.airframe_m[:, None]) / 2.0 + 6.0 * SIGMA_M
        disc = disc + 0.1 * (speed[:, :, None] + speed[:, None])
        both = now.present[:, :, None] & now.present[:, None] & ~np.eye(VEHICLES, dtype=bool)
        margin = np.where(both, apart - disc, np.inf).min(axis=(1, 2))
        self.least_m[self._run] = np.minimum(self.least_m[self._run], margin)

    def _staying(self, position: np.ndarray) -> list[int]:
        """Places before of the worlds that are left: nobody flies further than two metres in a step."""
        staying: list[int] = []
        for place, before in enumerate(self._before):
            if len(staying) < len(position) and np.abs(position[len(staying)] - before).max() < 2.0:
                staying.append(place)
        assert len(staying) == len(position)
        return staying


def measure(dynamics: str, channel: Channel, interval_s: float, runs: int) -> None:
    start = on_circle(VEHICLES, 100.0)
    scene = Scene(
        "circle", start, -start, speed_mps=np.full(VEHICLES, SPEED_MPS), airframe_m=np.linspace(0.5, 2.0, VEHICLES)
    )
    plan = Plan(
        scene, settings=HalfplaneSettings(), sigma_m=SIGMA_M, dynamics=dynamics, channel=channel, interval_s=interval_s,
        step_s=0.1, displaced_s=0.1, duration_s=240.0,
    )  # fmt: skip
    margins = Margins(runs)
    out = fly(plan, range(runs), batch=runs, watch=margins)
    print(
        f"{dynamics:10} {1.0 / interval_s:4.0f} Hz, loss {channel.loss:4.0%}: {np.mean(margins.least_m < 0.0):6.1%} "
        f"violated, 5th percentile {np.percentile(margins.least_m, 5):5.1f} m, {out.macs} collided, "
        f"{out.unfinished} did not arrive, median {np.median(out.arrival_s):.1f} s",
        flush=True,
    )


def main() -> None:
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else 300
    for dynamics in ("px4", "ardupilot"):
        for loss, interval_s in ((0.0, 0.1), (0.3, 1.0)):
            measure(dynamics, Channel(loss, latency_s=(0.1, 0.3)), interval_s, runs)


if __name__ == "__main__":
    main()
