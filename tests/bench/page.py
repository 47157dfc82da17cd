"""How evenly Chromium shows the live page: ``python -m tests.bench.page [ROUNDS [SECONDS]]``.

An empty page, a recording of 250 vehicles that plays, and 250 live ones that report at 10 Hz, in turns. Times are those
between the ends of animation frames' scripts, which shows what a script took as well as what else held up a frame; what
the screen gets is the time between the frames themselves. Needs Chromium and Playwright (see ``make e2e``).
"""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import multiprocessing
import os
import statistics
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from playwright.sync_api import sync_playwright

from tests.bench.view import speak, spoken
from tests.e2e.page import FLAGS, WIDE, chromium, crowd, quantile, ridlink, write_tlog
from tests.loopback import free_port

VEHICLES = 250
FRAMES = """seconds => new Promise(resolve => {
  const ends = [], stamps = [], begun = performance.now();
  const frame = stamp => {
    ends.push(performance.now());
    stamps.push(stamp);
    if (ends.at(-1) - begun < 1000 * seconds) requestAnimationFrame(frame);
    else resolve({ends, stamps});
  };
  requestAnimationFrame(frame);
})"""


def report(rounds: int = 5, seconds: float = 10.0) -> dict[str, list[dict[str, Any]]]:
    """Print the table: a row for every case and round, then the medians."""
    print(f"\n{VEHICLES} vehicles in Chromium, {rounds} rounds of {seconds:g} s; times in ms, CPU of all of Chromium")
    print(
        f"{'':14}{'median':>8}{'p95':>8}{'p99':>8}{'max':>8}{'p95 of frames':>15}{'main thread':>13}"
        f"{'CPU':>7}{'load':>7}"
    )
    rows = []
    with contextlib.ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        write_tlog(folder / "crowd.tlog", crowd(VEHICLES), seconds=8.0)
        recorded = stack.enter_context(ridlink("view", str(folder / "crowd.tlog"), "--port", "0"))
        live = stack.enter_context(flying())
        playwright = stack.enter_context(sync_playwright())
        browser = playwright.chromium.launch(executable_path=chromium(), args=FLAGS)
        cases = {"empty page": None, "recording": recorded, "live": live}
        for _, (name, address) in itertools.product(range(rounds), cases.items()):
            rows.append({"case": name, **measure(browser, address, seconds)})
            print(line(rows[-1]), flush=True)
        browser.close()
    print("medians")
    for name in cases:
        of = [row for row in rows if row["case"] == name]
        print(
            line({"case": name, **{key: statistics.median(row[key] for row in of) for key in of[0] if key != "case"}})
        )
    return {"page": rows}


def line(row: dict[str, Any]) -> str:
    return (
        f"{row['case']:14}{row['median_ms']:>8.1f}{row['p95_ms']:>8.1f}{row['p99_ms']:>8.1f}{row['max_ms']:>8.1f}"
        f"{row['frame_p95_ms']:>15.1f}{row['main_ms']:>13.2f}{row['cpu_ms']:>7.1f}{row['load']:>7.1f}"
    )


@contextlib.contextmanager
def flying() -> Iterator[str]:
    """Vehicles on a link, and the address of the page that shows them."""
    port = free_port()
    speaker = multiprocessing.get_context("spawn").Process(target=fly, args=(port,), daemon=True)
    speaker.start()
    try:
        with ridlink("view", "--source", f"udpin:127.0.0.1:{port}", "--port", "0") as address:
            yield address
    finally:
        speaker.terminate()
        speaker.join()


def fly(port: int) -> None:
    asyncio.run(speak(spoken(VEHICLES), port))


def measure(browser: Any, address: str | None, seconds: float) -> dict[str, Any]:
    context = browser.new_context(viewport=WIDE, color_scheme="dark")
    page = context.new_page()
    if address is not None:
        page.goto(address)
        page.wait_for_selector(f"#map[data-vehicles='{VEHICLES}']", timeout=60_000)
    page.evaluate(FRAMES, 1.0)  # until it has settled
    of_page, of_browser = context.new_cdp_session(page), browser.new_browser_cdp_session()
    of_page.send("Performance.enable", {"timeDomain": "threadTicks"})

    def used_s() -> tuple[float, float]:
        metrics = {each["name"]: each["value"] for each in of_page.send("Performance.getMetrics")["metrics"]}
        processes = of_browser.send("SystemInfo.getProcessInfo")["processInfo"]
        return metrics["TaskDuration"], sum(each["cpuTime"] for each in processes)

    before = used_s()
    found = page.evaluate(FRAMES, seconds)
    main_s, all_s = (after - begun for after, begun in zip(used_s(), before, strict=True))
    context.close()
    times, frames = ([b - a for a, b in itertools.pairwise(found[name])] for name in ("ends", "stamps"))
    return {
        "median_ms": quantile(times, 0.5),
        "p95_ms": quantile(times, 0.95),
        "p99_ms": quantile(times, 0.99),
        "max_ms": max(times),
        "frame_p95_ms": quantile(frames, 0.95),
        "main_ms": 1e3 * main_s / len(times),
        "cpu_ms": 1e3 * all_s / len(times),
        "load": os.getloadavg()[0],
    }


if __name__ == "__main__":
    report(*(kind(given) for kind, given in zip((int, float), sys.argv[1:], strict=False)))
