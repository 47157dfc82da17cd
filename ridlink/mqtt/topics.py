"""Topics on the broker: ``{prefix}/v1/{site}/...``.

Names of aircraft come over the air and are not trusted. In a topic all their bytes but letters, digits, ``-``, ``.``
and ``_`` are written as ``%NN``, so no name can make a level, a wildcard or a control character.
"""

from __future__ import annotations

from functools import lru_cache
from urllib.parse import quote

from ridlink.errors import ConfigError

VERSION = "v1"
DEFAULT_PREFIX = "ridlink"
LONGEST_NAME = 120
LONGEST_PREFIX = 1000
"""Longest prefix in bytes; a topic has at most 65535, and some brokers take fewer."""


@lru_cache(4096)
def level(name: str) -> str:
    """A name as one level of a topic."""
    return quote(name[:LONGEST_NAME], safe="").replace("~", "%7E")


def object_id(name: str) -> str:
    """A name as an object id of Home Assistant, which takes letters, digits, ``-`` and ``_``.

    No two names share one: ``_`` begins an escape, as ``%`` does in a topic.
    """
    return level(name).replace("_", "%5F").replace(".", "%2E").replace("%", "_")


class Topics:
    """The topics of one site.

    Args:
        site: Name of the place of this receiver; the level by which several sites share a broker.
        prefix: First levels; may contain ``/``.

    Raises:
        ConfigError: If the site or prefix is empty, has a wildcard, or is too long.
    """

    def __init__(self, site: str, prefix: str = DEFAULT_PREFIX) -> None:
        for what, text in (("site", site), ("prefix", prefix)):
            if not text or not text.isprintable() or set(text) & set("+#") or text.strip("/") != text:
                raise ConfigError(f"{what} {text!r}: must be a name without + or #, as in {DEFAULT_PREFIX!r}")
            if len(text.encode()) > LONGEST_PREFIX:
                raise ConfigError(f"{what} {text[:20] + '...'!r}: has more than {LONGEST_PREFIX} bytes")
        self.root = f"{prefix}/{VERSION}/{level(site)}"
        self.availability = f"{self.root}/availability"
        """``online`` or ``offline``, retained; ``offline`` is also the last will."""
        self.info = f"{self.root}/info"
        """Version, definition, origin; retained."""
        self.alert = f"{self.root}/alert"
        """Discs entered, airframes that touched."""
        self.batch = f"{self.root}/batch"
        """All states of one instant."""

    def state(self, name: str) -> str:
        """Topic for the state of an aircraft."""
        return f"{self.root}/uas/{level(name)}/state"

    def aircraft_availability(self, name: str) -> str:
        """Topic that says whether an aircraft is heard; retained."""
        return f"{self.root}/uas/{level(name)}/availability"

    def encounter(self, pair: tuple[str, str]) -> str:
        """Topic for the encounter of two aircraft, whatever their order."""
        return f"{self.root}/encounter/{'~'.join(level(name) for name in sorted(pair))}"

    def are_heard_by(self, topic_filter: str) -> bool:
        """Whether a topic filter, perhaps of a shared subscription, matches any topic below the root."""
        asked, ours = topic_filter.split("/"), self.root.split("/")
        if asked[0] == "$share":
            asked = asked[2:]
        for level_asked, own in zip(asked, ours, strict=False):
            if level_asked == "#":
                return True
            if level_asked not in ("+", own):
                return False
        return len(asked) > len(ours)
