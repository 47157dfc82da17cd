"""``ridlink top`` on loopback: who is heard, as lines, as JSON and as a table."""

from __future__ import annotations

import json
import os
import pty
import re
import select
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from ridlink.cli.top import SHORTEST_NAME, table_of
from ridlink.observer import Sky, aircraft_states
from ridlink.separation.definitions import Definition
from tests.observer.flights import HOME, Flyer, frames

ONE = Flyer(1, (-30.0, 0.0), (5.0, 0.0), b"\x1b[2J<b>=A")
TWO = Flyer(2, (30.0, 5.0), (-5.0, 0.0), b"BRAVO")
HIGH = Flyer(3, (0.0, 0.0), (0.0, 1.0), b"HIGH", altitude_m=900.0)


@contextmanager
def an_air(flyers: list[Flyer]) -> Iterator[str]:
    """Speaks to whoever has said a word to it, as the emulated air does; its link."""
    stop = threading.Event()
    heard = [frame.raw for _, frame in frames(flyers, 8.0)]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.bind(("127.0.0.1", 0))
        sock.settimeout(0.05)

        def speak() -> None:
            peer, turn = None, 0
            while not stop.is_set():
                with suppress(TimeoutError):
                    _, peer = sock.recvfrom(2048)
                for data in heard[turn : turn + 6] if peer is not None else ():
                    sock.sendto(data, peer)
                turn = (turn + 6) % len(heard)

        thread = threading.Thread(target=speak, daemon=True)
        thread.start()
        try:
            yield f"udpout:127.0.0.1:{sock.getsockname()[1]}"
        finally:
            stop.set()
            thread.join()


@contextmanager
def running(*arguments: str, **options: Any) -> Iterator[subprocess.Popen[bytes]]:
    command = [sys.executable, "-m", "ridlink", "top", *arguments]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, **options) as process:
        try:
            yield process
        finally:
            process.kill()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_json_once_an_interval_until_a_signal(number: signal.Signals) -> None:
    with an_air([ONE, TWO]) as url, running(url, "--json", "--interval", "0.1") as process:
        assert process.stdout is not None
        for line in process.stdout:
            document = json.loads(line, parse_constant=pytest.fail)
            if len(document["aircraft"]) == 2:
                break
        process.send_signal(number)
        out, err = process.communicate(timeout=20)
    assert process.returncode == 0 and err == b"" and out.endswith(b"}\n")
    first, second = document["aircraft"]
    assert {first["uas"], second["uas"]} == {"\\x1b[2J<b>=A", "BRAVO"}
    assert first["nearest"]["uas"] == second["uas"] and first["nearest"]["margin_m"] < first["nearest"]["distance_m"]
    assert document["link"]["frames"] == document["link"]["remote_id"] > 0


def test_plain_lines_where_nobody_watches_and_an_end_after_so_many_seconds() -> None:
    with an_air([ONE, TWO]) as url, running(url, "--duration", "1.2", "--interval", "0.4") as process:
        out, err = process.communicate(timeout=30)
    assert process.returncode == 0 and err == b"" and b"\x1b" not in out
    assert re.search(rb"^\d\d:\d\d:\d\dZ  BRAVO  age s \d\.\d  Hz .*  margin m -?\d", out, re.MULTILINE)
    assert re.search(rb"Z  link udpout:127\.0\.0\.1:\d+  frames \d+, remote id \d+", out.splitlines()[-1])


def test_a_terminal_sees_a_table_and_nothing_that_an_identity_wants_of_it() -> None:
    controller, terminal = pty.openpty()
    command = [sys.executable, "-m", "ridlink", "top", "--interval", "0.1"]
    with an_air([ONE, TWO]) as url:
        environment = os.environ | {"COLUMNS": "120", "LINES": "20", "TERM": "xterm"}
        process = subprocess.Popen([*command, url], stdout=terminal, stderr=terminal, env=environment)
        os.close(terminal)
        try:
            shown = _read_until(controller, b"2 in the air")
            process.send_signal(signal.SIGINT)
            shown += _read_until(controller, b"\x1b[?25h")  # the cursor is given back
            assert process.wait(timeout=20) == 0
        finally:
            process.kill()
            os.close(controller)
    assert b"\\x1b[2J<b>=A" in shown and b"\x1b[2J" not in shown


def _read_until(controller: int, what: bytes) -> bytes:
    seen, ends_s = b"", time.monotonic() + 30.0
    while what not in seen and time.monotonic() < ends_s:
        if select.select([controller], [], [], 0.5)[0]:
            seen += os.read(controller, 65536)
    assert what in seen
    return seen


@pytest.mark.parametrize("option", ["--duration", "--seconds"])
def test_silence_is_said(option: str) -> None:
    with running("udpin:127.0.0.1:0", option, "0.2", "--json") as process:
        out, err = process.communicate(timeout=30)
    assert process.returncode == 0 and json.loads(out)["aircraft"] == []
    assert err.decode() == "ridlink: no Remote ID was heard on udpin:127.0.0.1:0; is anybody sending there?\n"


@pytest.mark.parametrize(
    ("arguments", "code"),
    [(["udp:127.0.0.1:1"], 2), (["--definition", "x"], 2), (["--interval", "0.01"], 2), (["--sort", "x"], 2)],
)
def test_errors_are_one_line(arguments: list[str], code: int) -> None:
    with running(*arguments) as process:
        out, err = process.communicate(timeout=30)
    assert (process.returncode, out, len(err.splitlines())) == (code, b"", 1)


@pytest.mark.parametrize("arguments", [["top"], ["view", "--source"]])
def test_a_recording_is_sent_to_what_shows_recordings(arguments: list[str], tmp_path: Path) -> None:
    log = tmp_path / "flight.tlog"
    log.touch()
    command = [sys.executable, "-m", "ridlink", *arguments, str(log)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=30, check=False)
    told = f"ridlink: {log} is a file, not a link: 'ridlink view {log}' shows a recording (see 'ridlink {arguments[0]} "
    assert (done.returncode, done.stdout, done.stderr) == (2, "", f"{told}--help')\n")


def states_of(flyers: list[Flyer]) -> list[dict[str, Any]]:
    sky = Sky(origin=HOME)
    for time_s, frame in frames(flyers, 1.0):
        sky.receive(frame, time_s)
    return aircraft_states(sky, sky.at(1.0), Definition.CANDIDATE2, 1_700_000_000.0)


@pytest.mark.parametrize("width", [60, 80, 140])
def test_figures_are_whole_and_names_are_cut_where_there_is_no_room(width: int) -> None:
    serial = "1596F3" + 9 * "A" + "00042"
    long = replace(TWO, identity=serial.encode())
    console = Console(width=width, color_system=None)
    with console.capture() as captured:
        console.print(table_of(states_of([ONE, long]), 9, width, "here"))
    text = captured.get()
    assert (serial in text) == (width == 140)
    begin, end = serial[: SHORTEST_NAME - 6], serial[-5:]  # where two of one maker differ
    assert len(re.findall(rf"\b{begin}\S*{end}\b", text)) == 2
    assert all(
        f"{state['nearest']['margin_m']:.1f}\n" in re.sub(" +\n", "\n", text) for state in states_of([ONE, long])
    )


def test_more_than_there_is_room_for_are_counted() -> None:
    crowd = [Flyer(k, (50.0 * k, 0.0), (0.0, 1.0)) for k in range(1, 9)]
    console = Console(width=120, color_system=None)
    with console.capture() as captured:
        console.print(table_of(states_of(crowd), 3, 120, "here"))
    assert "8 in the air (5 more); here" in captured.get() and len(captured.get().splitlines()) == 5


def test_nobody_at_the_same_height_is_no_neighbour() -> None:
    one, high = states_of([replace(ONE, identity=b"LOW"), HIGH])
    assert one["nearest"] is None and high["nearest"] is None
