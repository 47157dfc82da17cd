"""How late a message is, by the clock of its sender.

After a pause (a stopped process, a link that was stuck) messages arrive that are seconds old, all at once, and look
fresh to whoever dates them by their arrival. The difference between the sender's clock and ours is smallest for the
message that travelled fastest; what it is larger for another one, that one is late.
"""

from __future__ import annotations

CREEP = 0.2
"""The smallest difference is forgotten at this rate: clocks drift, and an emulator may run a little slow. A link that
from now on takes a second longer is thus believed again after five."""


class Lateness:
    """Fed with the sender's times in order, says how late each is."""

    def __init__(self) -> None:
        self._least_s: float | None = None
        self._at_s = 0.0

    def update(self, sent_s: float, received_at_s: float) -> float:
        """How late the message of this time is [s], 0 for the fastest so far.

        Args:
            sent_s: The sender's clock.
            received_at_s: Ours.
        """
        difference = received_at_s - sent_s
        if self._least_s is not None:
            least = self._least_s + CREEP * max(received_at_s - self._at_s, 0.0)
            difference, self._least_s = difference - least, least + min(difference - least, 0.0)
        else:
            difference, self._least_s = 0.0, difference
        self._at_s = received_at_s
        return max(difference, 0.0)

    def forget(self) -> None:
        """The sender's clock began anew."""
        self._least_s = None
