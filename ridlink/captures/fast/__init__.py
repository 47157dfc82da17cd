"""The fast path: whole blocks of a capture to columns, and columns to frames, in compiled loops.

tables    checksum tables, and where each message lies in its records; derived from the dialect
loading   bytes taken eight at a time, and the checksum over them
scanning  the loops that find frames and check them
copying   the loops that copy frames into columns, and columns into frames
calling   how they are called, with a compiler and without
block     an index of frames, and what is asked of it
datagrams what packets hold, in blocks
blocks    a file read block by block
sources   sequence numbers of many frames at once
"""
