"""The command line as a whole: quick help, one-line errors, documented exit codes."""

from __future__ import annotations

import os
import re
import select
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import click
import pytest

import ridlink.cli
from ridlink.campaign.cell import BASELINE
from ridlink.campaign.chance import ErrorModel
from ridlink.campaign.response import Dynamics
from ridlink.campaign_runner.choice import SOLVERS
from ridlink.errors import (
    CaptureError,
    ConfigError,
    FrameError,
    LinkError,
    MissingExtraError,
    PayloadError,
    RidlinkError,
    UnknownMessageError,
)
from ridlink.mavlink.codec import Encoder
from ridlink.separation.definitions import Definition
from tests.captures.conftest import flight, tlog_bytes
from tests.cli.full_pipe import LEAST_BYTES, bytes_in, full_pipe

HEAVY = ("numpy", "numba", "pymavlink", "pymap3d", "lxml", "mavsdk", "rich", "ridlink.mavlink")


def ridlink_process(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "ridlink", *arguments], capture_output=True, text=True, timeout=60, check=False
    )


def words_of_help(command: str) -> set[str]:
    """Words of the options of a command, as they are before lines are broken."""
    options = ridlink_process(*command.split(), "--help").stdout.partition("Options:")[2]
    return set(re.findall(r"[a-z0-9]+(?:-[a-z0-9]+)*", re.sub(r"-\n\s+", "-", options)))


def interrupted_while(loading: str, *arguments: str, ignored: bool = False) -> subprocess.CompletedProcess[str]:
    """`ridlink` that gets Ctrl-C when it begins to load this module."""
    program = (
        "import _signal, os, runpy, sys\n"
        "class Interrupt:\n"
        "    def find_spec(name, *_):\n"
        f"        if name == {loading!r}: os.kill(os.getpid(), _signal.SIGINT)\n"
        f"if {ignored}: _signal.signal(_signal.SIGINT, _signal.SIG_IGN)\n"
        f"sys.modules.pop({loading!r}, None)\n"
        "sys.meta_path.insert(0, Interrupt)\n"
        f"sys.argv = {['ridlink', *arguments]!r}\n"
        "runpy.run_module('ridlink', run_name='__main__')\n"
    )
    return subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=False)


NO_PRIVILEGE = ["setpriv", "--bounding-set", "-dac_override,-dac_read_search",
                "--inh-caps", "-dac_override,-dac_read_search"]  # fmt: skip
"""Root may read everything: what it begins with this may not."""

BUFFERED = os.environ | {"PYTHONUNBUFFERED": ""}
"""An environment in which Python keeps what could not be written, as it does unless told otherwise."""

Run = Callable[..., int]


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch) -> Run:
    """Run main() in this process with a command ``try`` that raises or returns what it is given: its exit code."""

    def run_main(outcome: object, *arguments: str) -> int:
        @click.command()
        def attempt() -> object:
            if isinstance(outcome, BaseException):
                raise outcome
            return outcome

        monkeypatch.setattr(ridlink.cli, "COMMANDS", {"try": f"{__name__}:attempt"})
        monkeypatch.setattr(sys.modules[__name__], "attempt", attempt, raising=False)
        monkeypatch.setattr(sys, "argv", ["ridlink", *(arguments or ("try",))])
        monkeypatch.delenv("RIDLINK_DEBUG", raising=False)
        with pytest.raises(SystemExit) as stopped:
            ridlink.cli.main()
        assert isinstance(stopped.value.code, int)
        return stopped.value.code

    return run_main


class TestHelp:
    def test_lists_every_command_with_its_purpose(self) -> None:
        done = ridlink_process("--help")
        assert done.returncode == 0
        assert done.stderr == ""
        for name in ridlink.cli.COMMANDS:
            assert f"\n  {name} " in done.stdout
        assert "..." not in done.stdout.partition("Commands:")[2]  # a purpose that breaks off

    def test_imports_nothing_heavy(self) -> None:
        program = (
            "import sys; sys.argv = ['ridlink', '--help']\n"
            "import ridlink.cli\n"
            "try: ridlink.cli.main()\n"
            f"except SystemExit: print([m for m in {HEAVY!r} if m in sys.modules], file=sys.stderr)\n"
        )
        done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=True)
        assert done.stderr.strip() == "[]"

    @pytest.mark.parametrize("arguments", [("-h",), ("dialect", "--help"), ("dialect", "check", "-h")])
    def test_help_of_a_command(self, arguments: tuple[str, ...]) -> None:
        done = ridlink_process(*arguments)
        assert (done.returncode, done.stderr) == (0, "")
        assert done.stdout.startswith("Usage: ridlink")

    @pytest.mark.parametrize(
        "command",
        ["decode", "encode", "report", "whatif", "record", "avoid", "demo", "campaign run"],
    )
    def test_what_writes_a_file_says_what_becomes_of_one_that_is_there(self, command: str) -> None:
        assert "replace" in ridlink_process(*command.split(), "--help").stdout

    @pytest.mark.parametrize(
        "command", ["avoid", "demo", "report", "whatif", "view", "top", "mqtt", "capacity", "campaign run"]
    )
    def test_help_names_the_definitions(self, command: str) -> None:
        assert set(Definition) <= words_of_help(command)

    def test_help_of_a_campaign_names_what_its_options_take(self) -> None:
        assert {BASELINE, *ErrorModel, *SOLVERS, *Dynamics} <= words_of_help("campaign run")

    def test_version_names_the_generator(self) -> None:
        done = ridlink_process("--version")
        assert done.returncode == 0
        assert done.stdout.startswith("ridlink ")
        assert "pymavlink" in done.stdout


class TestUsage:
    def test_unknown_command(self) -> None:
        done = ridlink_process("fly-me-to-the-moon")
        assert done.returncode == 2
        assert done.stdout == ""
        assert done.stderr == "ridlink: No such command 'fly-me-to-the-moon'. (see 'ridlink --help')\n"

    def test_a_command_that_is_nearly_one_is_told_which(self) -> None:
        done = ridlink_process("dcode", "flight.tlog")
        assert (done.returncode, done.stdout) == (2, "")
        assert done.stderr == "ridlink: No such command 'dcode': did you mean 'decode'? (see 'ridlink --help')\n"

    @pytest.mark.parametrize("group", [(), ("campaign",), ("dialect",)])
    def test_a_group_without_a_command_shows_its_help_and_no_error(self, group: tuple[str, ...]) -> None:
        done = ridlink_process(*group)
        assert (done.returncode, done.stdout) == (2, "")
        assert done.stderr == ridlink_process(*group, "--help").stdout

    def test_unknown_option(self) -> None:
        done = ridlink_process("dialect", "xml", "--colour")
        assert done.returncode == 2
        assert done.stderr.startswith("ridlink: ")
        assert "(see 'ridlink dialect xml --help')" in done.stderr
        assert done.stderr.count("\n") == 1

    @pytest.mark.parametrize("arguments", [("decode", "-o"), ("report", "--html")])
    def test_an_option_without_its_value_is_told_with_the_command_that_it_is_of(
        self, arguments: tuple[str, ...]
    ) -> None:
        """Click's parser does not say of which."""
        done = ridlink_process(*arguments)
        assert (done.returncode, done.stdout) == (2, "")
        said = f"ridlink: Option '{arguments[1]}' requires an argument. (see 'ridlink {arguments[0]} --help')\n"
        assert done.stderr == said

    def test_a_reader_that_goes_away_is_no_error(self) -> None:
        process = subprocess.Popen(
            [sys.executable, "-m", "ridlink", "dialect", "lua"], stdout=subprocess.PIPE, stderr=subprocess.PIPE
        )
        assert process.stdout is not None and process.stderr is not None
        process.stdout.read(10)
        process.stdout.close()
        assert process.stderr.read() == b""
        process.stderr.close()
        assert process.wait(timeout=60) == 0

    @pytest.mark.parametrize("arguments", [["dialect", "lua"], ["decode", "{log}", "-f", "jsonl"]])
    def test_what_a_pipe_takes_in_pieces_is_whole_though_a_signal_comes_between(
        self, tmp_path: Path, arguments: list[str]
    ) -> None:
        """Where Python buffers nothing, what the first piece had not taken was left out without a word."""
        (tmp_path / "f.tlog").write_bytes(tlog_bytes(flight(200)))
        command = [sys.executable, "-m", "ridlink", *(word.format(log=tmp_path / "f.tlog") for word in arguments)]
        whole = subprocess.run(command, capture_output=True, timeout=60).stdout
        assert len(whole) > 4 * LEAST_BYTES
        with full_pipe() as writing:
            process = subprocess.Popen(command, stdout=writing, env=os.environ | {"PYTHONUNBUFFERED": "1"})
            os.read(writing.reading, LEAST_BYTES)
            while bytes_in(writing.reading) < LEAST_BYTES:  # then it waits in the middle of a text
                assert process.poll() is None
            process.send_signal(signal.SIGSTOP)
            os.waitid(os.P_PID, process.pid, os.WSTOPPED)
            process.send_signal(signal.SIGCONT)
            text = b""
            while process.poll() is None or bytes_in(writing.reading):
                if select.select([writing.reading], [], [], 0.1)[0]:
                    text += os.read(writing.reading, LEAST_BYTES)
        assert (process.returncode, text) == (0, whole)

    @pytest.mark.parametrize("arguments", [["--version"], ["--help"], ["sim", "--list"]])
    def test_a_reader_that_has_gone_before_the_first_line_is_no_error(self, arguments: list[str]) -> None:
        reads, writes = os.pipe()
        os.close(reads)
        command = [sys.executable, "-m", "ridlink", *arguments]
        with open(writes, "wb") as pipe:
            done = subprocess.run(command, stdout=pipe, stderr=subprocess.PIPE, env=BUFFERED, timeout=60)
        assert (done.returncode, done.stderr) == (0, b"")

    @pytest.mark.parametrize("arguments", [["--version"], ["sim", "--list"]])
    def test_output_that_a_full_disk_does_not_take_is_one_line(self, arguments: list[str]) -> None:
        """Python would try again at its end, say so in two lines more, and end with 120."""
        command = [sys.executable, "-m", "ridlink", *arguments]
        with open("/dev/full", "wb") as full:
            done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, env=BUFFERED, timeout=60)
        assert (done.returncode, done.stderr) == (3, b"ridlink: standard output: No space left on device\n")

    @pytest.mark.parametrize(("arguments", "code"), [([], 2), (["decode"], 2), (["decode", "missing.tlog"], 3)])
    def test_an_error_that_a_full_disk_does_not_take_keeps_its_code(self, arguments: list[str], code: int) -> None:
        with open("/dev/full", "wb") as full:
            done = subprocess.run([sys.executable, "-m", "ridlink", *arguments], stderr=full, timeout=60)
        assert done.returncode == code

    @pytest.mark.parametrize(
        "arguments", ["decode f.hex -f jsonl", "whatif f.tlog", "sim --list", "encode f.jsonl -o o.hex"]
    )
    def test_a_standard_stream_that_is_closed_leads_nowhere(self, tmp_path: Path, arguments: str) -> None:
        frame = Encoder(1, 1).encode("HEARTBEAT", type=2)
        (tmp_path / "f.hex").write_text(f"{frame.hex()}\n")
        (tmp_path / "f.tlog").write_bytes((1_700_000_000_000_000).to_bytes(8, "big") + frame)
        (tmp_path / "f.jsonl").write_text(f'{{"type":"HEARTBEAT","src":"1/1","t":1,"frame":"{frame.hex()}"}}\n')
        command = ["sh", "-c", f'"$0" -m ridlink {arguments} <&- >&-', sys.executable]
        environment = os.environ | {"PYTHONPATH": os.getcwd()}
        done = subprocess.run(command, stderr=subprocess.PIPE, text=True, cwd=tmp_path, env=environment, timeout=60)
        assert (done.returncode, done.stderr) == (0, "")
        if "-o o.hex" in arguments:
            assert (tmp_path / "o.hex").read_text() == f"{frame.hex()}\n"


class TestExitCodes:
    @pytest.mark.parametrize(
        ("error", "code", "text"),
        [
            (ConfigError("x = 3: unknown key"), 2, "ridlink: x = 3: unknown key"),
            (MissingExtraError("mqtt", "mqtt"), 2, "ridlink: mqtt needs the extra 'mqtt': pip install 'ridlink[mqtt]'"),
            (click.UsageError("no goal"), 2, "ridlink: no goal (see 'ridlink try --help')"),
            (click.BadParameter("not a port"), 2, "ridlink: Invalid value: not a port (see 'ridlink try --help')"),
            (UnknownMessageError("NO_SUCH"), 2, "ridlink: the dialect has no message 'NO_SUCH'"),
            (PayloadError("A.b takes 1 byte", message="A", field="b"), 2, "ridlink: A.b takes 1 byte"),
            (FrameError("bad frame"), 2, "ridlink: bad frame"),
            (RidlinkError("anything else on purpose"), 2, "ridlink: anything else on purpose"),
            (LinkError("udpin:127.0.0.1:14540: in use"), 3, "ridlink: udpin:127.0.0.1:14540: in use"),
            (CaptureError("a.tlog: no capture"), 3, "ridlink: a.tlog: no capture"),
            (FileNotFoundError(2, "No such file", "a.tlog"), 3, "ridlink: a.tlog: No such file"),
            (PermissionError(13, "Permission denied"), 3, "ridlink: Permission denied"),
            (FileNotFoundError(2, "No such file", ""), 3, "ridlink: '': No such file"),
            (ConfigError("\x1b[2J\xe9\udcff\n: no such place"), 2, "ridlink: \\x1b[2J\xe9\\xff\\x0a: no such place"),
            (click.FileError("a.tlog", "gone"), 3, "ridlink: Could not open file 'a.tlog': gone"),
            (ZeroDivisionError("by nothing"), 70,
             "ridlink: internal error: ZeroDivisionError: by nothing (RIDLINK_DEBUG=1 shows where)"),
        ],
        ids=lambda value: type(value).__name__ if isinstance(value, Exception) else "",
    )  # fmt: skip
    def test_every_error_is_one_line(
        self, run: Run, capsys: pytest.CaptureFixture[str], error: Exception, code: int, text: str
    ) -> None:
        assert run(error) == code
        assert capsys.readouterr() == ("", text + "\n")

    @pytest.mark.parametrize(
        "command",
        [
            "analyze --out", "avoid --log", "avoid --input-log", "avoid --config", "avoid --signing-key",
            "broadcast --signing-state", "campaign report", "campaign run -o", "campaign run --log", "decode x -o",
            "demo --log", "dialect c -o", "encode x -o", "mqtt --broker mqtts://a@127.0.0.1:9 --ca-file",
            "mqtt --broker mqtt://a@127.0.0.1:9 --password-file", "record udpin:127.0.0.1:0 -o", "report x -o",
            "report x --html", "view", "whatif x -o",
        ],
    )  # fmt: skip
    def test_an_empty_name_is_no_file_and_not_the_folder_here(
        self, command: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr(sys, "argv", ["ridlink", *command.split(), ""])
        with pytest.raises(SystemExit) as end:
            ridlink.cli.main()
        out, err = capsys.readouterr()
        assert (end.value.code, out) == (2, "")
        assert "an empty name" in err and err.count("\n") == 1 and not list(tmp_path.iterdir())

    @pytest.mark.parametrize(
        ("command", "takes"),
        [
            ("analyze --out", "folder"),
            ("campaign run --runs 2 -o", "folder"),
            ("dialect c -o", "folder"),
            ("avoid --standby --vehicle udpin:127.0.0.1:0 --log", "file"),
            ("campaign run --scenario crossing --definition snmac --only-run 1 --log", "file"),
            ("decode", "file"),
            ("demo --headless --any-ports --log", "file"),
            ("mqtt --broker mqtt://a@127.0.0.1:9 --password-file", "file"),
            ("record udpin:127.0.0.1:0 -o", "file"),
            ("record udpin:127.0.0.1:0 --force -o", "file"),
        ],
    )
    def test_a_folder_for_a_file_and_a_file_for_a_folder_are_exit_code_3(
        self, tmp_path: Path, command: str, takes: str
    ) -> None:
        wrong = tmp_path / "wrong"
        wrong.mkdir() if takes == "file" else wrong.touch()
        words = [sys.executable, "-m", "ridlink", *command.split(), str(wrong)]
        done = subprocess.run(words, capture_output=True, text=True, timeout=60.0)
        assert (done.returncode, done.stdout) == (3, "")
        assert done.stderr == f"ridlink: {wrong}: {'Is' if takes == 'file' else 'Not'} a directory\n"
        assert list(tmp_path.iterdir()) == [wrong], "nothing half written"

    @pytest.mark.parametrize(
        "command",
        [
            "avoid --standby --config",
            "avoid --replay",
            "decode",
            "dialect check",
            "view",
            "mqtt --broker mqtt://127.0.0.1:9 --password-file",
            "mqtt --broker mqtts://127.0.0.1:9 --ca-file",
            "sim --scenario",
        ],
    )
    def test_a_file_that_may_not_be_read_is_no_wrong_usage(self, tmp_path: Path, command: str) -> None:
        path = tmp_path / "secret.toml"
        path.write_bytes(b"cruise = 3\n")
        path.chmod(0)
        done = subprocess.run(
            [*(NO_PRIVILEGE if os.geteuid() == 0 else []), sys.executable, "-m", "ridlink", *command.split(), path],
            capture_output=True, text=True, timeout=60,
        )  # fmt: skip
        assert (done.returncode, done.stdout) == (3, "")
        assert done.stderr.endswith("secret.toml: Permission denied\n") or "no certificates: Permission" in done.stderr
        assert done.stderr.startswith("ridlink: ") and done.stderr.count("\n") == 1

    def test_internal_errors_show_where_on_request(self, run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
        run(None)
        monkeypatch.setattr(sys.modules[__name__], "attempt", click.command()(lambda: 1 / 0))
        monkeypatch.setenv("RIDLINK_DEBUG", "1")
        with pytest.raises(ZeroDivisionError):
            ridlink.cli.main()

    @pytest.mark.parametrize("interrupt", [KeyboardInterrupt(), click.Abort()])
    def test_an_interrupt_is_128_and_its_signal(self, run: Run, interrupt: BaseException) -> None:
        assert run(interrupt) == 130

    def test_an_interrupt_while_a_class_is_made_is_an_interrupt(self, run: Run) -> None:
        """Python 3.11 makes a RuntimeError of it where a field of the class is told its name."""
        internal = RuntimeError("Error calling __set_name__")
        internal.__cause__ = KeyboardInterrupt()
        assert run(internal) == 130

    @pytest.mark.parametrize("loading", ["signal", "ridlink.cli", "click", "ridlink.cli.decode", "ridlink.captures"])
    def test_an_interrupt_while_modules_are_loaded_ends_without_a_word(self, loading: str) -> None:
        done = interrupted_while(loading, "decode", "f.tlog")
        assert (done.returncode, done.stdout, done.stderr.strip()) == (130, "", "")  # click ends the line of ^C

    def test_an_interrupt_that_the_shell_had_ignored_stays_ignored(self) -> None:
        done = interrupted_while("click", "--version", ignored=True)
        assert (done.returncode, done.stderr) == (0, "") and done.stdout.startswith("ridlink ")

    @pytest.mark.parametrize(("outcome", "code"), [(None, 0), (0, 0), (1, 1), (4, 4), ("text", 0)])
    def test_a_returned_number_is_the_exit_code(self, run: Run, outcome: object, code: int) -> None:
        assert run(outcome) == code

    def test_a_command_may_leave_by_exit(self, run: Run) -> None:
        assert run(click.exceptions.Exit(4)) == 4

    def test_nothing_is_torn_down_under_a_compiler_that_is_at_work(self) -> None:
        """A daemon that is ended while its kernels are compiled crashed now and then in LLVM, with code 139."""
        program = (
            "import atexit, sys, threading; from ridlink.cli import main; from ridlink.daemon.warming import THREAD\n"
            "atexit.register(print, 'torn down'); sys.argv = ['ridlink', *sys.argv[1:]]\n"
            "threading.Thread(target=threading.Event().wait, name=THREAD, daemon=True).start()\n"
            "main()"
        )
        for arguments, code in ((["--version"], 0), (["no-such-command"], 2)):
            done = subprocess.run(
                [sys.executable, "-c", program, *arguments], capture_output=True, text=True, timeout=60
            )
            assert done.returncode == code and (done.stdout + done.stderr).startswith("ridlink")
            assert "torn down" not in done.stdout


@pytest.mark.parametrize("command", ["view", "report", "whatif", "decode"])
def test_a_link_in_place_of_a_file_is_told_the_commands_for_links(command: str) -> None:
    done = subprocess.run(
        [sys.executable, "-m", "ridlink", command, "udpin:127.0.0.1:14550"], capture_output=True, text=True, timeout=60
    )
    assert done.returncode == 2 and done.stderr.count("\n") == 1
    assert "is a link, not a file: 'ridlink view --source udpin:127.0.0.1:14550' shows its traffic" in done.stderr


@pytest.mark.parametrize("command", ["view", "report", "whatif"])
def test_a_file_that_is_missing_is_told_before_anything_is_loaded_that_would_read_it(command: str) -> None:
    program = (
        "import sys\nfrom ridlink.cli import main\n"
        f"sys.argv = ['ridlink', {command!r}, 'absent.tlog']\n"
        "try: main()\n"
        "finally: print([name for name in ('numba', 'ridlink.review') if name in sys.modules])\n"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stderr) == (3, "ridlink: absent.tlog: No such file or directory\n")
    assert done.stdout == "[]\n"
