"""Kernels that are not on the disk yet are compiled by another process: this one has a stream to keep up."""

from __future__ import annotations

import asyncio
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from numba import config
from numba.core import caching

from ridlink.avoidance.types import SolverKind
from ridlink.daemon.warming import warm_up_unless
from tests.loopback import PATIENCE_S

pytestmark = pytest.mark.skipif(bool(config.DISABLE_JIT), reason="nothing is compiled")

COLD = """
import asyncio, json, sys
from pathlib import Path
from ridlink.avoidance.packing import pack, unpack_memory
from ridlink.avoidance.rotation import rotate_one
from ridlink.avoidance.solver import is_warm
from ridlink.avoidance.types import SolverKind
from ridlink.daemon.warming import warm_up_unless

before = is_warm(SolverKind.ROTATION)
asyncio.run(warm_up_unless(asyncio.Event(), SolverKind.ROTATION))
compiled_here = [sum(kernel.stats.cache_misses.values()) for kernel in (rotate_one, pack, unpack_memory)]
print(json.dumps([before, is_warm(SolverKind.ROTATION), compiled_here]))
"""
WARM = "from ridlink.avoidance.solver import is_warm; print(is_warm('rotation'), is_warm('halfplane'))"


@pytest.mark.programs
def test_f26_a_daemon_with_a_cold_cache_compiles_nothing_itself(tmp_path: Path) -> None:
    """The smallest solver, and it takes its four seconds: nothing less shows that the two processes agree."""
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}

    def said(program: str) -> str:
        command = [sys.executable, "-c", program]
        return subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout

    assert json.loads(said(COLD)) == [False, True, [0, 0, 0]]
    assert said(WARM) == "True False\n"
    next(tmp_path.rglob("packing.pack-*.nbi")).unlink()
    assert said(WARM) == "False False\n", "one kernel that is missing is enough"


ONE_OF_TWO = """
from ridlink.avoidance.packing import pack, unpack_memory
from ridlink.avoidance.rotation import rotate_one
from ridlink.avoidance.solver import warm_up
warm_up("rotation")
print(sum(sum(kernel.stats.cache_misses.values()) for kernel in (rotate_one, pack, unpack_memory)))
"""


@pytest.mark.programs
def test_of_two_processes_that_start_together_with_a_cold_cache_one_compiles(tmp_path: Path) -> None:
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)}
    command = [sys.executable, "-c", ONE_OF_TWO]
    both = [subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True) for _ in range(2)]
    assert sorted(process.communicate()[0] for process in both) == ["0\n", "3\n"]
    assert all(process.returncode == 0 for process in both)


def test_whoever_stops_waiting_ends_the_compiler(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pipe = tmp_path / "compiler"
    os.mkfifo(pipe)
    endless = f"import os, pathlib, signal; pathlib.Path({str(pipe)!r}).write_text(str(os.getpid())); signal.pause()"
    monkeypatch.setattr("ridlink.daemon.warming.COMPILE", endless)
    monkeypatch.setattr("ridlink.daemon.warming.is_warm", lambda _: False)

    async def test() -> None:
        stop = asyncio.Event()
        warming = asyncio.create_task(warm_up_unless(stop, SolverKind.HALFPLANE))
        compiler = Path("/proc", await asyncio.to_thread(pipe.read_text))
        assert compiler.exists()
        stop.set()
        await asyncio.wait_for(warming, PATIENCE_S)
        assert not compiler.exists()

    asyncio.run(test())


def test_where_nothing_can_be_kept_no_other_process_compiles(monkeypatch: pytest.MonkeyPatch) -> None:
    """What another process compiles is gone with it."""
    started: list[object] = []
    warmed: list[SolverKind] = []

    async def start(*command: object, **_: object) -> None:
        started.append(command)
        raise OSError

    monkeypatch.setattr("asyncio.create_subprocess_exec", start)
    monkeypatch.setattr(caching.CacheImpl, "_locator_classes", [])
    monkeypatch.setattr("ridlink.daemon.warming.is_warm", lambda _: False)
    monkeypatch.setattr("ridlink.daemon.warming.warm_up", warmed.append)
    asyncio.run(warm_up_unless(asyncio.Event(), SolverKind.GRADED))
    assert (started, warmed) == ([], [SolverKind.GRADED])


def test_without_another_process_the_kernels_are_loaded_all_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    warmed: list[SolverKind] = []
    monkeypatch.setattr("sys.executable", "/nowhere/python")
    monkeypatch.setattr("ridlink.daemon.warming.is_warm", lambda _: False)
    monkeypatch.setattr("ridlink.daemon.warming.warm_up", warmed.append)
    asyncio.run(warm_up_unless(asyncio.Event(), SolverKind.GRADED))
    assert warmed == [SolverKind.GRADED]
