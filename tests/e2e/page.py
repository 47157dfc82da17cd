"""The live page: served by a command, opened in Chromium, with what it shows and how evenly; and crowds to be shown."""

from __future__ import annotations

import math
import os
import re
import shutil
import struct
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tests.observer.flights import Flyer, frames

ROOT = Path(__file__).resolve().parents[2]
PICTURES = ROOT / "e2e-out"
FLAGS = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]
ADDRESS = re.compile(r"http://127\.0\.0\.1:\d+/")
WIDE, TABLET = {"width": 1440, "height": 900}, {"width": 834, "height": 1194}
NARROW, LOW = {"width": 390, "height": 844}, {"width": 844, "height": 390}
"""A phone, upright and on its side: the latter is also a laptop's screen at 200 %."""


def _kept(line: str, said: list[str]) -> str:
    said.append(line)
    return line


@contextmanager
def ridlink(*arguments: str) -> Iterator[str]:
    """A command that serves the page, and its address as it says it on standard error."""
    command = [sys.executable, "-m", "ridlink", *arguments]
    with subprocess.Popen(command, cwd=ROOT, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True) as process:
        assert process.stderr is not None
        lines = iter(process.stderr.readline, "")
        said: list[str] = []
        found = next((match for match in (ADDRESS.search(_kept(line, said)) for line in lines) if match), None)
        threading.Thread(
            target=lambda: said.extend(lines), daemon=True
        ).start()  # or the pipe fills, and it stands still
        try:
            assert found is not None, f"no address: {''.join(said)}"
            yield found.group()
        finally:
            process.terminate()
            try:
                process.wait(timeout=30)
            except subprocess.TimeoutExpired:
                process.kill()
                raise


def chromium() -> str:
    return os.environ.get("CHROMIUM") or shutil.which("chromium") or "/usr/bin/chromium"


class Visit:
    """A page that was opened, and everything that went wrong on it."""

    def __init__(
        self,
        browser: Any,
        address: str,
        *,
        size: dict[str, int] = WIDE,
        scheme: str = "dark",
        prepare: Callable[[Any], None] = lambda page: None,
    ) -> None:
        self.address = address
        self.wrong: list[str] = []
        self.context = browser.new_context(viewport=size, color_scheme=scheme)
        self.page = self.context.new_page()
        self.page.on("console", self._console)
        self.page.on("pageerror", lambda error: self.wrong.append(f"error: {error}"))
        self.page.on("request", self._request)
        self.page.on("dialog", lambda dialog: self.wrong.append(f"dialog: {dialog.message}"))
        self.page.on(
            "response", lambda got: self.wrong.append(f"{got.status} {got.url}") if got.status >= 400 else None
        )
        prepare(self.page)
        self.open(address)

    def _console(self, message: Any) -> None:
        if message.type in ("error", "warning"):
            self.wrong.append(f"console: {message.text}")

    def _request(self, request: Any) -> None:
        host = re.match(r"\w+://[^/]+/", request.url)
        if host is None or host.group().split("://")[1] != ADDRESS.match(self.address).group().split("://")[1]:  # type: ignore[union-attr]
            self.wrong.append(f"asked another host: {request.url}")

    def open(self, address: str) -> None:
        response = self.page.goto(address)
        assert "default-src 'self'" in response.headers["content-security-policy"]
        self.page.wait_for_selector("#map[data-vehicles]")

    def shown(self) -> dict[str, str]:
        """What the page says that it shows."""
        return self.page.evaluate("({...document.getElementById('map').dataset})")  # type: ignore[no-any-return]

    def number(self, name: str) -> float:
        return float(self.shown()[name])

    def until(self, condition: str, timeout_s: float = 60.0) -> None:
        """Wait until a JavaScript condition on ``shown`` (the data attributes of the plan) and ``document`` holds.

        Looked at in every frame by a function of our own: Playwright's would be refused by the page's policy.
        """
        look = """new Promise((resolve, reject) => {
            const shown = document.getElementById('map').dataset, ends = performance.now() + %d;
            const look = () => {
                let holds = false;
                try { holds = %s; } catch (error) { reject(error); }
                if (holds) resolve(true);
                else if (performance.now() > ends) resolve(false);
                else requestAnimationFrame(look);
            };
            look();
        })"""
        assert self.page.evaluate(look % (1000 * timeout_s, condition.strip())), (
            f"{condition}: {self.shown()}, {self.wrong}"
        )

    def positions(self) -> dict[str, tuple[float, float]]:
        """Where the table says that everybody is; it is written less often than the plan is drawn."""
        self.page.eval_on_selector("#vehicles", "table => { delete table.dataset.shown; }")
        self.page.wait_for_selector("#vehicles[data-shown]")
        rows = self.page.eval_on_selector_all(
            "#vehicles tr", "rows => rows.map(row => [row.dataset.name, row.dataset.north, row.dataset.east])"
        )
        return {name: (float(north), float(east)) for name, north, east in rows}

    def picture(self, name: str) -> None:
        self.page.screenshot(path=PICTURES / f"{name}.png")

    def close(self) -> None:
        self.context.close()
        assert self.wrong == []


def frames_and_work(page: Any, seconds: float) -> tuple[list[float], float]:
    """Times between animation frames, and CPU time of the main thread in one of them, drawing included [ms]."""
    session = page.context.new_cdp_session(page)
    session.send("Performance.enable", {"timeDomain": "threadTicks"})

    def work_s() -> float:
        metrics = session.send("Performance.getMetrics")["metrics"]
        return next(float(each["value"]) for each in metrics if each["name"] == "TaskDuration")

    before_s = work_s()
    times = frame_times(page, seconds)
    return times, 1e3 * (work_s() - before_s) / len(times)


def frame_times(page: Any, seconds: float) -> list[float]:
    """Times between animation frames [ms]."""
    return page.evaluate(  # type: ignore[no-any-return]
        """seconds => new Promise((resolve, reject) => {
             const times = [], begun = performance.now();
             let last = begun;
             const frame = () => {
               const now = performance.now();
               times.push(now - last);
               last = now;
               if (now - begun < 1000 * seconds) requestAnimationFrame(frame); else resolve(times);
             };
             requestAnimationFrame(frame);
           })""",
        seconds,
    )


def quantile(values: list[float], share: float) -> float:
    return sorted(values)[int(share * (len(values) - 1))]


def crowd(count: int) -> list[Flyer]:
    """Vehicles on a lattice, 60 m apart, each with a course of its own."""
    side = math.ceil(math.sqrt(count))
    return [
        Flyer(
            1 + i % 250,
            (60.0 * (i // side), 60.0 * (i % side)),
            (8.0 * math.cos(2.4 * i), 8.0 * math.sin(2.4 * i)),
            identity=f"CROWD-{i:04d}".encode(),
        )
        for i in range(count)
    ]


def write_tlog(path: Path, flyers: list[Flyer], seconds: float, begin_s: float = 0.0) -> None:
    """A recording of what they broadcast, or more of one."""
    epoch_us = 1_750_000_000_000_000
    with path.open("ab") as file:
        for time_s, frame in frames(flyers, seconds):
            file.write(struct.pack(">Q", epoch_us + round((begin_s + time_s) * 1e6)) + frame.raw)
