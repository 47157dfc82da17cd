"""RIDLINK_SEPARATION, the message that ridlink adds to Remote ID: from numbers to bytes and back.

python examples/separation_message.py
"""

from ridlink.mavlink.codec import CRC_EXTRAS, Encoder, decode_message
from ridlink.mavlink.frames import Frame, parse_datagram
from ridlink.remote_id.convert import from_mavlink, to_mavlink
from ridlink.remote_id.messages import Separation, SeparationFlags

told = Separation(
    timestamp_s=1234.5,  # seconds after the full UTC hour, as in the LOCATION that it belongs to
    horizontal_error_m=10.503,  # three standard deviations
    airframe_size_m=0.6,
    update_interval_s=0.1,
    commanded_vx_mps=8.0,
    commanded_vy_mps=-3.5,
    commanded_vz_mps=0.0,
    flags=SeparationFlags.AVOIDING,
)

name, fields = to_mavlink(told)
frame_bytes = Encoder(sysid=1, compid=1).encode(name, **fields)
print(f"{name}: {len(frame_bytes)} bytes on the wire\n\n  {frame_bytes.hex(' ')}\n")

frame = parse_datagram(frame_bytes, CRC_EXTRAS)[0]
assert isinstance(frame, Frame)
heard = from_mavlink(decode_message(frame))
assert isinstance(heard, Separation)

print(f"{'field':20} {'told':>10} {'heard':>10}")
for field in Separation.__struct_fields__:
    before, after = getattr(told, field), getattr(heard, field)
    print(f"{field:20} {'unknown' if before is None else before:>10} {'unknown' if after is None else after:>10}")

print("\nErrors are rounded up, never down; what is not told is unknown, and a receiver then assumes the worst.")
