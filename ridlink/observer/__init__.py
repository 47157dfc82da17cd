"""Traffic as an observer sees it: which aircraft are in the air, how large every disc is, and which pairs meet.

known       finds known aircraft by source, identity, position and name
sky         Remote ID messages to aircraft
scene       all aircraft at one instant, as arrays
discs       the distance that each pair needs under a definition, and each vehicle's share of it
near        finds pairs that are near each other without comparing all pairs
pairs       the pairs that are or soon will be too near, and the nearest neighbour of each aircraft
states      all aircraft as JSON objects
encounters  encounters of pairs: opened, followed, closed
"""

from __future__ import annotations

from ridlink.observer.discs import discs_at, largest_disc, rings
from ridlink.observer.encounters import Encounter, EncounterLog, Phase
from ridlink.observer.known import Aircraft
from ridlink.observer.near import within
from ridlink.observer.pairs import Pairs, least_margin, nearest_of, pairs_at, pairs_of
from ridlink.observer.scene import Scene
from ridlink.observer.sky import Sky
from ridlink.observer.states import aircraft_states

__all__ = ["Aircraft", "Encounter", "EncounterLog", "Pairs", "Phase", "Scene", "Sky", "aircraft_states", "discs_at",
           "largest_disc", "least_margin", "nearest_of", "pairs_at", "pairs_of", "rings", "within"]  # fmt: skip
