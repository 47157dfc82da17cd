"""Remote ID: the only room where wire integers meet SI floats, and where wire sentinels become ``None``.

messages    the Open Drone ID messages and RIDLINK_SEPARATION in SI units
accuracy    accuracy codes and the bounds that they stand for
quantities  what both wires read and write alike: positions, absolute times, errors and extents
location    one message on both wires, as are system, separation (ours) and identities (the others)
convert     MAVLink messages to those and back; mavlink_fields: what several of them have
astm        25-byte broadcast messages to those and back; astm_fields, and astm_pack: several in one broadcast
radio       802.11 and Bluetooth frames to broadcasts
bridge      message packs and broadcasts between the radio and MAVLink
report      one update of one vehicle, all that it says
assembler   messages, one after the other, to reports
"""
