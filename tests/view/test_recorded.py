"""Recordings as histories: on one clock that never goes back, within their memory."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from ridlink.captures.tlog import TlogWriter
from ridlink.errors import CaptureError
from ridlink.view.recorded import read_history
from tests.observer.flights import Flyer, frames
from tests.view.serving import HEAD_ON, a_show

BEGIN_US = 1_700_000_000_000_000


def written(path: Path, flyers: list[Flyer], until_s: float, *begins_us: int) -> str:
    with TlogWriter(path) as writer:
        for begin_us in begins_us:
            for time_s, frame in frames(flyers, until_s):
                writer.write(begin_us + round(1e6 * time_s), frame.raw)
    return str(path)


def test_a_recording_that_needs_more_memory_is_kept_in_coarser_steps(tmp_path: Path) -> None:
    path = written(tmp_path / "long.tlog", HEAD_ON, 20.0, BEGIN_US)
    scenery, whole, _ = read_history([path])
    _, coarse, _ = read_history([path], memory_bytes=whole.bytes // 3)
    assert (whole.thinned, coarse.thinned) == (0, 2)
    assert coarse.bytes <= whole.bytes // 3
    whole_s, coarse_s = ([one.time_s for one in history] for history in (whole, coarse))
    assert coarse_s == whole_s[::4]
    assert (scenery.title, scenery.live, scenery.utc0_s) == ("long.tlog", False, pytest.approx(1.7e9, abs=2.0))


def test_logs_one_behind_the_other_are_shown_one_after_the_other(tmp_path: Path) -> None:
    path = written(tmp_path / "twice.tlog", HEAD_ON, 6.0, BEGIN_US + 100_000_000, BEGIN_US)
    _, history, _ = read_history([path])
    times = [one.time_s for one in history]
    assert times == sorted(times) and times[-1] < 20.0, "not a hundred seconds of nothing in between"
    flown = [float(one.table[0, 0]) for one in history if len(one)]
    assert flown != sorted(flown), "it flies its way twice"


def test_who_says_its_name_only_later_is_counted_once() -> None:
    assert a_show([replace(flyer, identity_from_s=1.0) for flyer in HEAD_ON]).vehicles == 2


def test_a_recording_without_remote_id_is_told(tmp_path: Path) -> None:
    path = written(tmp_path / "nobody.tlog", [], 1.0, BEGIN_US)
    with pytest.raises(CaptureError, match=r"nobody\.tlog"):
        read_history([path])
