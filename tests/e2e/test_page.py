"""The live page in a browser: a running demo, watched, dragged back, judged under another definition, opened again.

Needs Chromium and Playwright; ``make e2e`` runs it, ``make test`` does not. Pictures of what was seen stay in
``e2e-out/``.
"""

from __future__ import annotations

import contextlib
import json
import math
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import psutil
import pytest

pytest.importorskip("uvicorn", reason="needs ridlink[web]")

from websockets.sync.client import connect

from ridlink.view.server import MOST_PAGES
from tests.e2e.page import (
    FLAGS,
    LOW,
    NARROW,
    PICTURES,
    TABLET,
    WIDE,
    Visit,
    chromium,
    crowd,
    frames_and_work,
    quantile,
    ridlink,
    write_tlog,
)
from tests.observer.flights import Flyer

pytestmark = pytest.mark.e2e


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    playwright = pytest.importorskip("playwright.sync_api", reason="needs playwright: pip install 'ridlink[e2e]'")
    if not Path(chromium()).exists():
        pytest.skip("needs Chromium: apt-get install chromium, or name one in CHROMIUM")
    PICTURES.mkdir(exist_ok=True)
    with playwright.sync_playwright() as p:
        launched = p.chromium.launch(executable_path=chromium(), args=FLAGS)
        yield launched
        launched.close()


@pytest.fixture(scope="module")
def demo() -> Iterator[str]:
    with ridlink("demo", "--seed", "1", "--view-port", "0", "--stay") as address:
        yield address


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """Eight who fly straight over one point, one second apart, and avoid nobody."""
    path = tmp_path_factory.mktemp("page") / "crossing.tlog"
    courses = [math.radians(45.0 * i) for i in range(8)]
    flyers = [
        Flyer(
            i + 1,
            (-(120.0 + 10.0 * i) * math.cos(course), -(120.0 + 10.0 * i) * math.sin(course)),
            (10.0 * math.cos(course), 10.0 * math.sin(course)),
            identity=f"CROSS-{i + 1}".encode(),
        )
        for i, course in enumerate(courses)
    ]
    write_tlog(path, flyers, seconds=30.0)
    with ridlink("view", str(path), "--port", "0") as address:
        yield address


def moved(before: tuple[float, float], after: tuple[float, float]) -> float:
    return ((after[0] - before[0]) ** 2 + (after[1] - before[1]) ** 2) ** 0.5


def beyond_the_strip_px(page: Any) -> float:
    """How far the playhead gets past the end of the curves at most, in two seconds [px]."""
    return page.evaluate(  # type: ignore[no-any-return]
        """() => new Promise(resolve => {
             const of = name => document.querySelector(name).getBoundingClientRect().right, begun = performance.now();
             let most = -Infinity;
             const frame = () => {
               most = Math.max(most, of('.playhead') - 1 - of('#strip .u-over'));
               if (performance.now() - begun < 2000) requestAnimationFrame(frame); else resolve(most);
             };
             requestAnimationFrame(frame);
           })"""
    )


def test_a_demo_is_watched_dragged_back_and_judged(browser: Any, demo: str) -> None:
    visit = Visit(browser, demo)
    page = visit.page

    # Eight vehicles, and they move.
    visit.until("shown.vehicles === '8'")
    page.get_by_role("tab", name="Vehicles").click()
    visit.until("document.querySelectorAll('#vehicles tr[data-name^=RDLK][data-north]').length === 8")
    before, at = visit.positions(), visit.number("t")
    visit.until(
        f"""[...document.querySelectorAll('#vehicles tr')].every(row => {{
            const [north, east] = ({json.dumps(before)})[row.dataset.name] ?? [NaN, NaN];
            return Math.hypot(row.dataset.north - north, row.dataset.east - east) > 40;
        }})""",
        timeout_s=120.0,
    )
    assert visit.shown()["following"] == "true"
    assert beyond_the_strip_px(page) <= 1.0
    visit.picture("demo-live")

    # Rings grow with the definition.
    page.get_by_label("Candidate 2", exact=True).check()
    visit.until("shown.definition === 'candidate2' && shown.rings !== ''")
    small = [float(radius) for radius in visit.shown()["rings"].split(",")]
    page.get_by_label("Remote ID", exact=True).check()
    visit.until("shown.definition === 'remote-id' && Number(shown.rings.split(',')[2]) > 40")
    large = [float(radius) for radius in visit.shown()["rings"].split(",")]
    assert small[0] < small[1] < small[2] < large[2] and large[2] > 40.0
    page.get_by_label("Candidate 2", exact=True).check()

    # Dragged back, vehicles are where they were.
    scrubber = page.locator("#scrubber").bounding_box()
    y = scrubber["y"] + scrubber["height"] / 2
    page.mouse.move(scrubber["x"] + scrubber["width"] - 9, y)
    page.mouse.down()
    for _ in range(4):  # as by hand: the scrubber of a live page grows under the mouse, so one looks and aims again
        begin, end = (float(page.get_attribute("#scrubber", name)) for name in ("min", "max"))
        share = (at - begin) / (end - begin)
        page.mouse.move(scrubber["x"] + 8 + share * (scrubber["width"] - 16), y, steps=12)
    page.mouse.up()
    visit.until("shown.following === 'false' && Math.abs(shown.t - shown.shown) < 0.02")
    assert abs(visit.number("t") - at) < 3.0
    earlier = visit.positions()
    assert all(moved(earlier[name], before[name]) < 25.0 for name in before), (earlier, before)
    visit.picture("demo-dragged-back")
    visit.close()


def test_an_encounter_is_clicked_and_its_address_opened_again(browser: Any, recording: str) -> None:
    visit = Visit(browser, recording)
    page = visit.page
    page.wait_for_selector("#encounters tr", timeout=60_000)
    row = page.locator("#encounters tr").first
    minutes, seconds = row.locator("td").nth(1).inner_text().split(":")
    there_at = 60.0 * int(minutes) + float(seconds)  # the recording plays from its beginning: not yet
    row.click()
    visit.until(f"Math.abs(shown.t - {there_at}) < 0.051 && Math.abs(shown.t - shown.shown) < 0.02")
    assert row.get_attribute("aria-selected") == "true"
    visit.until("location.search.includes(`t=${Number(shown.t).toFixed(1)}&`)")
    first = visit.shown()
    again = Visit(browser, page.url)
    again.until("shown.following === 'false' && Math.abs(shown.t - shown.shown) < 0.02 && shown.position !== ''")
    second = again.shown()
    assert abs(float(first["t"]) - float(second["t"])) <= 0.051  # the address holds tenths
    assert (first["selected"], first["definition"]) == (second["selected"], second["definition"])
    here, there = (tuple(map(float, each["position"].split(","))) for each in (first, second))
    assert moved(here, there) < 1.0, (first, second)  # type: ignore[arg-type]
    again.picture("encounter")
    again.close()
    visit.close()


def test_that_earlier_encounters_are_missing_is_told(browser: Any, recording: str, tmp_path: Path) -> None:
    """The page is told 500 encounters at most: a long recording looked as if nobody had met before the last minutes."""
    path = tmp_path / "many-meet.tlog"
    courses = [math.tau * i / 34 for i in range(34)]
    flyers = [
        Flyer(
            i + 1,
            (-100.0 * math.cos(course), -100.0 * math.sin(course)),
            (10.0 * math.cos(course), 10.0 * math.sin(course)),
            identity=b"MANY-%02d" % i,
        )
        for i, course in enumerate(courses)
    ]
    write_tlog(path, flyers, seconds=5.0)
    with ridlink("view", str(path), "--port", "0") as address:
        visit = Visit(browser, address)
        visit.page.locator("#count-encounters", has_text="500+").wait_for()
        assert visit.page.locator("#earlier-encounters").is_visible()
        visit.close()
    visit = Visit(browser, recording)
    visit.page.wait_for_selector("#encounters tr")
    assert not visit.page.locator("#earlier-encounters").is_visible()
    assert "+" not in visit.page.inner_text("#count-encounters")
    visit.close()


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("size", [WIDE, TABLET, LOW, NARROW], ids=["wide", "tablet", "low", "narrow"])
def test_it_fits_on_a_laptop_and_on_a_phone(browser: Any, recording: str, size: dict[str, int], scheme: str) -> None:
    visit = Visit(browser, recording + "?t=12.5&d=candidate2", size=size, scheme=scheme)
    visit.until("shown.vehicles === '8' && shown.rings !== ''")
    visit.page.wait_for_selector("#encounters tr")
    assert visit.page.evaluate("document.documentElement.scrollWidth <= innerWidth"), "scrolls sideways"
    for name in ("#play", "#scrubber", "#map", "#definitions", "#clock"):
        box = visit.page.locator(name).bounding_box()
        assert box["x"] >= 0 and box["x"] + box["width"] <= size["width"], name
    assert visit.page.locator("#map").bounding_box()["height"] >= 300
    spilt = """[...document.querySelectorAll('.bar, main, .time, .side')]
        .filter(each => each.scrollHeight > each.clientHeight + 1).map(each => each.className)"""
    assert visit.page.evaluate(spilt) == [], "more in it than room"
    speed, clock = (visit.page.locator(name).bounding_box() for name in ("#speed", "#clock"))
    assert speed["x"] + speed["width"] + 4 <= clock["x"], "the clock touches the speed"
    ground = visit.page.evaluate("getComputedStyle(document.body).backgroundColor")
    bright = sum(map(int, re.findall(r"\d+", ground)[:3])) / 3
    assert bright > 128 if scheme == "light" else bright < 128
    visit.picture(f"page-{size['width']}-{scheme}")
    visit.close()


def test_whoever_comes_into_an_empty_sky_is_shown(browser: Any, tmp_path: Path) -> None:
    path = tmp_path / "empty-for-a-while.tlog"
    write_tlog(path, [Flyer(1, (0.0, 0.0), (0.0, 0.0), identity=b"EARLY")], seconds=1.0)
    write_tlog(path, [Flyer(2, (0.0, 0.0), (0.0, 0.0), identity=b"LATE")], seconds=20.0, begin_s=5.0)
    with ridlink("view", str(path), "--port", "0") as address:
        visit = Visit(browser, address)
        visit.until("shown.vehicles === '0' && Number(shown.t) > 3.0")
        visit.until("shown.vehicles === '1' && Number(shown.t) > 5.0")
        visit.close()


def test_it_is_driven_by_keys(browser: Any, recording: str) -> None:
    visit = Visit(browser, recording)
    press = visit.page.keyboard.press
    visit.until("Number(shown.vehicles) > 0 && shown.selected !== ''")
    press(" ")
    press("Home")
    visit.until(
        "Math.abs(shown.t - document.querySelector('#scrubber').min) < 0.02 && Math.abs(shown.t - shown.shown) < 0.02"
    )
    start = visit.number("t")
    press("ArrowRight")
    press("ArrowRight")
    press(".")
    visit.until(f"Math.abs(shown.t - {start} - 2.1) < 0.02")
    press(" ")
    visit.until(f"Number(shown.t) > {start} + 2.5")
    press(" ")
    selected = visit.shown()["selected"]
    press("]")
    visit.until(f"shown.selected !== {selected!r}")
    press("[")
    visit.until(f"shown.selected === {selected!r}")
    press("2")
    visit.until("document.querySelector('#definitions input:checked').value === 'remote-id'")
    press("?")
    visit.until("document.querySelector('#help').open")
    press("Escape")
    visit.until("!document.querySelector('#help').open && shown.selected !== ''")
    press("Escape")
    visit.until("shown.selected === ''")
    visit.close()


def served_by(address: str) -> psutil.Process:
    """The process that serves a page, of those that were started here."""
    port = int(address.rsplit(":", 1)[1].strip("/"))
    return next(
        process
        for process in psutil.Process().children(recursive=True)
        if any(one.laddr and one.laddr.port == port for one in process.net_connections())
    )


def test_a_server_that_stands_still_is_not_shown_as_if_it_went_on(browser: Any, recording: str) -> None:
    visit = Visit(browser, recording)
    state = "document.querySelector('#state').dataset.state"
    visit.until(f"{state} === 'recorded'")
    server = served_by(recording)
    server.suspend()
    try:
        visit.until(f"{state} === 'lost'")
    finally:
        server.resume()
    visit.until(f"{state} === 'recorded'")


def test_whoever_finds_all_places_taken_is_told_so_and_comes_in_later(browser: Any, recording: str) -> None:
    with contextlib.ExitStack() as others:
        for _ in range(MOST_PAGES):
            others.enter_context(connect(recording.replace("http", "ws") + "ws/v1"))
        page = others.enter_context(contextlib.closing(browser.new_page()))
        page.goto(recording)
        page.locator("#state", has_text="too many viewers, trying again").wait_for()
        others.pop_all().close()
    visit = Visit(browser, recording)
    visit.until("document.querySelector('#state').dataset.state === 'recorded'")
    visit.close()


HOSTILE = [
    b"<b id=x>a</b>",
    b"<svg/onload=alert(1)",
    b'"onfocus="alert(1)',
    b"\x1b[2J\x1b]0;x\x07",
    b"=cmd|' /C calc'!A0",
    b"+/#",
    b"\x9b" * 20,
]


def test_names_of_strangers_are_text(browser: Any, tmp_path: Path) -> None:
    """Whatever an aircraft calls itself: no element, no handler, no control character comes of it."""
    path = tmp_path / "<img src=x onerror=alert(1)>.tlog"
    flyers = [Flyer(i + 1, (60.0 * i, -50.0), (0.0, 10.0), identity=name) for i, name in enumerate(HOSTILE)] + [
        Flyer(100, (0.0, 60.0), (0.0, -10.0), identity=b"honest")
    ]
    write_tlog(path, flyers, seconds=12.0)
    with ridlink("view", str(path), "--port", "0") as address:
        visit = Visit(browser, address)
        visit.until(f"shown.vehicles === '{len(flyers)}'")
        for name in ("Encounters", "Vehicles", "Link"):
            visit.page.get_by_role("tab", name=name).click()
            visit.picture(f"hostile-{name.lower()}")
        visit.page.get_by_role("tab", name="Vehicles").click()
        for row in visit.page.locator("#vehicles tr").all():
            row.click()
            name = row.get_attribute("data-name")
            visit.until(
                f"shown.selected === {json.dumps(name)} && document.getElementById('vehicle-name').textContent !== ''"
            )
        assert visit.page.evaluate("document.querySelectorAll('td *, #vehicle-name *, #title *, img, b#x').length") == 0
        text = visit.page.inner_text("body")
        assert "<b id=x>a</b>" in text and "honest" in text
        assert not re.search(r"[\x00-\x08\x0b-\x1f\x7f-\x9f]", text + visit.page.title())
        visit.until("new URLSearchParams(location.search).get('v') === shown.selected")
        again = Visit(browser, visit.page.url)
        again.until("shown.position !== ''")
        assert again.shown()["selected"] == visit.shown()["selected"]
        again.close()
        visit.close()


def test_the_plan_looks_the_same_whether_a_worker_paints_it_or_not(browser: Any, recording: str) -> None:
    def opened(prepare: Callable[[Any], None]) -> Visit:
        visit = Visit(browser, recording + "?t=12.5&d=candidate2&v=CROSS-1", prepare=prepare)
        visit.until("shown.rings !== '' && Math.abs(shown.t - 12.5) < 0.02 && Math.abs(shown.t - shown.shown) < 0.02")
        return visit

    def looks(visit: Visit) -> bytes:
        return visit.page.locator("#map").screenshot()  # type: ignore[no-any-return]

    here = opened(lambda page: page.add_init_script("delete window.Worker"))
    beside = opened(lambda page: None)
    broken = opened(lambda page: page.route("**/static/painting.js", lambda route: route.abort()))
    assert [len(visit.page.workers) for visit in (here, beside, broken)] == [0, 1, 0]
    painted = looks(here)
    for visit in (beside, broken):
        assert any(looks(visit) == painted for _ in range(50)), "another picture"
    here.close()
    beside.close()
    broken.context.close()  # its console says what did not load


def test_250_vehicles_are_as_fluid_as_an_empty_page(browser: Any, tmp_path: Path) -> None:
    """Median time between frames while a recording of 250 vehicles plays; the figures are printed (``pytest -s``).

    Times between frames also show what else the machine does; the work of the page itself is its main thread's.
    """
    path = tmp_path / "crowd.tlog"
    write_tlog(path, crowd(250), seconds=8.0)

    def is_fluid() -> bool:
        blank = browser.new_context().new_page()
        empty, idle_ms = frames_and_work(blank, 5.0)
        blank.context.close()
        visit = Visit(browser, address)
        visit.until("shown.vehicles === '250'")
        times, busy_ms = frames_and_work(visit.page, 6.0)
        visit.picture("crowd")
        visit.close()
        for name, each, work_ms in (("empty page", empty, idle_ms), ("250 vehicles", times, busy_ms)):
            median, p95 = quantile(each, 0.5), quantile(each, 0.95)
            print(
                f"{name:14} median {median:.1f} ms   p95 {p95:.1f} ms   max {max(each):.1f} ms   work {work_ms:.2f} ms"
            )
        return quantile(times, 0.5) < 1.5 * quantile(empty, 0.5)

    with ridlink("view", str(path), "--port", "0") as address:
        # What is not fluid is so every time; what the rest of the machine does, is not.
        assert any(is_fluid() for _ in range(3))
