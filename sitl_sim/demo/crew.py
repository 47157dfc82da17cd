"""Several avoidance daemons in one process, separate from the fleet: ``python -m sitl_sim.demo.crew CONFIG.toml ...``.

Each reads its configuration file, as ``ridlink avoid --config`` does. Its events, and its summary at the end, are lines
of JSON on stdout with the key ``vehicle``. SIGTERM, SIGINT or SIGHUP ends all of them gently.
"""

from __future__ import annotations

import asyncio
import json
import os
import sys
from typing import Any

from ridlink.cli import EXIT_DONE, EXIT_IO
from ridlink.cli.signals import ending_signals
from ridlink.daemon.config import DaemonConfig, daemon_config
from ridlink.daemon.config_file import read_config_file
from ridlink.daemon.service import AvoidDaemon
from ridlink.errors import RidlinkError


def _say(vehicle: int | None, facts: dict[str, Any]) -> None:
    try:
        sys.stdout.write(json.dumps({"vehicle": vehicle, **facts}) + "\n")
        sys.stdout.flush()
    except BrokenPipeError:  # the demonstration has ended, so end, too
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


async def _fly(config: DaemonConfig, stop: asyncio.Event) -> None:
    vehicle = config.engine.vehicle_sysid
    summary = await AvoidDaemon(config, on_event=lambda facts: _say(vehicle, facts)).run(stop)
    _say(vehicle, {"event": "final", **summary.as_dict()})


async def _crew(configs: list[DaemonConfig]) -> None:
    stop = asyncio.Event()
    loop = asyncio.get_running_loop()
    for number in ending_signals():
        loop.add_signal_handler(number, stop.set)
    async with asyncio.TaskGroup() as group:
        for config in configs:
            group.create_task(_fly(config, stop))


def main(paths: list[str]) -> int:
    """Run the daemons of these configuration files; 3 if one of them cannot be started."""
    code = EXIT_DONE
    try:
        asyncio.run(_crew([daemon_config(read_config_file(path)) for path in paths]))
    except* RidlinkError as failed:
        print(f"ridlink: {failed.exceptions[0]}", file=sys.stderr)
        code = EXIT_IO
    return code


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
