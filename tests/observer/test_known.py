"""Who is known: what the tables find is what a search through everybody finds, and strangers fill no memory."""

from __future__ import annotations

import math

from hypothesis import example, given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from ridlink.observer import Aircraft, Sky
from ridlink.observer.known import SAME_AIRCRAFT_M, Known, called, is_repeated
from ridlink.remote_id.report import RemoteIdReport, SourceKey

METRE_DEG = 1.0 / 111_200.0
HERE = RemoteIdReport(
    source=(1, 1), uas_id=b"ALPHA", status=2, latitude_deg=47.0, longitude_deg=8.0, timestamp_s=0.0,
    velocity_ned_mps=(0.0, 0.0, 0.0), speed_horizontal_mps=0.0,
)  # fmt: skip


class Searched(Known):
    """The same by searching through everybody."""

    numbered = False

    def twin(
        self, report: RemoteIdReport, north_m: float, east_m: float, besides: SourceKey | None = None
    ) -> SourceKey | None:
        for key, one in self.aircraft.items():
            if key == besides:
                continue
            if report.uas_id is None or one.report.uas_id is None:
                same = is_repeated(report, one.report)
            else:
                near = math.hypot(one.north_m - north_m, one.east_m - east_m) <= SAME_AIRCRAFT_M
                same = near and one.report.uas_id == report.uas_id
            if same:
                return key
        return None

    def meet(self, report: RemoteIdReport, north_m: float, east_m: float, interval_s: float, now_s: float) -> Aircraft:
        if len(self.aircraft) >= self._most:
            oldest = min(self.aircraft.values(), key=lambda one: one.last_heard_s).last_heard_s
            # Of several that were silent for as long any may go, so the tables choose.
            assert self.aircraft[next(iter(self._by_silence))].last_heard_s == oldest
        new = super().meet(report, north_m, east_m, interval_s, now_s)
        self.is_well_named(report.key)
        return new

    def rename(self, key: SourceKey) -> None:
        super().rename(key)
        self.is_well_named(key)

    def is_well_named(self, key: SourceKey) -> None:
        """Nobody else is called so, and by no lower number, unless strangers call themselves by numbers."""
        name, wanted = self.aircraft[key].name, called(self.aircraft[key].report)
        taken = {one.name for other, one in self.aircraft.items() if other != key}
        assert name not in taken
        self.numbered = self.numbered or "#" in wanted
        if not self.numbered:
            assert name == next(it for it in (wanted, *(f"{wanted}#{n}" for n in range(2, 100))) if it not in taken)


report = st.builds(
    replace,
    st.just(HERE),
    source=st.tuples(st.integers(1, 6), st.just(1)),
    uas_id=st.sampled_from([None, b"ALPHA", b"BRAVO", b"ALPHA#2"]),
    latitude_deg=st.sampled_from([47.0 + metres * METRE_DEG for metres in (0.0, 30.0, 49.0, 51.0, 70.0, -200.0)]),
    altitude_geodetic_m=st.sampled_from([None, 0.5, 2.0]),
    timestamp_s=st.sampled_from([None, 0.0, 0.0505, 0.051, 0.102, 7.0]),
    extended=st.booleans(),
)


@settings(max_examples=300, deadline=None)
@given(
    st.lists(st.tuples(report, st.sampled_from([0.0, 0.1, 0.1, 4.0])), max_size=40),
    st.integers(2, 6),
    st.booleans(),
)
@example([(replace(HERE, source=(k, 1), latitude_deg=47.0 + k), 0.1) for k in range(1, 7)], 3, True)
def test_the_tables_find_whom_a_search_finds(
    heard: list[tuple[RemoteIdReport, float]], most: int, forgetting: bool
) -> None:
    quick, plain = Sky(max_aircraft=most), Sky(max_aircraft=most)
    plain._known = Searched(most)
    plain.aircraft = plain._known.aircraft
    now_s = 0.0
    for one, later_s in heard:
        now_s += later_s
        for sky in (quick, plain):
            sky.take(replace(one, received_at_s=now_s), now_s)
            if forgetting:
                sky.forget_silent(now_s)
        assert {key: (it.number, it.name, it.report, it.reports) for key, it in quick.aircraft.items()} == {
            key: (it.number, it.name, it.report, it.reports) for key, it in plain.aircraft.items()
        }
        assert quick.met == plain.met


def test_a_name_that_becomes_free_is_given_again() -> None:
    sky = Sky(forget_after_s=1.0)
    for k in range(4):
        sky.take(replace(HERE, source=(k + 1, 1), latitude_deg=47.0 + k), 0.5 * k)
    assert [one.name for one in sky.aircraft.values()] == ["ALPHA", "ALPHA#2", "ALPHA#3", "ALPHA#4"]
    assert [one.name for one in sky.forget_silent(1.6)] == ["ALPHA", "ALPHA#2"]
    for k in range(10, 13):
        sky.take(replace(HERE, source=(k, 1), latitude_deg=30.0 + k), 1.6)
    assert [one.name for one in sky.aircraft.values()] == ["ALPHA#3", "ALPHA#4", "ALPHA", "ALPHA#2", "ALPHA#5"]


def test_nobody_fills_the_memory_by_relaying_one_aircraft_under_ever_other_names() -> None:
    sky = Sky(max_aircraft=50)
    for k in range(1000):
        relayed = replace(HERE, source=(200, 1), id_or_mac=k.to_bytes(20, "little"), received_at_s=0.01 * k)
        assert sky.take(replace(relayed, timestamp_s=float(k)), 0.01 * k) is not None
    known = sky._known
    assert len(sky.aircraft) == 1 and sky.met == 1
    assert len(known._same_as) == sum(map(len, known._aliases.values())) == 50
    sky.forget_silent(100.0)
    assert not any((known._same_as, known._aliases, known._at, known._places, known._by_silence, known._names._taken))
