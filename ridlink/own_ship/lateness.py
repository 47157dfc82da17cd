"""How late a message is, by the clock of its sender.

After a pause (a stopped process, a link that was stuck) messages arrive all at once. They are seconds old, but look
fresh if they are dated by their arrival. The difference between our clock and the sender's is smallest for the message
that travelled fastest. Another message is as late as its difference is larger.
"""

from __future__ import annotations

CREEP = 0.2
"""The smallest difference is forgotten at this rate: clocks drift, and an emulator may run a little slow. So a link
that from now on takes a second longer is believed again after five."""


class Lateness:
    """Takes the sender's times in order, and says how late each is."""

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
        """Forget the past: the sender's clock began anew."""
        self._least_s = None
