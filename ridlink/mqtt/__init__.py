"""MQTT: publishes the traffic on a broker, and takes a foreign feed as traffic if configured.

No topic can steer a vehicle. Only `bridge` uses `aiomqtt` (the library that was called asyncio-mqtt).
"""

from __future__ import annotations

from ridlink.mqtt.broker_url import BrokerUrl, parse_broker_url
from ridlink.mqtt.outbox import Outbox
from ridlink.mqtt.publisher import Publisher, PublisherSettings
from ridlink.mqtt.topics import Topics

__all__ = ["BrokerUrl", "Outbox", "Publisher", "PublisherSettings", "Topics", "parse_broker_url"]
