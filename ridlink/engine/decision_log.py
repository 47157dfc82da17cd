"""Decisions, step by step, as lines that are equal if the decisions are, and their hash."""

from __future__ import annotations

import hashlib
import math
from typing import Any

import msgspec

from ridlink.engine.decision import StepOutput
from ridlink.traffic.track import Track


def decision_line(output: StepOutput, reason: str) -> bytes:
    """One step as a line of JSON, every number exact.

    Args:
        output: The step.
        reason: Reason of the state of the failsafe ladder.
    """
    record = output.decision
    sent = (*output.to_vehicle, *output.to_air, *output.to_transmitter, *output.broadcasts)
    return msgspec.json.encode(
        {
            "t": record.time_s,
            "state": record.state.name.lower(),
            "reason": reason,
            "tracks": record.tracks,
            "conflicts": [[*_name(conflict.track), conflict.entry_s, conflict.miss_m] for conflict in record.conflicts],
            "nearest_margin_m": record.nearest_margin_m if math.isfinite(record.nearest_margin_m) else None,
            "preferred_ned_mps": record.preferred_ned_mps,
            "commanded_ned_mps": record.commanded_ned_mps,
            "status": None if record.status is None else record.status.name.lower(),
            "binding": [_name(track) for track in record.binding],
            "recovering": record.recovering,
            "warnings": output.warnings,
            "sent": [frame.hex() for frame in sent],
        }
    )


def _name(track: Track) -> list[Any]:
    link, sysid, compid, id_or_mac, number = track.key
    return [str(link), sysid, compid, None if id_or_mac is None else id_or_mac.hex(), number]


class DecisionHash:
    """SHA-256 over the lines of a flight."""

    def __init__(self) -> None:
        self._hash = hashlib.sha256()
        self.steps = 0

    def add(self, line: bytes) -> None:
        """Add the line of one more step."""
        self._hash.update(line + b"\n")
        self.steps += 1

    @property
    def digest(self) -> str:
        """Hash of all lines so far, in hexadecimal."""
        return self._hash.hexdigest()
