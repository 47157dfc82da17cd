"""Captures: recorded messages, read in constant memory even if they are damaged, and written record by record.

records     the record type that every reader yields, and the counters of damage
tlog, raw, hexlines, pcap, pcapng
            the formats; packet_window: the buffer through which pcap and pcapng are read
packets     the contents of pcap and pcapng: MAVLink in UDP and TCP, Open Drone ID in radio frames; layers: what
            network packets carry; tcp: the streams
broadcasts  messages of 25 bytes as records
reader      opens a capture by path and detects its format
follow      captures that still grow
messages    records to typed messages
lines       messages as lines: JSON for programs, aligned rows for people
statistics  counts of the messages in a capture; for large files, export/counting fills them
recorder    writes the datagrams of a link to a tlog, in a thread
columns     captures as numpy tables, by the compiled loops in fast; export: other formats
"""

from ridlink.captures.messages import MessageRecord, decode_records, read_messages
from ridlink.captures.reader import Capture, CaptureKind, open_capture
from ridlink.captures.records import Record, Rejects
from ridlink.captures.tlog import TlogWriter

__all__ = ["Capture", "CaptureKind", "MessageRecord", "Record", "Rejects", "TlogWriter", "decode_records",
           "open_capture", "read_messages"]  # fmt: skip
