"""Which messages of a capture are written out."""

from __future__ import annotations

from dataclasses import dataclass

from ridlink.captures.messages import MessageRecord


@dataclass(frozen=True, slots=True)
class Selection:
    """Messages by name, sender and time.

    Attributes:
        names: Names of messages; all where ``None``.
        source_system: Only this system id.
        since_us: Not before this time, microseconds since 1970.
        until_us: Before this time. With either limit, messages without a time are left out.
    """

    names: frozenset[str] | None = None
    source_system: int | None = None
    since_us: int | None = None
    until_us: int | None = None

    def takes(self, record: MessageRecord) -> bool:
        """Whether a message is to be written."""
        return (
            (self.names is None or record.name in self.names)
            and (self.source_system is None or record.source[0] == self.source_system)
            and self.takes_time(record.time_us)
        )

    def takes_time(self, time_us: int | None) -> bool:
        """Whether a time lies within the limits."""
        if self.since_us is None and self.until_us is None:
            return True
        if time_us is None:
            return False
        return (self.since_us is None or time_us >= self.since_us) and (
            self.until_us is None or time_us < self.until_us
        )
