"""What a transmitter module answers: whether it is good to arm, and if not, why; and that it has fallen silent.

Nothing is decided by it. Beside an autopilot, the module would tell that, which would then refuse to arm; fed by this
program, it tells nobody else.
"""

from __future__ import annotations

from collections import Counter

from ridlink.daemon.events import Events
from ridlink.mavlink.codec import CRC_EXTRAS, decode_message
from ridlink.mavlink.frames import Frame, parse_datagram
from ridlink.remote_id.text import display_text

ARM_STATUS = 12918
GOOD_TO_ARM = 0
"""MAV_ODID_ARM_STATUS."""
SILENT_S = 3.0
"""Time without an answer after which ArduPilot takes a module for absent (`AP_OpenDroneID::pre_arm_check`)."""
SILENT = False, f"nothing heard from it for {SILENT_S:.0f} s"


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
        self._heard_s: float | None = None
        self._said: tuple[bool, str] | None = None
        self._told: tuple[bool, str] | None = None

    def receive(self, data: bytes, now_s: float) -> None:
        """Take a datagram of the module, received at `now_s` [s]."""
        for found in parse_datagram(data, CRC_EXTRAS):
            if isinstance(found, Frame) and found.checked and found.msgid == ARM_STATUS:
                message = decode_message(found)
                self._said = message.status == GOOD_TO_ARM, display_text(message.error)
                self._heard_s = now_s
                self.counters["module_not_ready"] += not self._said[0]

    def tell(self, now_s: float) -> None:
        """Report what the module said last, or that it has fallen silent, if that is new.

        Called once a second, so that no module floods a log.
        """
        if self._said is None or self._heard_s is None:
            return
        said = SILENT if now_s - self._heard_s > SILENT_S else self._said
        if said != self._told:
            self._told = said
            self._events.emit("module", good_to_arm=said[0], text=said[1])
