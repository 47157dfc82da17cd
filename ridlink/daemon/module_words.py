"""What a transmitter module answers: whether it is good to arm, and if not, why.

Nothing is decided by it. Beside an autopilot, the module would tell that, which would then refuse to arm; fed by this
program, it tells nobody else.
"""

from __future__ import annotations

from collections import Counter

from ridlink.daemon.events import Events
from ridlink.links import Address
from ridlink.mavlink.codec import CRC_EXTRAS, decode_message
from ridlink.mavlink.frames import Frame, parse_datagram
from ridlink.remote_id.text import display_text

ARM_STATUS = 12918
GOOD_TO_ARM = 0
"""MAV_ODID_ARM_STATUS."""


class ModuleWords:
    """Takes OPEN_DRONE_ID_ARM_STATUS, and tells what is new.

    Args:
        events: Receives a ``module`` with `good_to_arm` and `text`.

    Attributes:
        counters: ``module_not_ready``: how often the module said so.
    """

    def __init__(self, events: Events) -> None:
        self.counters: Counter[str] = Counter()
        self._events = events
        self._said: tuple[bool, str] | None = None
        self._told: tuple[bool, str] | None = None

    def receive(self, data: bytes, _: Address) -> None:
        """Take a datagram of the module."""
        for found in parse_datagram(data, CRC_EXTRAS):
            if isinstance(found, Frame) and found.checked and found.msgid == ARM_STATUS:
                message = decode_message(found)
                self._said = message.status == GOOD_TO_ARM, display_text(message.error)
                self.counters["module_not_ready"] += not self._said[0]

    def tell(self) -> None:
        """Report what the module said last, if it is new; called once a second, so that no module floods a log."""
        if self._said is not None and self._said != self._told:
            self._told = self._said
            self._events.emit("module", good_to_arm=self._said[0], text=self._said[1])
