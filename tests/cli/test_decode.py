"""``ridlink decode`` as its users run it."""

from __future__ import annotations

import errno
import io
import json
import os
import re
import signal
import subprocess
import sys
from collections import Counter
from pathlib import Path
from typing import Any

import pytest
from click.testing import Result

from ridlink.captures import open_capture, reader
from ridlink.cli import files, progress
from ridlink.mavlink.codec import Encoder
from tests.captures.command import run
from tests.captures.conftest import START_US, flight, tlog_bytes
from tests.cli.program import ridlink

REAL = Path(__file__).resolve().parents[3] / "shared" / "captures" / "real_autopilot.tlog"


def lines(result: Result) -> list[dict[str, Any]]:
    return [json.loads(line, parse_constant=pytest.fail) for line in result.stdout_bytes.splitlines()]


@pytest.fixture
def log(tmp_path: Path) -> Path:
    path = tmp_path / "flight.tlog"
    path.write_bytes(tlog_bytes(flight(9)))
    return path


def test_json_lines_come_in_the_order_of_the_file(log: Path) -> None:
    result = run(log, "-f", "jsonl")
    rows = lines(result)
    assert [row["type"] for row in rows] == ["HEARTBEAT", "OPEN_DRONE_ID_LOCATION", "RIDLINK_SEPARATION"] * 3
    assert [row["seq"] for row in rows] == list(range(9))
    assert result.stdout.startswith('{"t":1700000000.123456,"src":"1/1","seq":0,"type":"HEARTBEAT","id":0,')
    assert result.stderr == "" and result.return_value == 0


def test_a_table_is_the_default(log: Path) -> None:
    rows = run(log).stdout.splitlines()
    assert len(rows) == 9
    assert len({row.index("latitude_deg=") - row.index("OPEN_DRONE_ID_LOCATION") for row in rows[1::3]}) == 1


@pytest.mark.parametrize(
    ("types", "count"),
    [("OPEN_DRONE_ID_*,RIDLINK_*", 6), ("heartbeat", 3), ("*", 9), ("UNKNOWN", 0), (" HEARTBEAT , RIDLINK_STATUS", 3)],
)
def test_types_are_globs(log: Path, types: str, count: int) -> None:
    assert len(lines(run(log, "-f", "jsonl", "--types", types))) == count


@pytest.mark.parametrize("types", ["HEARTBEET", ",", "HEARTBEAT,NOPE_*"])
def test_a_type_that_does_not_exist_is_a_usage_error(log: Path, types: str) -> None:
    done = ridlink("decode", log, "--types", types)
    assert done.returncode == 2 and b"--types" in done.stderr and done.stdout == b""


@pytest.mark.parametrize("limit", [("--source-system", "99"), ("--types", "ATTITUDE"), ("--since", "2033-01-01")])
@pytest.mark.parametrize("large", [10**12, 0], ids=["by message", "in blocks"])
def test_limits_that_nothing_keeps_are_told(
    log: Path, limit: tuple[str, str], large: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Nothing came, and nothing was said."""
    monkeypatch.setattr(reader, "LARGE_BYTES", large)
    run(log)  # in a new clone the compiler says a word of its own
    result = run(log, *limit)
    assert (result.stdout, result.return_value) == ("", 0)
    assert result.stderr == "ridlink: no message is of those asked for; --stats, without limits, shows what there is\n"
    assert run(log, *limit, "--stats").stderr == ""
    for export in (("-f", "geojson"), ("-f", "kml"), ("--join", "-f", "csv")):
        assert "in what was asked for; --stats, without limits, shows" in run(log, *limit, *export).stderr
        assert run(log, *export).stderr == ""
    folder = ("-f", "csv", "-o", log.parent / "folder")
    assert run(log, *limit, *folder).stderr.endswith(f"folder: no messages\n{result.stderr}")


@pytest.mark.parametrize("large", [10**12, 0], ids=["by message", "in blocks"])
def test_messages_that_were_not_asked_for_are_not_lost(log: Path, large: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reader, "LARGE_BYTES", large)
    options = (log, "--stats", "--types", "HEARTBEAT")
    assert "1/1         3     -     -\n\n-: sequence numbers count all messages" in run(*options).stdout
    (counts,) = [json.loads(line) for line in run(*options, "-f", "jsonl").stdout.splitlines()]
    assert counts["sources"] == {"1/1": {"messages": 3, "gaps": None, "lost": None}}


@pytest.mark.parametrize("large", [10**12, 0], ids=["by message", "in blocks"])
def test_nothing_is_lost_between_one_file_and_the_next(log: Path, large: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reader, "LARGE_BYTES", large)
    assert "1/1        18     0     0\n\nno rejects" in run(log, log, "--stats").stdout


@pytest.mark.parametrize("options", [(), ("-f", "geojson"), ("--join", "-f", "jsonl")])
def test_standard_input_is_read_once(options: tuple[str, ...]) -> None:
    """Its second reading was an empty file, after all of the first."""
    done = run("-", "x.tlog", "-", *options)
    assert done.stdout == "" and "standard input can be read once" in str(done.exception)


@pytest.mark.parametrize("options", [(), ("--stats",), ("-f", "geojson"), ("--join", "-f", "jsonl")])
@pytest.mark.parametrize("large", [10**12, 0], ids=["by message", "in blocks"])
@pytest.mark.parametrize("suffix", ["mavlink", "hex"])
def test_limits_of_time_are_told_to_be_in_vain_where_there_are_no_times(
    tmp_path: Path, suffix: str, large: int, options: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(reader, "LARGE_BYTES", large)
    frame = Encoder(7, 1).encode("HEARTBEAT")
    path = tmp_path / f"stream.{suffix}"
    path.write_bytes(3 * (frame if suffix == "mavlink" else frame.hex().encode() + b"\n"))
    run(path, *options)  # in a new clone the compiler says a word of its own
    result = run(path, "--until", "2033-01-01", *options)
    assert result.stderr == f"ridlink: {path} has no times: nothing of it is within --since and --until\n"
    assert "no times" not in run(path, "--source-system", "7", *options).stderr


def test_source_system_selects(log: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.tlog"
    other.write_bytes(tlog_bytes([(START_US, Encoder(7, 1).encode("HEARTBEAT"))]))
    rows = lines(run(log, other, "-f", "jsonl", "--source-system", "7"))
    assert [row["src"] for row in rows] == ["7/1"]


def test_raw_streams_have_no_times(tmp_path: Path) -> None:
    path = tmp_path / "stream.bin"
    path.write_bytes(b"".join(frame for _, frame in flight(9)))
    for arguments in ([path], [path, "--in", "mavlink"]):
        assert [row["t"] for row in lines(run(*arguments, "-f", "jsonl"))] == [None] * 9


def test_statistics_as_text_and_as_json(log: Path) -> None:
    log.write_bytes(log.read_bytes() + b"\x00" * 50)
    text = run(log, "--stats").stdout
    assert "9 messages, 2023-11-14T22:13:20.123456Z to 2023-11-14T22:13:20.390120Z, 0.267 s" in text
    assert "OPEN_DRONE_ID_LOCATION  12901      3  11.25" in text
    assert "1/1         9     0     0" in text
    assert f"garbage      1            {len(tlog_bytes(flight(9)))}" in text
    result = run(log, "--stats", "-f", "jsonl")
    (statistics,) = lines(result)
    assert statistics["types"] == {"HEARTBEAT": 3, "OPEN_DRONE_ID_LOCATION": 3, "RIDLINK_SEPARATION": 3}
    assert statistics["sources"] == {"1/1": {"messages": 9, "gaps": 0, "lost": 0}}
    assert statistics["rejects"] == [
        {"file": str(log), "cause": "garbage", "count": 1, "first_offset": len(tlog_bytes(flight(9)))}
    ]
    assert '"first_t":1700000000.123456,"last_t":1700000000.390120' in result.stdout


def test_statistics_of_several_files_say_which_is_damaged(log: Path, tmp_path: Path) -> None:
    other = tmp_path / "other.tlog"
    other.write_bytes(log.read_bytes()[:-1])
    text = run(log, other, "--stats").stdout
    assert "17 messages" in text
    assert re.search(rf"^truncated +1 +\d+ +{re.escape(str(other))}$", text, re.MULTILINE)


def test_progress_is_shown_on_a_terminal_and_taken_away(log: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    def shown(screen_is_free: bool) -> str:
        terminal = Terminal()
        monkeypatch.setattr("sys.stderr", terminal)
        line = progress.Progress(screen_is_free)
        with open_capture(log) as capture:
            assert len(list(capture)) == 9
            for _ in range(line.CHECK_EVERY):
                line.tick(capture)
        line.clear()
        return terminal.getvalue()

    assert shown(True) == ""  # not before a second has passed
    monkeypatch.setattr(progress, "PROGRESS_AFTER_S", 0.0)
    assert shown(False) == ""
    assert shown(True) == "\r100%  4,096 messages\x1b[K\r\x1b[K"


def test_fields_out_of_range_are_counted(tmp_path: Path) -> None:
    path = tmp_path / "odd.tlog"
    frame = Encoder(1, 1).encode("OPEN_DRONE_ID_LOCATION", direction=40000, speed_horizontal=25499)
    path.write_bytes(tlog_bytes([(START_US, frame)]))
    (statistics,) = lines(run(path, "--stats", "-f", "jsonl"))
    assert statistics["fields_out_of_range"] == {
        "OPEN_DRONE_ID_LOCATION.direction": 1, "OPEN_DRONE_ID_LOCATION.speed_horizontal": 1
    }  # fmt: skip
    assert "field out of range" in run(path, "--stats").stdout


@pytest.mark.parametrize("large", [10**12, 0], ids=["by message", "in blocks"])
@pytest.mark.parametrize(
    ("options", "found"),
    [
        ([], {"LOCATION.direction": 4, "MESSAGE_PACK.unknown_message_type": 2}),
        (["--source-system", "2"], {"LOCATION.direction": 2, "MESSAGE_PACK.unknown_message_type": 1}),
        (["--until", f"{START_US + 1}e-6"], {"LOCATION.direction": 1}),
        (["--types", "*LOCATION"], {"LOCATION.direction": 4}),
        (["--types", "*PACK"], {"MESSAGE_PACK.unknown_message_type": 2}),
        (["--types", "HEARTBEAT"], {}),
    ],
)  # fmt: skip
def test_fields_of_what_is_not_selected_are_not_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, large: int, options: list[str], found: dict[str, int]
) -> None:
    """Of two systems a LOCATION with a direction of 400 degrees, one such in a pack, and a member of no known type."""
    monkeypatch.setattr(reader, "LARGE_BYTES", large)
    members = bytes((0x12, 0b10, 200)) + bytes(22) + bytes((0x72,)) + bytes(24)
    records = []
    for sysid in (1, 2):
        encoder = Encoder(sysid, 1)
        frames = [
            encoder.encode("OPEN_DRONE_ID_LOCATION", direction=40000),
            encoder.encode(
                "OPEN_DRONE_ID_MESSAGE_PACK",
                single_message_size=25,
                msg_pack_size=2,
                messages=members.ljust(225, b"\0"),
            ),
            encoder.encode("HEARTBEAT"),
        ]
        records += [(START_US + len(records) + place, frame) for place, frame in enumerate(frames)]
    path = tmp_path / "odd.tlog"
    path.write_bytes(tlog_bytes(records))
    (statistics,) = lines(run(path, "--stats", "-f", "jsonl", *options))
    assert statistics["fields_out_of_range"] == {f"OPEN_DRONE_ID_{name}": count for name, count in found.items()}


def test_damage_is_reported_and_under_strict_is_exit_code_4(log: Path) -> None:
    log.write_bytes(log.read_bytes()[:-4])
    lax = run(log, "-f", "jsonl")
    assert len(lines(lax)) == 8 and lax.return_value == 0
    assert "damaged: 1 truncated (first at byte" in lax.stderr
    assert run(log, "--strict", "--stats").return_value == 4
    done = ridlink("decode", log, "--strict", "-f", "jsonl")
    assert done.returncode == 4 and len(done.stdout.splitlines()) == 8
    assert len(done.stderr.splitlines()) == 1


def test_output_appears_whole_or_not_at_all(log: Path, tmp_path: Path) -> None:
    out = tmp_path / "out.jsonl"
    assert run(log, "-f", "jsonl", "-o", out).stdout == ""
    assert len(out.read_bytes().splitlines()) == 9
    assert out.stat().st_mode & 0o777 == 0o666 & ~os.umask(os.umask(0o022))
    broken = tmp_path / "broken.tlog"
    broken.write_bytes(b"no frame in here")
    before = sorted(tmp_path.iterdir())
    done = ridlink("decode", broken, "-f", "jsonl", "-o", tmp_path / "other.jsonl")
    assert done.returncode == 3 and sorted(tmp_path.iterdir()) == before
    assert ridlink("decode", log, "-o", tmp_path / "nowhere" / "x").returncode == 3
    assert len(ridlink("decode", log, "-f", "jsonl", "-o", "/dev/stdout").stdout.splitlines()) == 9


def test_bytes_of_a_name_that_are_no_text_are_escaped_alike(log: Path, tmp_path: Path) -> None:
    folder, absent = tmp_path / "fl\udce4che", tmp_path / "l\udcfccke.tlog"
    done = run(absent, log, "-f", "csv", "-o", folder)
    assert done.stderr.splitlines()[0] == f"ridlink: {tmp_path}/l\\xfccke.tlog: No such file or directory"
    assert done.stderr.splitlines()[1].startswith(f"{tmp_path}/fl\\xe4che: ") and folder.is_dir()


def test_a_file_is_not_written_under_the_name_of_a_folder(log: Path, tmp_path: Path) -> None:
    """The slash at its end was left out, and there was a file."""
    refused = run(log, "-o", f"{tmp_path}/tables/").exception
    assert isinstance(refused, IsADirectoryError) and refused.filename == f"{tmp_path}/tables/"
    assert [path.name for path in tmp_path.iterdir()] == ["flight.tlog"]


@pytest.mark.parametrize(("output_format", "name"), [("jsonl", "out.jsonl"), ("kml", "out.kml"), ("csv", "tables")])
def test_where_nothing_can_be_written_what_was_asked_for_is_named(
    log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, output_format: str, name: str
) -> None:
    def refuse(path: object, *arguments: object, **options: object) -> None:
        raise OSError(errno.EROFS, "Read-only file system", str(path))

    def refuse_new(path: str | Path, mode: str = "r") -> Any:
        return refuse(path) if "x" in mode else open(path, mode)

    monkeypatch.setattr(files, "open", refuse_new, raising=False)
    for operation in ("mkdir", "unlink"):  # a read-only file system refuses to remove what is not there, too
        monkeypatch.setattr(Path, operation, refuse)
    refused = run(log, "-f", output_format, "-o", tmp_path / name).exception
    assert isinstance(refused, OSError) and refused.filename == str(tmp_path / name)


@pytest.mark.parametrize(
    ("output_format", "number"),
    [
        ("jsonl", signal.SIGTERM),
        ("jsonl", signal.SIGINT),
        ("jsonl", signal.SIGHUP),
        ("csv", signal.SIGTERM),
        ("mcap", signal.SIGTERM),
    ],
)
def test_of_a_command_that_a_signal_ends_nothing_stays(
    tmp_path: Path, output_format: str, number: signal.Signals
) -> None:
    command = [sys.executable, "-m", "ridlink", "decode", "-", "-f", output_format, "-o", str(tmp_path / "out")]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdin is not None
        process.stdin.write(tlog_bytes(flight(3000)))  # more than a pipe takes: the reader has begun
        process.stdin.flush()
        assert [path.name[:5] for path in tmp_path.iterdir()] == [".out."]
        process.send_signal(number)
        _, err = process.communicate(timeout=30)
    assert process.returncode == 128 + number and list(tmp_path.iterdir()) == []
    assert b"Traceback" not in err


def test_times_that_hold_nothing_between_them_are_refused(log: Path) -> None:
    done = ridlink("decode", log, "--since", "2026-11-30T01:53", "--until", "2026-11-30T01:52")
    assert (done.returncode, done.stdout) == (2, b"")
    assert done.stderr.startswith(b"ridlink: --since is not before --until: between them there is nothing (see")


def test_a_full_disk_is_one_line_and_leaves_nothing(log: Path) -> None:
    done = ridlink("decode", log, "-o", "/dev/full")
    assert (done.returncode, done.stderr) == (3, b"ridlink: /dev/full: No space left on device\n")
    command = [sys.executable, "-m", "ridlink", "decode", str(log), "--stats"]
    with open("/dev/full", "wb") as full:
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, timeout=60, check=False)
    assert (done.returncode, done.stderr) == (3, b"ridlink: standard output: No space left on device\n")


@pytest.mark.parametrize("output_format", ["csv", "parquet", "mcap", "kml", "jsonl"])
def test_a_disk_without_room_is_said_of_the_output(log: Path, tmp_path: Path, output_format: str) -> None:
    limited = "import resource, runpy, sys; resource.setrlimit(resource.RLIMIT_FSIZE, (300, 300)); " \
              "runpy.run_module('ridlink', run_name='__main__')"  # fmt: skip
    output = tmp_path / "out"
    command = [sys.executable, "-B", "-c", limited, "decode", str(log), "-f", output_format, "-o", str(output)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stderr) == (3, f"ridlink: {output}: File too large\n")
    assert list(tmp_path.iterdir()) == [log]


@pytest.mark.parametrize(
    ("content", "code"), [(None, 3), (b"", 3), (b"text\n" * 100, 3), (b"\xd4\xc3\xb2\xa1" + bytes(40), 3)]
)
def test_what_cannot_be_read_is_one_line_and_exit_code_3(tmp_path: Path, content: bytes | None, code: int) -> None:
    path = tmp_path / "file.bin"
    if content is not None:
        path.write_bytes(content)
    done = ridlink("decode", path)
    assert done.returncode == code and done.stdout == b""
    assert len(done.stderr.splitlines()) == 1 and str(path).encode() in done.stderr


def test_what_cannot_be_opened_is_said_before_the_first_file_is_read_and_keeps_no_other_back(
    log: Path, tmp_path: Path
) -> None:
    out = tmp_path / "out.jsonl"
    alone = ridlink("decode", log, "-f", "jsonl").stdout
    done = ridlink("decode", tmp_path, log, tmp_path / "absent.tlog", "-f", "jsonl")
    said = f"ridlink: {tmp_path}: Is a directory\nridlink: {tmp_path / 'absent.tlog'}: No such file or directory\n"
    assert (done.returncode, done.stdout, done.stderr.decode()) == (3, alone, said)
    done = ridlink("decode", log, tmp_path / "absent.tlog", "-f", "jsonl", "-o", out)
    assert done.returncode == 3 and out.read_bytes() == alone
    out.unlink()
    done = ridlink("decode", tmp_path / "absent.tlog", tmp_path, "-f", "jsonl", "-o", out)
    assert done.returncode == 3 and len(done.stderr.splitlines()) == 2 and not out.exists()


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_a_file_that_may_not_be_read_keeps_no_other_back(log: Path, tmp_path: Path) -> None:
    secret = tmp_path / "secret.tlog"
    secret.write_bytes(log.read_bytes())
    secret.chmod(0)
    done = ridlink("decode", secret, log, "-f", "jsonl")
    assert done.returncode == 3 and len(done.stdout.splitlines()) == 9
    assert done.stderr.decode() == f"ridlink: {secret}: Permission denied\n"


def test_a_named_pipe_is_opened_once(log: Path, tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    command = [sys.executable, "-m", "ridlink", "decode", str(pipe), "-f", "jsonl"]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as process:
        pipe.write_bytes(log.read_bytes())
        out, _ = process.communicate(timeout=30)
    assert process.returncode == 0 and len(out.splitlines()) == 9


@pytest.mark.parametrize("options", [("-f", "jsonl"), ("--stats", "-f", "jsonl"), ("-f", "geojson"), ("--strict",)])
def test_a_file_that_is_no_capture_does_not_keep_the_others_back(
    log: Path, tmp_path: Path, options: tuple[str, ...]
) -> None:
    alone = ridlink("decode", log, *options)
    assert alone.returncode == 0 and alone.stdout
    for content in (b"", b"text\n" * 100, b"\xd4\xc3\xb2\xa1" + bytes(40)):
        broken = tmp_path / "broken.bin"
        broken.write_bytes(content)
        both = ridlink("decode", broken, log, *options)
        assert (both.returncode, both.stdout) == (3, alone.stdout), content
        assert len(both.stderr.splitlines()) == 1 and str(broken).encode() in both.stderr


def test_no_file_is_a_usage_error() -> None:
    assert ridlink("decode").returncode == 2


def test_a_live_pipe_is_decoded_as_it_comes() -> None:
    """The first messages are out while the writer still holds its end open."""
    data = tlog_bytes(flight(40))
    with subprocess.Popen(
        [sys.executable, "-m", "ridlink", "decode", "-", "-f", "jsonl"], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as process:
        assert process.stdin is not None and process.stdout is not None
        process.stdin.write(data)
        process.stdin.flush()
        assert json.loads(process.stdout.readline())["seq"] == 0
        process.stdin.close()
        assert len(process.stdout.read().splitlines()) == 39
    assert process.returncode == 0


def test_a_reader_that_goes_away_is_no_error(tmp_path: Path) -> None:
    path = tmp_path / "large.tlog"
    path.write_bytes(tlog_bytes(flight(3000)))
    with subprocess.Popen(
        [sys.executable, "-m", "ridlink", "decode", str(path)], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        assert process.stdout is not None and process.stderr is not None
        process.stdout.readline()
        process.stdout.close()
        assert process.stderr.read() == b""
    assert process.returncode == 0


@pytest.mark.parametrize("leaves", [True, False])
def test_a_reader_that_goes_away_and_an_interrupt_end_the_rows_of_a_large_file(tmp_path: Path, leaves: bool) -> None:
    path = tmp_path / "large.tlog"
    path.write_bytes(20 * tlog_bytes(flight(3000)))
    assert path.stat().st_size > reader.LARGE_BYTES
    with subprocess.Popen(
        [sys.executable, "-m", "ridlink", "decode", str(path)], stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        assert process.stdout is not None and process.stderr is not None
        assert b" HEARTBEAT " in process.stdout.readline()
        if leaves:
            process.stdout.close()
        else:
            process.send_signal(signal.SIGINT)  # while it waits for us to read on
        said = process.stderr.read().splitlines()
        assert [line for line in said if line and b" compiling " not in line] == []
    assert process.returncode == (0 if leaves else 130)


def test_an_interrupt_ends_it_without_a_traceback() -> None:
    with subprocess.Popen(
        [sys.executable, "-m", "ridlink", "decode", "-"], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    ) as process:  # fmt: skip
        assert process.stdin is not None and process.stdout is not None and process.stderr is not None
        process.stdin.write(tlog_bytes(flight(40)))
        process.stdin.flush()
        process.stdout.readline()
        process.send_signal(signal.SIGINT)
        assert process.stderr.read().strip() == b""
    assert process.returncode == 130


ORACLE = """
import json, sys
from collections import Counter
from pymavlink import mavutil
log = mavutil.mavlink_connection(sys.argv[1])
types, systems = Counter(), Counter()
while (message := log.recv_match()) is not None:
    name = message.get_type()
    if name.startswith("UNKNOWN"):  # of these mavutil forgets the sender
        types["UNKNOWN"] += 1
    else:
        types[name] += 1
        systems[f"{message.get_srcSystem()}/{message.get_srcComponent()}"] += 1
print(json.dumps([types, systems]))
"""


@pytest.mark.skipif(not REAL.exists(), reason="the recording of real autopilots is not part of the project")
def test_a_real_recording_holds_what_mavutil_finds_in_it() -> None:
    environment = os.environ | {"MAVLINK20": "1", "MAVLINK_DIALECT": "common"}
    oracle = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", ORACLE, str(REAL)], capture_output=True, check=True, env=environment
    )
    types, systems = json.loads(oracle.stdout.splitlines()[-1])
    rows = lines(run(REAL, "-f", "jsonl", "--strict"))
    assert Counter(row["type"] for row in rows) == types
    assert Counter(row["src"] for row in rows if row["type"] != "UNKNOWN") == systems
    (statistics,) = lines(run(REAL, "--stats", "-f", "jsonl"))
    assert statistics["types"] == types and statistics["rejects"] == []
