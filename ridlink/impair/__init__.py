"""A simulated bad network: loss, bursts, delay, jitter, duplicates, disorder, damage and a rate cap, from a seed."""

from __future__ import annotations

from ridlink.impair.model import Impairer, Impairment
from ridlink.impair.proxy import Proxy, open_proxy

__all__ = ["Impairer", "Impairment", "Proxy", "open_proxy"]
