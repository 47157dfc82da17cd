"""The commands of the emulator, added to ``ridlink`` by the entry-point group ``ridlink.commands``."""

from __future__ import annotations

from sitl_sim.cli.demo_command import demo
from sitl_sim.cli.sim_command import sim

__all__ = ["demo", "sim"]
