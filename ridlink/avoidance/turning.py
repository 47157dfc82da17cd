"""When and how far slow vehicles turn out of each other's way: sooner, and among several further, while few are heard.

Vehicles that obey at once turn as ever: what is found here changes nothing for them.
"""

from __future__ import annotations

from ridlink.avoidance.kernel import kernel

FEW, CROWD = 3, 7
"""So many heard or fewer are few; less is done among more, and nothing in a crowd: there everybody would make a detour
of the time that few save."""

SOONER_HORIZONS = 1.25
"""How much earlier: a small turn in time is shorter than a large one, and slows nobody down."""

WIDER_SHARE, SEVERAL = 0.4, 3
"""How much further: by so much for SEVERAL, who go round each other on a wider circle than two do, and not for one."""


@kernel(forceinline=True, inner=True)
def earlier_and_wider(heard):  # type: ignore[no-untyped-def]
    """By how many horizons sooner a slow vehicle turns, and by which share further, where so many are heard."""
    few = min(max(CROWD - heard, 0), CROWD - FEW) / (CROWD - FEW)
    several = min(max(heard - 1, 0), SEVERAL - 1) / (SEVERAL - 1)
    return SOONER_HORIZONS * few, WIDER_SHARE * few * several
