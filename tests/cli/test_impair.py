"""``ridlink impair`` between two sockets."""

from __future__ import annotations

import json
import re
import signal
import socket
import subprocess
import sys

import pytest

from tests.loopback import PATIENCE_S


def test_it_carries_until_a_signal_and_says_what_it_did() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as far:
        far.bind(("127.0.0.1", 0))
        far.settimeout(PATIENCE_S)
        command = [sys.executable, "-m", "ridlink", "impair", "--listen", "udpin:127.0.0.1:0"]
        command += ["--to", f"udpout:127.0.0.1:{far.getsockname()[1]}", "--duplicate", "1", "--json"]
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
            assert process.stdout is not None and process.stderr is not None
            said = re.search(r"udpin:127\.0\.0\.1:(\d+) leads to", process.stderr.readline())
            assert said is not None
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as near:
                near.sendto(b"hello", ("127.0.0.1", int(said[1])))
                assert [far.recv(100), far.recv(100)] == [b"hello", b"hello"]
            process.send_signal(signal.SIGTERM)
            summary = json.loads(process.stdout.read())
            assert process.wait(PATIENCE_S) == 0
    assert summary["there"] == {"received": 1, "passed": 2, "duplicated": 1}


ENDS = ("--listen", "udpin:127.0.0.1:0", "--to", "udpout:127.0.0.1:9")


@pytest.mark.parametrize(
    ("arguments", "code", "says"),
    [
        (["--listen", "udp:127.0.0.1:1", "--to", "udpout:127.0.0.1:9"], 2, "udpin:127.0.0.1:1"),
        (["--listen", "serial:/dev/ttyS9:57600", "--to", "udpout:127.0.0.1:9"], 2, "on UDP; write udpin:HOST:PORT"),
        (["--listen", "tcpin:[::1]:1", "--to", "udpout:127.0.0.1:9"], 2, "on UDP; write udpin:[::1]:1"),
        ([*ENDS, "--loss", "30"], 2, "--loss 30.0: a share is at most 1 (30 % is 0.3)"),
        ([*ENDS, "--rate", "nan"], 2, "--rate nan: must be a number of at least 0"),
        ([*ENDS, "--delay", "inf"], 2, "--delay inf: must be"),
        ([*ENDS, "--jitter", "-1"], 2, "--jitter -1.0: must be"),
        ([*ENDS, "--burst", "3"], 2, "--burst 3.0 with loss 0.0: bursts need a loss"),
        ([*ENDS, "--burst", "2", "--loss", "0.9"], 2, "--loss 0.9 needs bursts of at least 9"),
        (["--listen", "udpin:127.0.0.1:0"], 2, "--to"),
        (["--listen", "udpin:127.0.0.1:9", "--to", "udpout:127.0.0.1:9"], 2, "go round for ever"),
        (["--listen", "udpin:0.0.0.0:9", "--to", "udpout:localhost:9"], 2, "go round for ever"),
        (["--listen", "udpin:127.0.0.1:0", "--to", "udpout:no..host:9"], 3, "no such host"),
        (["--listen", "udpin:127.0.0.1:0", "--to", "udpout:255.255.255.255:9"], 3, "of a whole network"),
    ],
)
def test_bad_input_is_one_line(arguments: list[str], code: int, says: str) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "ridlink", "impair", *arguments], capture_output=True, text=True, timeout=30
    )
    assert done.returncode == code
    assert says in done.stderr
    assert done.stderr.count("\n") == 1
    assert not done.stdout
