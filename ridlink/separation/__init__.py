"""Separation definitions of the paper: reports of a pair of vehicles -> the disc that must stay empty."""

from ridlink.separation.chance import ChanceBound
from ridlink.separation.definitions import Definition, Discs, Reported, bounded_interval, separation_discs
from ridlink.separation.volumes import mac_radius, uncertainty_diameter, unmac_diameter, unmac_radius

__all__ = [
    "ChanceBound",
    "Definition",
    "Discs",
    "Reported",
    "bounded_interval",
    "mac_radius",
    "separation_discs",
    "uncertainty_diameter",
    "unmac_diameter",
    "unmac_radius",
]
