"""The recordings of a flight: a log of the bytes on the wire, and a log of all inputs of the engine."""

from __future__ import annotations

import asyncio
from collections import Counter

from ridlink.captures.recorder import Recorder
from ridlink.daemon.config import DaemonConfig, as_toml
from ridlink.daemon.input_log import FromAir, FromVehicle, InputLog
from ridlink.engine import StepOutput

LAST_RECORDS_S = 1.0
"""Longest wait for a slow disk at the end."""


class Recordings:
    """The recordings that the configuration requests. Calls do nothing for the others, or before `open`.

    Args:
        config: Configuration of the daemon: it names the files, and is the first input of the engine.

    Attributes:
        opened: Whether recording is possible from now on.
    """

    def __init__(self, config: DaemonConfig) -> None:
        self.opened = False
        self._config = config
        self._wire: Recorder | None = None
        self._inputs: InputLog | None = None

    def open(self) -> None:
        """Create the files; those of an earlier flight are replaced.

        Raises:
            ConfigError: If the input log cannot hold the configuration, see `as_toml`; nothing is replaced.
            OSError: If a file cannot be created.
        """
        if self._config.input_log is not None:
            self._inputs = InputLog(self._config.input_log, as_toml(self._config))
        if self._config.log is not None:
            self._wire = Recorder(self._config.log, overwrite=True)
        self.opened = True

    async def close(self) -> None:
        """Write what is queued, as far as the disk is fast enough."""
        for each in (self._wire, self._inputs):
            if each is not None:
                await asyncio.to_thread(each.close, LAST_RECORDS_S)

    def heard(self, datagram: FromVehicle | FromAir) -> None:
        """Record a datagram, before the engine gets it."""
        self.on_wire(datagram.data)
        if self._inputs is not None:
            self._inputs.heard(datagram)

    def on_wire(self, data: bytes) -> None:
        """Record bytes that were sent, or received and are no input of the engine."""
        if self._wire is not None:
            self._wire.receive(data)

    def step(self, now_s: float, hold: bool, warm: bool, utc_s: float | None) -> None:
        """Record a step, before the engine takes it."""
        if self._inputs is not None:
            self._inputs.step(now_s, hold, warm, utc_s)

    def decided(self, output: StepOutput, reason: str, took_s: float) -> None:
        """Record the result of the step, and its duration."""
        if self._inputs is not None:
            self._inputs.decided(output, reason)
            self._inputs.took(took_s)

    def stop(self, now_s: float) -> None:
        """Record that the engine is asked to end its stream."""
        if self._inputs is not None:
            self._inputs.stop(now_s)

    @property
    def wire_error(self) -> OSError | None:
        """The error that ended the log of the wire, such as a full disk; None while it continues."""
        return None if self._wire is None else self._wire.error

    @property
    def decision_log(self) -> str | None:
        """The hash of all decisions so far; None without an input log."""
        return None if self._inputs is None else self._inputs.decisions.digest

    @property
    def counters(self) -> Counter[str]:
        """Records that the disks did not take, by cause."""
        found: Counter[str] = Counter()
        for name, each in (("recording", self._wire), ("input_log", self._inputs)):
            if each is not None:
                found[f"{name}_dropped"] = each.dropped
                found[f"{name}_failed"] = each.error is not None
        return found
