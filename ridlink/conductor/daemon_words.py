"""What a conductor hears from the daemon: only HEARTBEAT and RIDLINK_STATUS on the vehicle's link."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field

AVOIDANCE_COMPONENT = 196
"""MAV_COMP_ID_OBSTACLE_AVOIDANCE."""

STATUS_ACTIVE = 4
"""MAV_STATE of a daemon that steers."""

SILENT_S = 3.5
"""After such a silence, of three heartbeats, the daemon counts as lost."""

ARRIVED_MPS, ARRIVED_WITHIN_M, ARRIVED_WORDS = 3.5, 4.0, 5
"""Signs of arrival: in five status messages, one a second, no conflict and a slow preferred velocity, which falls with
the distance left, while the vehicle stays in place."""

M_PER_DEG = 111_195.0


@dataclass(slots=True)
class DaemonWords:
    """The latest state that the daemon reported. Times are the caller's, in seconds."""

    heard_s: float = -math.inf
    active: bool = False
    calm: deque[tuple[float, float]] = field(default_factory=lambda: deque(maxlen=ARRIVED_WORDS))
    """Positions of the vehicle at the latest status messages with a slow preferred velocity [m north, m east]."""

    def is_heard(self, now_s: float) -> bool:
        """Whether the daemon was heard recently."""
        return now_s - self.heard_s <= SILENT_S

    def take_heartbeat(self, said: Mapping[str, int], now_s: float) -> None:
        """Take a HEARTBEAT of the daemon."""
        self.heard_s = now_s
        self.active = said["system_status"] == STATUS_ACTIVE

    def take_status(self, said: Mapping[str, int], latitude_deg: float, longitude_deg: float) -> None:
        """Take a RIDLINK_STATUS and the position of the vehicle."""
        preferred_mps = math.hypot(said["preferred_vx"], said["preferred_vy"]) / 100.0
        if not self.active or said["conflicts"] or preferred_mps > ARRIVED_MPS:
            self.calm.clear()
            return
        east = math.cos(math.radians(latitude_deg))
        self.calm.append((latitude_deg * M_PER_DEG, longitude_deg * M_PER_DEG * east))

    @property
    def has_arrived(self) -> bool:
        """Whether the vehicle has arrived, by `ARRIVED_WORDS`."""
        if len(self.calm) < ARRIVED_WORDS:
            return False
        return max(math.dist(self.calm[-1], place) for place in self.calm) <= ARRIVED_WITHIN_M
