"""A rival: another daemon on the same vehicle, started by mistake. Exactly one of them flies.

A daemon that steers says so in its HEARTBEAT, whose custom_mode an onboard controller is free to use: its claim, the
instant at which it engaged. Autopilots pass heartbeats on from link to link, so two daemons hear each other wherever
they are connected, and all compare the same numbers. The earliest claim stays, the later ones give way, whatever the
time between their starts. Clocks of two computers may disagree on which was first, never on which gives way. A
heartbeat without a claim may come from any daemon, so it takes back no claim of another: a claim ends by not being
renewed.

If heartbeats are not passed on, only what the autopilot flies after is left: see `other_writer`.
"""

from __future__ import annotations

TICKS_PER_S = 32_000
"""A claim counts steps of 31 us, so that no two daemons engage in the same one; it wraps after 37 hours."""

WRAP = 1 << 32
FRESH_S = 3.0
"""A claim that is not renewed for three heartbeats has ended."""

PATIENCE_S = 10.0
"""How long the earlier daemon counts on the later one to give way, which may not hear it."""

MOST = 8
"""Rivals that are kept; a vehicle has links for fewer."""


def claim_of(utc_s: float) -> int:
    """Claim of a daemon that engages at this time, never 0."""
    return int(utc_s * TICKS_PER_S) % WRAP or 1


def is_earlier(one: int, other: int) -> bool:
    """Whether a claim is older than another one, by less than half a round."""
    return 0 < (other - one) % WRAP < WRAP // 2


class Rivals:
    """Compares our claim with those of other daemons.

    Attributes:
        claim: Our claim; 0 while we steer nothing.
        answer: True if a rival has just made its claim: it should hear ours at once.
    """

    def __init__(self) -> None:
        self.claim = 0
        self.answer = False
        self._theirs: dict[int, tuple[float, float]] = {}

    def steer(self, steering: bool, utc_s: float | None) -> None:
        """Tell whether we steer in this step, and UTC now; the claim is made when steering begins."""
        if not steering:
            self.claim = 0
        elif not self.claim and utc_s is not None:
            self.claim = claim_of(utc_s)

    def hear(self, claim: int, now_s: float) -> None:
        """Take the claim of another daemon, from a heartbeat of our component on our vehicle; 0 for none."""
        self._forget_stale(now_s)
        known = claim in self._theirs
        if claim in (0, self.claim) or not (known or len(self._theirs) < MOST):
            return
        first_s, _ = self._theirs.get(claim, (now_s, now_s))
        self.answer = self.answer or not known
        self._theirs[claim] = first_s, now_s

    def must_yield(self, now_s: float) -> bool:
        """Whether another daemon steers this vehicle, and did so before us."""
        self._forget_stale(now_s)
        return any(self.claim == 0 or is_earlier(theirs, self.claim) for theirs in self._theirs)

    def gives_way(self, now_s: float) -> bool:
        """Whether another daemon steers this vehicle, too, and is about to stop or has just stopped."""
        self._forget_stale(now_s)
        return self.claim != 0 and any(
            is_earlier(self.claim, theirs) and now_s - first_s <= PATIENCE_S
            for theirs, (first_s, _) in self._theirs.items()
        )

    def _forget_stale(self, now_s: float) -> None:
        self._theirs = {claim: heard for claim, heard in self._theirs.items() if now_s - heard[1] <= FRESH_S}
