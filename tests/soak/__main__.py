"""Fly circle after circle and watch memory and timing: ``python -m tests.soak [MINUTES]`` (30 unless said).

The fleet, the air, the conductor and the recorder live in this process from flight to flight, so their growth shows;
the daemons are started anew. Ends with 1 if memory grows by more than 20 MB after the first flight, or one fails.
"""

from __future__ import annotations

import asyncio
import sys
import tempfile
import time
from pathlib import Path

from sitl_sim.autopilot import Start
from sitl_sim.demo.flight import fly
from sitl_sim.demo.options import DemoOptions, any_free_ports
from sitl_sim.demo.screen import Screen
from sitl_sim.fleet_config import FleetConfig

GROWTH_MB = 20.0


def resident_mb() -> float:
    for line in Path("/proc/self/status").read_text().splitlines():
        if line.startswith("VmRSS:"):
            return int(line.split()[1]) / 1024.0
    return 0.0


def main() -> int:
    minutes = float(sys.argv[1]) if len(sys.argv) > 1 else 30.0
    end = time.monotonic() + 60.0 * minutes
    first = 0.0
    failed = seed = 0
    with tempfile.TemporaryDirectory() as folder:
        while time.monotonic() < end:
            seed += 1
            log = Path(folder) / "flight.tlog"
            fleet = any_free_ports(FleetConfig(seed=seed, start=Start.HOLDING))
            result = asyncio.run(fly(DemoOptions(fleet=fleet, log=log), Screen(sys.stderr, quiet=True)))
            log.unlink(missing_ok=True)
            memory = resident_mb()
            first = first or memory
            failed += not result["passed"]
            timing = f"gap max {result['setpoint_gap_ms']['max']:.0f} ms, p99 {result['decision_ms']['p99']:.2f} ms"
            verdict = f"arrived {result['arrived']}/{result['vehicles']}  MACs {result['macs']}"
            print(f"seed {seed:4d}  {verdict}  {timing}  memory {memory:.0f} MB ({memory - first:+.1f})", flush=True)
    grown = resident_mb() - first
    print(f"{seed} flights, {failed} failed, memory grew by {grown:.1f} MB")
    return 1 if failed or grown > GROWTH_MB else 0


if __name__ == "__main__":
    sys.exit(main())
