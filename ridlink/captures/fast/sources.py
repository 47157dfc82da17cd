"""Sequence numbers of many frames at once."""

from __future__ import annotations

import numpy as np

from ridlink.captures.statistics import LEAP, SourceCount


def count_sources(
    sources: dict[tuple[int, int], SourceCount], seqs: np.ndarray, sysids: np.ndarray, compids: np.ndarray
) -> None:
    """What `SourceCount.see` does with each sequence number."""
    if not len(seqs):
        return
    keys = sysids.astype(np.uint16) << 8 | compids
    order = np.argsort(keys, kind="stable")
    keys, seqs = keys[order].astype(np.int64), seqs[order]
    firsts = np.flatnonzero(np.diff(keys, prepend=-1))
    found = [sources.setdefault((key >> 8, key & 0xFF), SourceCount()) for key in keys[firsts].tolist()]
    before = np.roll(seqs, 1)
    for first, source in zip(firsts.tolist(), found, strict=True):
        before[first] = seqs[first] if source.last_seq is None else source.last_seq
    steps = (seqs - before).astype(np.int64)  # bytes go round at 256
    missing = np.maximum(steps - 1, 0)  # a repeated one is a duplicate
    parts = np.stack([np.ones_like(missing), missing > 0, missing, missing >= LEAP])
    last_seqs = seqs[np.append(firsts[1:], len(seqs)) - 1]
    figures = np.vstack([np.add.reduceat(parts, firsts, axis=1), last_seqs])
    for source, more in zip(found, figures.T.tolist(), strict=True):
        source.add(*more)
