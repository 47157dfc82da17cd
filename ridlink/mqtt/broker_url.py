"""Address of a broker: ``mqtt://HOST[:PORT]`` or, encrypted, ``mqtts://HOST[:PORT]``."""

from __future__ import annotations

from dataclasses import dataclass
from urllib.parse import unquote, urlsplit

from ridlink.errors import ConfigError

PORTS = {"mqtt": 1883, "mqtts": 8883}


@dataclass(frozen=True, slots=True)
class BrokerUrl:
    """A broker.

    Args:
        host: Name or address.
        port: Port.
        encrypted: TLS, with the certificate checked.
        user: User name, None for none; special characters in a URL as ``%NN``. A URL never has the password.
    """

    host: str
    port: int
    encrypted: bool
    user: str | None = None

    def __str__(self) -> str:
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{'mqtts' if self.encrypted else 'mqtt'}://{host}:{self.port}"


def parse_broker_url(text: str) -> BrokerUrl:
    """The broker that a URL names.

    Raises:
        ConfigError: If the text is no such URL; the error shows a right one.
    """

    def refuse(reason: str) -> ConfigError:
        return ConfigError(f"broker {text.split('@')[-1]!r}: {reason}; write mqtt://127.0.0.1:1883")

    try:
        parts = urlsplit(text if "://" in text else f"none://{text}")
    except ValueError as error:  # its text quotes the URL, perhaps with a part of a password
        raise refuse("no host that can be one") from error
    try:
        port = parts.port
    except ValueError as error:
        raise refuse("the port is no number from 1 to 65535") from error
    if port == 0:
        raise refuse("the port is no number from 1 to 65535")
    if parts.scheme not in PORTS:
        raise refuse(f"'{parts.scheme}://' is no scheme for it" if parts.scheme != "none" else "no scheme")
    if parts.password is not None:
        raise ConfigError("broker: a password in a URL ends up in logs; use --password-file or RIDLINK_MQTT_PASSWORD")
    if not parts.hostname:
        raise refuse("no host")
    if parts.path.strip("/") or parts.query or parts.fragment:
        raise refuse("nothing may follow the port")
    user = None if parts.username is None else unquote(parts.username)
    return BrokerUrl(parts.hostname, port or PORTS[parts.scheme], parts.scheme == "mqtts", user)
