"""Remote ID: the only package where wire integers become SI floats, and where wire sentinels become ``None``.

There are two wire forms: MAVLink messages, and the 25-byte messages that Wi-Fi and Bluetooth broadcast.

messages    the Open Drone ID messages and RIDLINK_SEPARATION in SI units
accuracy    accuracy codes and the bounds that they stand for
quantities  fields that are the same in both wire forms: positions, absolute times, errors and extents
location    LOCATION in both wire forms; likewise system, separation (ridlink's own) and identities (all others)
convert     MAVLink messages to SI messages and back; mavlink_fields: fields that several of them share
astm        25-byte messages to SI messages and back; astm_fields: shared fields; astm_pack: packs of several messages
radio       802.11 and Bluetooth frames to broadcasts
bridge      message packs and broadcasts between the radio and MAVLink
report      one update of one vehicle, with everything that it says
assembler   joins a sequence of messages into reports
"""
