"""The fast path: whole blocks of a capture to columns, and columns to frames, in compiled loops.

tables   checksum tables, and where each message lies in its records; derived from the dialect
kernels  the loops
blocks   a file read block by block, each with an index of its frames
"""
