"""Remote ID: the only room where wire integers meet SI floats, and where wire sentinels become ``None``.

    messages    the Open Drone ID messages and RIDLINK_SEPARATION in SI units
    accuracy    accuracy codes and the bounds that they stand for
    convert     MAVLink messages to those and back
    report      one update of one vehicle, all that it says
    assembler   messages, one after the other, to reports
"""
