"""A rival: another daemon on the same vehicle, started by mistake. Exactly one of them flies.

Who steers says so in its HEARTBEAT, whose custom_mode an onboard controller is free to use: its claim, the instant at
which it engaged. Autopilots pass heartbeats on from link to link, so two daemons hear each other wherever they are
connected, and all compare the same numbers: the earliest claim stays, the later ones give way, whatever the time
between their starts. Clocks of two computers may disagree on who was first, never on who gives way. A heartbeat
without a claim is anybody's of them: it takes back no claim of another one, a claim ends by not being renewed.

Where heartbeats are not passed on, what is left is what the autopilot flies after: see `other_writer`.
"""

from __future__ import annotations

TICKS_PER_S = 32_000
"""A claim counts steps of 31 us, so that no two daemons engage in the same one; it comes round after 37 hours."""

WRAP = 1 << 32
FRESH_S = 3.0
"""A claim not renewed for three heartbeats is no claim any more."""

PATIENCE_S = 10.0
"""So long the earlier one counts on the later one to give way, which may not hear us."""

MOST = 8
"""Rivals that are kept; a vehicle has links for fewer."""


def claim_of(utc_s: float) -> int:
    """The claim of a daemon that engages at this time, never 0."""
    return int(utc_s * TICKS_PER_S) % WRAP or 1


def is_earlier(one: int, other: int) -> bool:
    """Whether a claim is older than another one, less than half a round apart."""
    return 0 < (other - one) % WRAP < WRAP // 2


class Rivals:
    """Fed with the claims of others and with our own.

    Attributes:
        claim: Ours; 0 while we steer nothing.
        answer: A rival has just made its claim: it should hear ours at once.
    """

    def __init__(self) -> None:
        self.claim = 0
        self.answer = False
        self._theirs: dict[int, tuple[float, float]] = {}

    def steer(self, steering: bool, utc_s: float | None) -> None:
        """Whether we steer in this step, and UTC now; the claim is made when it begins."""
        if not steering:
            self.claim = 0
        elif not self.claim and utc_s is not None:
            self.claim = claim_of(utc_s)

    def hear(self, claim: int, now_s: float) -> None:
        """Take the claim in a heartbeat of our own component on our own vehicle that is not ours; 0 for none."""
        self._forget_stale(now_s)
        known = claim in self._theirs
        if claim in (0, self.claim) or not (known or len(self._theirs) < MOST):
            return
        first_s, _ = self._theirs.get(claim, (now_s, now_s))
        self.answer = self.answer or not known
        self._theirs[claim] = first_s, now_s

    def must_yield(self, now_s: float) -> bool:
        """Another daemon steers this vehicle, and did before us."""
        self._forget_stale(now_s)
        return any(self.claim == 0 or is_earlier(theirs, self.claim) for theirs in self._theirs)

    def gives_way(self, now_s: float) -> bool:
        """Another daemon steers this vehicle, too, and is about to stop, or has just done so."""
        self._forget_stale(now_s)
        return self.claim != 0 and any(
            is_earlier(self.claim, theirs) and now_s - first_s <= PATIENCE_S
            for theirs, (first_s, _) in self._theirs.items()
        )

    def _forget_stale(self, now_s: float) -> None:
        self._theirs = {claim: heard for claim, heard in self._theirs.items() if now_s - heard[1] <= FRESH_S}
