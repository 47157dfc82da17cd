"""What a daemon keeps of a flight: a log of what was on the wire, and one of all that its engine was told."""

from __future__ import annotations

import asyncio
from collections import Counter

from ridlink.captures.recorder import Recorder
from ridlink.daemon.config import DaemonConfig, as_toml
from ridlink.daemon.input_log import FromAir, FromVehicle, InputLog
from ridlink.engine import StepOutput

LAST_RECORDS_S = 1.0
"""At the end a slow disk is waited for so long and no longer."""


class Recordings:
    """Those that are asked for; every call does nothing for one that is not, or before it is opened.

    Args:
        config: Which ones, and what the engine is told first.

    Attributes:
        opened: What comes from now on can be recorded.
    """

    def __init__(self, config: DaemonConfig) -> None:
        self.opened = False
        self._config = config
        self._wire: Recorder | None = None
        self._inputs: InputLog | None = None

    def open(self) -> None:
        """Make the files; those of an earlier flight are replaced.

        Raises:
            OSError: If one cannot be made.
        """
        if self._config.log is not None:
            self._wire = Recorder(self._config.log, overwrite=True)
        if self._config.input_log is not None:
            self._inputs = InputLog(self._config.input_log, as_toml(self._config))
        self.opened = True

    async def close(self) -> None:
        """Write what is queued, as far as the disk takes it in time."""
        for each in (self._wire, self._inputs):
            if each is not None:
                await asyncio.to_thread(each.close, LAST_RECORDS_S)

    def heard(self, datagram: FromVehicle | FromAir) -> None:
        """A datagram, before the engine is told it."""
        self.sent(datagram.data)
        if self._inputs is not None:
            self._inputs.heard(datagram)

    def sent(self, data: bytes) -> None:
        """Bytes that are on the wire."""
        if self._wire is not None:
            self._wire.receive(data)

    def step(self, now_s: float, hold: bool, warm: bool, utc_s: float | None) -> None:
        """A step, before the engine takes it."""
        if self._inputs is not None:
            self._inputs.step(now_s, hold, warm, utc_s)

    def decided(self, output: StepOutput, reason: str, took_s: float) -> None:
        """What came of the step, and how long it took."""
        if self._inputs is not None:
            self._inputs.decided(output, reason)
            self._inputs.took(took_s)

    def stop(self, now_s: float) -> None:
        """The engine is told to end its stream."""
        if self._inputs is not None:
            self._inputs.stop(now_s)

    @property
    def wire_error(self) -> OSError | None:
        """What ended the log of the wire, such as a full disk; None while it goes on."""
        return None if self._wire is None else self._wire.error

    @property
    def decision_log(self) -> str | None:
        """The hash of all decisions so far; None without a log of what the engine was told."""
        return None if self._inputs is None else self._inputs.decisions.digest

    @property
    def counters(self) -> Counter[str]:
        """What disks did not take, by cause."""
        found: Counter[str] = Counter()
        for name, each in (("recording", self._wire), ("input_log", self._inputs)):
            if each is not None:
                found[f"{name}_dropped"] = each.dropped
                found[f"{name}_failed"] = each.error is not None
        return found
