"""Captures: recorded messages, read in constant memory and whatever their damage, written record by record.

records     what every reader yields, and how damage is counted
tlog, raw, hexlines, pcap, pcapng
            the formats; packet_window: the view through which the last two are read
packets     what the packets of a pcap or pcapng hold: MAVLink in UDP and TCP, Open Drone ID in radio frames
broadcasts  messages of 25 bytes as records
reader      captures by path: which format a file has
follow      captures that still grow
messages    records to typed messages
lines       messages as lines, for programs (JSON) and for eyes
statistics  what a capture holds, in counts; of large files taken by export/counting
"""

from ridlink.captures.messages import MessageRecord, decode_records, read_messages
from ridlink.captures.reader import Capture, CaptureKind, open_capture
from ridlink.captures.records import Record, Rejects
from ridlink.captures.tlog import TlogWriter

__all__ = ["Capture", "CaptureKind", "MessageRecord", "Record", "Rejects", "TlogWriter", "decode_records",
           "open_capture", "read_messages"]  # fmt: skip
