"""Traffic as somebody sees it who flies none of it: who is in the air, how large every disc is, who meets whom.

known       aircraft by source, identity, place and name
sky         messages -> aircraft
scene       all of them at one instant, as arrays
discs       what each pair needs between it under a definition, and each vehicle's share of it
near        who is near whom, without looking at all pairs
pairs       which pairs are too near or soon will be, and who is nearest to whom
states      everybody as objects of JSON
encounters  who comes near whom: opened, followed, closed
"""

from __future__ import annotations

from ridlink.observer.discs import pair_discs, rings
from ridlink.observer.encounters import Encounter, EncounterLog, Phase
from ridlink.observer.known import Aircraft
from ridlink.observer.pairs import Pairs, closing_times, least_margin, nearest_of, pairs_at, pairs_of
from ridlink.observer.scene import Scene
from ridlink.observer.sky import Sky
from ridlink.observer.states import aircraft_states

__all__ = ["Aircraft", "Encounter", "EncounterLog", "Pairs", "Phase", "Scene", "Sky", "aircraft_states",
           "closing_times", "least_margin", "nearest_of", "pair_discs", "pairs_at", "pairs_of", "rings"]  # fmt: skip
