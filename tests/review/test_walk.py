"""Scenes come on the recording's own clock, whatever its times do."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ridlink.captures import reader
from ridlink.errors import CaptureError
from ridlink.observer import Scene
from ridlink.review import Source, Walk, together
from ridlink.review.approach import nearest_since
from ridlink.view.recorded import read_history
from tests.captures.conftest import START_US, tlog_bytes
from tests.captures.pcap_files import ethernet, ipv4, pcap, udp
from tests.observer.flights import Flyer, a_crowd, frames
from tests.review.recordings import NORTHBOUND, SOUTHBOUND, START_S, recorded, records


class Seen:
    """Keeps all scenes."""

    def __init__(self) -> None:
        self.scenes: list[Scene] = []
        self.ends = 0

    def step(self, scene: Scene) -> None:
        self.scenes.append(scene)

    def end(self) -> None:
        self.ends += 1


def walked(*paths: Path) -> tuple[Walk, Seen]:
    seen = Seen()
    walk = Walk([seen])
    walk.through(together([Source(str(path)) for path in paths]))
    return walk, seen


def test_a_scene_every_tenth_of_a_second_of_the_recording(tmp_path: Path) -> None:
    walk, seen = walked(recorded(tmp_path / "f.tlog", [NORTHBOUND, SOUTHBOUND], 5.0))
    times = [scene.time_s - START_S for scene in seen.scenes]
    assert times == pytest.approx(np.arange(50) / 10.0, abs=1e-5)
    at = seen.scenes[30].position_ne_m
    assert at[0] - at[1] == pytest.approx(np.subtract(NORTHBOUND.at(3.0), SOUTHBOUND.at(3.0)), abs=0.05), (
        "all that was heard by an instant is in its scene"
    )
    assert (walk.aircraft, walk.scenes, seen.ends) == (2, 50, 1)


def test_who_fell_silent_is_not_flown_on_and_a_hole_makes_no_scenes(tmp_path: Path) -> None:
    path = tmp_path / "f.tlog"
    day_us = START_US + 86_400_000_000
    path.write_bytes(tlog_bytes(records([NORTHBOUND], 2.0) + records([SOUTHBOUND], 2.0, from_us=day_us)))
    _, seen = walked(path)
    assert len(seen.scenes) < 150
    ghosts = [scene for scene in seen.scenes if 2.3 < scene.time_s - START_S < 80_000.0]
    assert ghosts and not any(map(len, ghosts))


def test_who_is_not_heard_again_is_flown_on_to_its_next_report_at_most(tmp_path: Path) -> None:
    path = tmp_path / "f.tlog"
    gone = records([NORTHBOUND], 2.0)
    path.write_bytes(tlog_bytes(sorted(gone + records([SOUTHBOUND], 5.0), key=lambda record: record[0])))
    _, seen = walked(path)
    assert max(scene.time_s for scene in seen.scenes if len(scene) == 2) - START_S == pytest.approx(2.0, abs=0.01)


def test_who_is_heard_again_was_there_meanwhile(tmp_path: Path) -> None:
    path = tmp_path / "f.tlog"
    lossy = [record for record in records([NORTHBOUND], 4.0) if not 1.95e6 < record[0] - START_US < 2.15e6]
    path.write_bytes(tlog_bytes(sorted(lossy + records([SOUTHBOUND], 4.0), key=lambda record: record[0])))
    _, seen = walked(path)
    assert all(len(scene) == 2 for scene in seen.scenes)


def test_time_that_goes_back_begins_another_recording(tmp_path: Path) -> None:
    path = tmp_path / "f.tlog"
    later_us = START_US + 3_600_000_000
    path.write_bytes(tlog_bytes(records([NORTHBOUND], 2.0, from_us=later_us) + records([SOUTHBOUND], 2.0)))
    walk, seen = walked(path)
    assert seen.ends == 2 and walk.aircraft == 2
    assert all(len(scene) <= 1 for scene in seen.scenes)
    assert walk.begun_us == START_US


def test_logs_of_two_vehicles_are_one_flight_and_what_both_hold_is_taken_once(tmp_path: Path) -> None:
    both = records([NORTHBOUND, SOUTHBOUND], 3.0)
    one, other = tmp_path / "one.tlog", tmp_path / "other.tlog"
    one.write_bytes(tlog_bytes([record for at, record in enumerate(both) if at % 5]))
    other.write_bytes(tlog_bytes([(time_us + 40_000, frame) for time_us, frame in both]))
    _, seen = walked(one, other)
    alone, _ = walked(one)
    assert alone.aircraft == 2
    assert seen.scenes[-1].interval_s == pytest.approx([0.1, 0.1], abs=0.02), "heard twice is not twice as often"
    assert len(list(together([Source(str(one)), Source(str(other))]))) == len(both)


def test_a_large_file_is_read_as_a_small_one_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = recorded(tmp_path / "f.tlog", [NORTHBOUND, SOUTHBOUND], 3.0)
    small = [(time_us, frame.raw) for time_us, frame in together([Source(str(path))])]
    monkeypatch.setattr(reader, "LARGE_BYTES", 1)
    large = Source(str(path))
    assert [(time_us, frame.raw) for time_us, frame in together([large])] == small
    assert large.position == large.size == path.stat().st_size


def test_a_pcap_of_the_same_flight_is_the_same(tmp_path: Path) -> None:
    flight = records([NORTHBOUND, SOUTHBOUND], 2.0)
    tlog, sniffed = tmp_path / "f.tlog", tmp_path / "f.pcap"
    tlog.write_bytes(tlog_bytes(flight))
    sniffed.write_bytes(pcap([(time_us, ethernet(ipv4(udp(frame)))) for time_us, frame in flight]))
    (_, one), (_, other) = walked(tlog), walked(sniffed)
    assert [scene.time_s for scene in one.scenes] == [scene.time_s for scene in other.scenes]
    assert one.scenes[-1].position_ne_m == pytest.approx(other.scenes[-1].position_ne_m)


@pytest.mark.parametrize("suffix", ["mavlink", "hex"])
def test_a_capture_without_times_is_refused(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"f.{suffix}"
    said = [frame for _, frame in records([NORTHBOUND], 1.0)]
    path.write_bytes(b"".join(said) if suffix == "mavlink" else b"\n".join(frame.hex().encode() for frame in said))
    with pytest.raises(CaptureError, match="has no times"):
        Source(str(path))


@pytest.mark.parametrize("time_us", [0, 2**64 - 1])
@pytest.mark.parametrize("large", [10**12, 0])
def test_a_log_of_a_logger_without_a_clock_is_refused(
    tmp_path: Path, time_us: int, large: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its times are all 0, or all bits are set; they were taken for those of a recording in which nobody is heard."""
    monkeypatch.setattr(reader, "LARGE_BYTES", large)
    path, other = tmp_path / "f.tlog", recorded(tmp_path / "other.tlog", [SOUTHBOUND], 1.0)
    path.write_bytes(tlog_bytes([(time_us, frame) for _, frame in records([NORTHBOUND], 1.0)]))
    source = Source(str(path))
    assert (
        not list(source) and str(source.error) == f"{path}: none of its messages has a time, and encounters need them"
    )
    with pytest.raises(CaptureError, match="none of its messages has a time"):
        read_history([str(path)])
    source = Source(str(other))
    assert list(source) and source.error is None


@given(st.lists(st.tuples(st.integers(0, 2**63), st.integers(0, 5)), max_size=40))
def test_no_times_whatever_stop_it(jumps: list[tuple[int, int]]) -> None:
    flight = list(frames([NORTHBOUND, replace(SOUTHBOUND, extended=False)], 0.2))
    seen = Seen()
    walk = Walk([seen])
    for time_us, which in jumps:
        walk.receive(time_us, flight[which][1])
    walk.end()
    assert walk.scenes <= 110 * (len(jumps) + 1)


def test_the_approach_between_two_scenes_is_that_of_the_straight_lines(tmp_path: Path) -> None:
    fast = Flyer(1, (-5.0, 0.0), (80.0, 0.0), b"FAST")
    still = Flyer(2, (0.0, 1.0), (0.0, 0.0), b"STILL")
    _, seen = walked(recorded(tmp_path / "f.tlog", [fast, still], 0.3))
    approach = nearest_since(seen.scenes[0], seen.scenes[1], np.inf)
    assert (approach.first.tolist(), approach.second.tolist()) == ([0], [1])
    assert approach.distance_m == pytest.approx([1.0], abs=0.05)
    assert approach.time_s - START_S == pytest.approx([5.0 / 80.0], abs=0.002)
    alone = nearest_since(None, seen.scenes[0], np.inf)
    assert alone.distance_m == pytest.approx([26**0.5], abs=0.05) and alone.lasted_s == 0.0


@given(st.floats(0.0, 1200.0), st.floats(0.0, 10.0), st.integers(0, 99))
def test_pairs_that_did_not_come_so_near_are_left_out_and_no_others(within_m: float, ahead_s: float, seed: int) -> None:
    before = replace(a_crowd(seed, 40, 1000.0), time_s=-10.0)
    scene = replace(a_crowd(seed + 1, 40, 1000.0), numbers=tuple(range(10, 50)))  # the last ten are new
    everybody, some = nearest_since(before, scene, np.inf), nearest_since(before, scene, within_m, ahead_s=ahead_s)
    offsets = np.diff(scene.position_ne_m[[everybody.first, everybody.second]], axis=0)[0]
    speeds = np.diff(scene.velocity_ne_mps[[everybody.first, everybody.second]], axis=0)[0]
    then = np.hypot(*(offsets + ahead_s * speeds).T)
    wanted = (everybody.distance_m <= within_m) | (then <= within_m)
    found = np.isin(40 * everybody.first + everybody.second, 40 * some.first + some.second)
    assert found[wanted].all() and len(some.first) == found.sum()
    for name in ("first", "second", "distance_m", "time_s", "lasted_s"):
        assert np.array_equal(getattr(everybody, name)[found], getattr(some, name))


def test_of_many_that_are_far_from_each_other_few_pairs_are_looked_at() -> None:
    scene = a_crowd(1, 500, 20_000.0)
    apart = replace(scene, position_ne_m=scene.position_ne_m + 30.0 * np.arange(500)[:, None])
    assert len(nearest_since(None, apart, 100.0).first) < 1000 < len(nearest_since(None, apart, np.inf).first)
