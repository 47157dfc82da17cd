"""``ridlink view`` as a user runs it, and the page of a demonstration."""

from __future__ import annotations

import asyncio
import json
import os
import re
import signal
import socket
import subprocess
import sys
import tty
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("uvicorn", reason="needs ridlink[web]")

import httpx
from websockets.asyncio.client import connect

from ridlink.captures.tlog import TlogWriter
from tests.cli.scenes import ALONE, scenario
from tests.loopback import free_port
from tests.observer.flights import Flyer, frames
from tests.view.serving import HEAD_ON, PATIENCE_S, heard

ADDRESS = re.compile(r"http://127\.0\.0\.1:\d+/")


def started(*arguments: str) -> tuple[subprocess.Popen[str], str]:
    """The command, and the address of its page."""
    command = [sys.executable, "-m", "ridlink", *arguments]
    process = subprocess.Popen(
        command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    assert process.stderr is not None
    for line in process.stderr:
        found = ADDRESS.search(line)
        if found:
            return process, found[0]
    raise AssertionError("no address was told")


async def first(address: str, kind: str, *requests: str, **facts: Any) -> dict[str, Any]:
    async with connect(address.replace("http", "ws") + "ws/v1", compression=None) as page:
        for request in requests:
            await page.send(request)
        return await heard(page, kind, **facts)


@pytest.fixture
def log(tmp_path: Path) -> Path:
    path = tmp_path / "flight.tlog"
    with TlogWriter(path) as writer:
        for time_s, frame in frames([*HEAD_ON, Flyer(3, (50.0, 400.0), (0.0, 1.0), b"<b>\x1b[1m")], 5.0):
            writer.write(1_700_000_000_000_000 + round(1e6 * time_s), frame.raw)
    return path


def test_a_recording_is_shown_until_a_signal(log: Path) -> None:
    process, address = started("view", str(log), "--port", "0", "--definition", "snmac")
    try:
        assert httpx.get(address).status_code == httpx.get(address + "healthz").status_code == 200
        hello = asyncio.run(first(address, "hello"))
        assert (hello["title"], hello["source"], hello["live"]) == ("flight.tlog", "file", False)
        assert hello["definition"] == "snmac" and hello["utc0"] == pytest.approx(1_700_000_000.0, abs=2.0)
        answer = asyncio.run(first(address, "instants", '{"at":3.0,"id":1}', id=1))
        names = {row[0] for row in answer["instants"][0]["vehicles"]}
        assert names == {"ALPHA", "BRAVO", "<b>\\x1b[1m"}
        health = asyncio.run(first(address, "health"))
        assert (health["vehicles"], health["live"]) == (3, False), "of a recording, all that are in it"
        process.send_signal(signal.SIGTERM)
        out, _ = process.communicate(timeout=PATIENCE_S)
        assert process.returncode == 0 and out == ""
    finally:
        process.kill()
        process.communicate()


def test_what_could_be_read_before_the_disk_failed_is_shown_and_told(log: Path) -> None:
    reading, writing = os.openpty()  # a terminal whose other end is gone answers as a broken disk does
    tty.setraw(writing)
    command = [sys.executable, "-m", "ridlink", "view", "-", "--port", "0"]
    process = subprocess.Popen(command, stdin=reading, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    os.close(reading)
    try:
        data = log.read_bytes()
        while data:
            data = data[os.write(writing, data) :]
        os.close(writing)
        assert process.stderr is not None
        assert process.stderr.readline() == "ridlink: standard input: Input/output error\n"
        found = ADDRESS.search(process.stderr.readline())
        assert found is not None
        hello = asyncio.run(first(found[0], "hello"))
        assert hello["title"] == "standard input (in part)" and hello["t1"] > 1.0
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=PATIENCE_S)
        assert process.returncode == 3
    finally:
        process.kill()
        process.communicate()


def test_a_link_is_shown_live() -> None:
    port = free_port()
    process, address = started("view", "--source", f"udpin:127.0.0.1:{port}", "--port", "0")

    async def body() -> None:
        async with connect(address.replace("http", "ws") + "ws/v1", compression=None) as page:
            assert (await heard(page, "hello"))["source"] == "link"
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
                for _, frame in frames(HEAD_ON, 1.0):
                    sender.sendto(frame.raw, ("127.0.0.1", port))
            while len((await heard(page, "instant", live=True))["vehicles"]) < 2:
                continue
            health = await heard(page, "health")
            assert health["live"] and health["clients"] == 1

    try:
        asyncio.run(asyncio.wait_for(body(), 60.0))
    finally:
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=PATIENCE_S)
    assert process.returncode == 0


@pytest.mark.programs
def test_the_page_of_a_demo_knows_the_truth_and_stays_if_asked_to(tmp_path: Path) -> None:
    process, address = started(
        "demo", "--scenario", scenario(tmp_path, ALONE), "--autopilot", "ideal", "--any-ports", "--stay", "--json",
        "--log", str(tmp_path / "flight.tlog"),
    )  # fmt: skip
    try:
        assert process.stdout is not None
        assert json.loads(process.stdout.readline())["passed"], "the verdict comes before the end"
        hello = asyncio.run(first(address, "hello"))
        assert (hello["source"], hello["truth"]) == ("demo", True)
        assert hello["goals"] == {"RDLK40001": [30.0, 0.0]}
        answer = asyncio.run(first(address, "instants", f'{{"window":[0,{hello["t1"]}],"id":1}}', id=1))
        rows = [row for instant in answer["instants"] for row in instant["vehicles"]]
        assert rows and all(abs(row[1] - row[10]) < 25.0 for row in rows), "reported beside true"
        assert any(row[1] != row[10] for row in rows)
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=PATIENCE_S)
        assert process.returncode == 0
    finally:
        process.kill()
        process.communicate()


@pytest.mark.parametrize(
    ("arguments", "text", "code"),
    [
        (["missing.tlog"], "missing.tlog", 3),
        (["{folder}/nothing.tlog"], "nothing.tlog is empty", 3),
        (["{folder}/text.txt"], "text.txt is no capture", 3),
        (["--source", "udp:1.2.3.4:5"], "udpin:", 2),
        (["--definition", "candidate3"], "candidate3", 2),
        (["x.tlog", "--source", "udpin:127.0.0.1:0"], "not both", 2),
        (["--port", "{taken}", "{folder}/text.txt"], "port {taken} is in use", 3),  # before anything is read
        (["--port", "{taken}"], "port {taken} is in use; name another, or 0 for any that is free", 3),
        (["--host", "192.0.2.1", "--port", "0"], "192.0.2.1", 3),
        (["--source", "udpin:127.0.0.1:{heard}", "--port", "0"], "{heard}", 3),
        (["--source", "tcpout:127.0.0.1:{heard}", "--port", "0"], "{heard}", 3),
    ],
)
def test_a_mistake_is_one_clear_line(tmp_path: Path, arguments: list[str], text: str, code: int) -> None:
    (tmp_path / "nothing.tlog").touch()
    (tmp_path / "text.txt").write_text("hello\n" * 100)
    with socket.socket() as taken, socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as heard_here:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        heard_here.bind(("127.0.0.1", 0))
        names = {"folder": tmp_path, "taken": taken.getsockname()[1], "heard": heard_here.getsockname()[1]}
        command = [sys.executable, "-m", "ridlink", "view", *(one.format(**names) for one in arguments)]
        done = subprocess.run(command, capture_output=True, text=True, timeout=60.0, stdin=subprocess.DEVNULL)
    assert done.returncode == code, done.stderr
    assert text.format(**names) in done.stderr
    assert len(done.stderr.splitlines()) == 1 and done.stdout == ""


@pytest.mark.parametrize("files", [[], [__file__]], ids=["live", "recorded"])
def test_without_the_extra_the_line_says_what_to_install(files: list[str]) -> None:
    """Of a file as well, before it is read: this one would be no capture."""
    words = ["ridlink", "view", *files]
    code = f"import sys; sys.modules['uvicorn'] = None; sys.argv = {words}; from ridlink.cli import main; main()"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60.0)
    assert done.returncode == 2
    assert done.stderr.splitlines() == ["ridlink: the page needs the extra 'web': pip install 'ridlink[web]'"]
