"""The traffic on a broker: published for others to see, a foreign feed taken as traffic where asked for.

No topic ever steers a vehicle. `aiomqtt` (the library that was called asyncio-mqtt) stays behind `bridge`.
"""

from __future__ import annotations

from ridlink.mqtt.broker_url import BrokerUrl, parse_broker_url
from ridlink.mqtt.outbox import Outbox
from ridlink.mqtt.publisher import Publisher, PublisherSettings
from ridlink.mqtt.topics import Topics

__all__ = ["BrokerUrl", "Outbox", "Publisher", "PublisherSettings", "Topics", "parse_broker_url"]
