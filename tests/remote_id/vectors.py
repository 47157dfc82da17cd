"""The golden vectors of the 25-byte messages, and any bytes that are such a message."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from hypothesis import strategies as st

from ridlink.remote_id.astm import MESSAGE_LENGTH, refusal_of
from ridlink.remote_id.messages import MAVLINK_NAMES, RemoteIdMessage

VECTORS: list[dict[str, Any]] = [
    json.loads(line)
    for line in (Path(__file__).parents[2] / "message_spec" / "vectors" / "astm.jsonl").read_text().splitlines()
]
SINGLE = [vector for vector in VECTORS if "fields" in vector]
PACKS = [vector for vector in VECTORS if "messages" in vector]
KINDS = {name: kind for kind, name in MAVLINK_NAMES.items()}
BYTES = {"uas_id", "description", "operator_id", "authentication_data"}
any_25_bytes = st.binary(min_size=MESSAGE_LENGTH, max_size=MESSAGE_LENGTH)
messages_25 = any_25_bytes.map(lambda data: bytes((data[0] % 0x60,)) + data[1:]).filter(lambda d: not refusal_of(d))


def message_of(vector: dict[str, Any]) -> RemoteIdMessage:
    fields = {name: bytes.fromhex(value) if name in BYTES else value for name, value in vector["fields"].items()}
    message: RemoteIdMessage = KINDS[vector["type"]](**fields)
    return message
