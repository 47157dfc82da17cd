"""Changes for vehicles that do not obey at once; for all others nothing here changes anything.

Such vehicles turn sooner, among several further, and also for what others are about to fly, while few are heard. They
keep a larger buffer if they cruise slowly.
"""

from __future__ import annotations

from ridlink.avoidance.kernel import kernel

FEW, CROWD = 3, 7
"""Up to FEW neighbours the effect is whole; with more it is less, and with CROWD it is none: there, all would lose in
detours the time that few save."""

SOONER_HORIZONS = 1.25
"""How much earlier: a small turn in good time is shorter than a large one, and slows nobody down."""

WIDER_SHARE, SEVERAL = 0.4, 3
"""How much further: by this share for SEVERAL, which go round each other on a wider circle than two do, and not for
one."""


@kernel(forceinline=True, inner=True)
def earlier_and_wider(heard):  # type: ignore[no-untyped-def]
    """How many horizons sooner, and by which share further, a vehicle that obeys late turns, with so many heard; and
    how much the commands of the others count for its turn, beside their velocities [0, 1]."""
    few = min(max(CROWD - heard, 0), CROWD - FEW) / (CROWD - FEW)
    several = min(max(heard - 1, 0), SEVERAL - 1) / (SEVERAL - 1)
    return SOONER_HORIZONS * few, WIDER_SHARE * few * several, few


BRISK_MPS, SLOW_MPS = 8.0, 5.0
SLOW_BUFFER_SHARE = 0.08
"""By how much larger the buffer is at SLOW_MPS and below, less so up to BRISK_MPS. An error wanders by metres in a
second, and a slow vehicle gets out of its way more slowly. With it half as many come inside in a crowd at 5 m/s."""


def buffer_growth(cruise_mps: float, response_s: float) -> float:
    """Factor by which a vehicle's buffer exceeds `HalfplaneSettings.buffer_share`."""
    slow = min(max((BRISK_MPS - cruise_mps) / (BRISK_MPS - SLOW_MPS), 0.0), 1.0)
    return 1.0 + SLOW_BUFFER_SHARE * slow if response_s > 0.0 else 1.0


buffer_growth_in_kernels = kernel(forceinline=True, inner=True)(buffer_growth)
