"""ridlink: drones avoid each other by the Remote ID that they hear.

``ridlink.decode(path)`` returns a capture as columns: one structured array for each message. Everything else is
imported from its subpackage; the subpackages form one line:

    bytes                     ridlink.links, ridlink.captures
    -> frames -> messages     ridlink.mavlink
    -> reports                ridlink.remote_id
    -> tracks                 ridlink.traffic, ridlink.own_ship
    -> separation discs       ridlink.separation
    -> admissible velocity    ridlink.avoidance
    -> setpoint -> bytes      ridlink.setpoint; ridlink.engine walks the whole line
"""

from __future__ import annotations

import importlib

TYPE_CHECKING = False  # importing `typing` would take half of the import time of the package
if TYPE_CHECKING:
    from typing import Any

    from ridlink.captures.columns import decode

    __version__: str

__all__ = ["decode"]


def __dir__() -> list[str]:
    return [*globals(), *__all__]


def __getattr__(name: str) -> Any:
    """Load ``decode`` and ``__version__`` only when they are used, so that importing the package stays fast."""
    if name == "decode":
        return importlib.import_module("ridlink.captures.columns").decode
    if name == "__version__":
        return importlib.import_module("importlib.metadata").version("ridlink")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
