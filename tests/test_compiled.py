"""Kernels are compiled strictly and kept, where there is a place to keep them."""

from __future__ import annotations

import ast
import fcntl
import gc
import importlib
import os
import resource
import subprocess
import sys
import threading
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from queue import Empty, Queue
from types import CodeType, FunctionType
from typing import Any

import pytest
from numba import config, types
from numba.core import caching
from numba.core.errors import TypingError
from numba.core.typing.context import BaseContext

import ridlink
from ridlink.captures.fast.calling import announce
from ridlink.compiled import _KernelCache, can_be_kept, compiling_alone, is_compiled, kernel_decorator
from ridlink.compiler import instructions_for

pytestmark = pytest.mark.skipif(bool(config.DISABLE_JIT), reason="nothing is compiled")


def halved(value: float) -> float:
    return value / 2.0


def doubled(value: float) -> float:
    return value + value


@instructions_for(doubled)
def double(typing_context: Any, value: Any) -> Any:
    return types.float64(types.float64), lambda context, builder, call, arguments: builder.fadd(*2 * arguments)


def test_instructions_stand_in_the_caller_itself(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Each would take its time to compile if it were a function, once for every kind of caller."""
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path))

    @kernel_decorator([Path(__file__)])
    def fourfold(value: float) -> float:
        return doubled(doubled(value))

    assert fourfold(3) == 4 * doubled(3) / 2 == 12.0
    assert all("doubled" not in code for code in fourfold.inspect_llvm().values())


def product(value: float, times: int) -> float:
    return value * times


def called_by_another() -> Any:
    """An inner kernel that a new caller has been given a constant and a variable for."""
    kernel = kernel_decorator([Path(__file__)])
    inner = kernel(inner=True)(product)

    @kernel
    def caller(value: float, times: int) -> float:
        return inner(value, 2) + inner(value, times)

    assert caller(3.0, 5) == 21.0
    return inner


def test_an_inner_kernel_is_compiled_once_for_constants_and_variables_and_kept_for_other_callers(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path))
    first, second = called_by_another(), called_by_another()
    assert len(first.signatures) == len(second.signatures) == 1
    assert not first.stats.cache_hits and second.stats.cache_hits


def test_garbage_is_collected_again_when_a_kernel_has_been_compiled_or_could_not_be(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path))
    kernel = kernel_decorator([Path(__file__)])(halved)
    with pytest.raises(TypingError):
        kernel("no number")
    assert gc.isenabled()
    assert kernel(3.0) == 1.5 and gc.isenabled()


def test_the_compiler_asks_what_a_sum_of_two_numbers_is_but_once(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """It went through all the rules for sums at each: a fifth of its time."""
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path))
    asked = []
    ask = BaseContext.resolve_function_type
    monkeypatch.setattr(BaseContext, "resolve_function_type", lambda *call: asked.append(call[1:3]) or ask(*call))

    @kernel_decorator([Path(__file__)])
    def total(one: float, other: float) -> float:
        return one + other + one + other + (other + one) * one + other

    assert total(1.0, 2.0) == 11.0
    assert len(asked) == len(set(asked)) <= 2, asked


FIRST_ARRAYS = """
import threading, types
import numpy
import ridlink.compiled
from numba import typeof

half_way, tried = threading.Event(), threading.Event()

class Slow(types.ModuleType):
    def __setattr__(self, name, value):
        if name == "ma":
            half_way.set()
            tried.wait()
        super().__setattr__(name, value)

def first():
    typeof(numpy.zeros(1))
    half_way.set()

numpy.__class__ = Slow
other = threading.Thread(target=first)
other.start()
half_way.wait()
try:
    typeof(numpy.zeros(1))
finally:
    tried.set()
    other.join()
"""


def test_two_threads_may_meet_their_first_array_at_once() -> None:
    """As daemons of one process do, which load their kernels in a thread each: numpy was loading a part of itself."""
    done = subprocess.run([sys.executable, "-c", FIRST_ARRAYS], capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stderr) == (0, "")


def test_without_a_place_to_keep_them_kernels_are_compiled_all_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    """As for a system user without a home, where the package belongs to root."""
    monkeypatch.setattr(config, "CACHE_DIR", "")
    monkeypatch.setattr(caching.CacheImpl, "_locator_classes", [])
    kernel = kernel_decorator([Path(__file__)])(halved)
    assert not is_compiled(kernel)
    with compiling_alone(kernel):  # with nobody to wait for
        assert kernel(3.0) == 1.5 and is_compiled(kernel)


def test_kernels_in_a_folder_that_cannot_be_written_are_used(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """As in a container whose disk is read-only: they were compiled when it was built."""
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path))
    kernel = kernel_decorator([Path(__file__)])
    assert can_be_kept() and kernel(halved)(3.0) == 1.5
    monkeypatch.setattr(caching._CacheLocator, "ensure_cache_path", lambda _: (tmp_path / "no" / "file").touch())
    again = kernel(halved)
    assert is_compiled(again) and again(3.0) == 1.5 and again.stats.cache_hits
    assert not can_be_kept()
    with compiling_alone(again), compiling_alone(again):  # with nobody to wait for
        pass


def test_whoever_waits_for_the_compiler_is_told_whether_that_is_for_once(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for places, often in ((caching.CacheImpl._locator_classes[:1], "once"), ([], "at every start, for it can be kept")):
        monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path))
        monkeypatch.setattr(caching.CacheImpl, "_locator_classes", places)
        announce(kernel_decorator([Path(__file__)])(halved))
        assert f"ridlink: compiling the decoder ({often}" in capsys.readouterr().err


def test_of_two_that_compile_into_one_folder_the_second_waits_for_the_first(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Daemons that start together would each compile the same: four took four times as long."""
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path))
    kernel = kernel_decorator([Path(__file__)])(halved)
    order: Queue[str] = Queue()

    def wait() -> None:
        with compiling_alone(kernel):
            order.put("second")

    with compiling_alone(kernel):
        second = threading.Thread(target=wait)
        second.start()
        with pytest.raises(Empty):
            order.get(timeout=0.3)
        order.put("first has compiled")
    second.join(10.0)
    assert [order.get_nowait(), order.get_nowait()] == ["first has compiled", "second"]
    # One that has been stopped is not waited for, and folders that know no locks are done without.
    monkeypatch.setattr("ridlink.compiled.MOST_WAITED_S", 0.0)
    with compiling_alone(kernel), compiling_alone(kernel):
        monkeypatch.setattr(fcntl, "flock", lambda *_: os.open(tmp_path / "missing", os.O_RDONLY))
        with compiling_alone(kernel), compiling_alone(halved):
            pass


def test_what_is_kept_is_loaded_without_a_compiler(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Readying one takes several times as long as loading all kernels of a decision."""
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path))
    assert kernel_decorator([Path(__file__)])(halved)(3.0) == 1.5
    kept = kernel_decorator([Path(__file__)])(halved)
    monkeypatch.setattr(kept.targetctx, "refresh", lambda: pytest.fail("the compiler is made ready"))
    assert kept(3.0) == 1.5
    assert kept.stats.cache_hits and not kept.stats.cache_misses


@pytest.mark.parametrize("kind", ["nbi", "nbc"])
@pytest.mark.parametrize("length", [0, 40])
def test_what_was_damaged_on_the_disk_is_compiled_again_and_kept(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, kind: str, length: int
) -> None:
    """As power that fails leaves it."""
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path))
    assert kernel_decorator([Path(__file__)])(halved)(3.0) == 1.5
    [damaged] = tmp_path.rglob(f"*.{kind}")
    os.truncate(damaged, length)
    again = kernel_decorator([Path(__file__)])(halved)
    assert is_compiled(again) is (kind == "nbc")  # nobody has looked into that one yet
    assert again(3.0) == 1.5 and again.stats.cache_misses
    kept = kernel_decorator([Path(__file__)])(halved)
    assert kept(3.0) == 1.5 and kept.stats.cache_hits


def test_on_a_full_disk_kernels_are_compiled_all_the_same(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path))
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100, limits[1]))
    try:
        result = kernel_decorator([Path(__file__)])(halved)(3.0)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert result == 1.5 and not [*tmp_path.rglob("*.nbc")]


def test_an_edit_in_any_source_of_a_package_makes_its_kernels_new(tmp_path: Path) -> None:
    source = tmp_path / "other.py"
    source.write_text("a")
    stamps = []
    for text in ("a", "b = 1"):
        source.write_text(text)
        stamps.append(kernel_decorator([source])(halved)._cache._cache_file._source_stamp)
    assert stamps[0] != stamps[1]


def test_a_kernel_that_another_machine_compiled_is_not_compiled_for_this_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """A container may be built on one processor and run on another."""
    kernel = kernel_decorator([Path(__file__)])(halved)
    here = kernel.targetctx.codegen().magic_tuple()
    for machine, ready in ((here, True), (("aarch64-unknown-linux-gnu", "cortex-a72", ""), False)):
        monkeypatch.setattr(kernel._cache._cache_file, "_load_index", lambda m=machine: {((), m, ()): "halved.1.nbc"})
        assert is_compiled(kernel) is ready


def test_an_inner_kernel_called_from_python_says_so() -> None:
    """It has no way in: the call would end the process."""
    inner = called_by_another()
    with pytest.raises(TypeError, match="product can be called by other kernels only"):
        inner(3.0, 5)
    assert inner.py_func(3.0, 5) == 15.0


def every_kernel() -> Iterator[Any]:
    package = Path(ridlink.__file__).parent
    for path in sorted(package.rglob("*.py")):
        if "@kernel" in path.read_text():
            module = importlib.import_module(".".join(path.relative_to(package.parent).with_suffix("").parts))
            for one in vars(module).values():
                if isinstance(getattr(one, "_cache", None), _KernelCache) and one.py_func.__module__ == module.__name__:
                    yield one


@cache
def imports(module: str) -> dict[str, tuple[str, str]]:
    """Names that a module imports from others of ours: where from, and under which name there."""
    tree = ast.parse(Path(importlib.import_module(module).__file__ or "").read_text())
    found = [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) and node.module]
    ours = [node for node in found if str(node.module).startswith("ridlink")]
    return {name.asname or name.name: (str(node.module), name.name) for node in ours for name in node.names}


def home_of(module: str, name: str) -> Path:
    """The file that defines a global name of a module."""
    while name in imports(module):
        module, name = imports(module)[name]
    return Path(importlib.import_module(module).__file__ or "")


def names_in(code: CodeType) -> Iterator[str]:
    yield from code.co_names
    for inner in code.co_consts:
        if isinstance(inner, CodeType):
            yield from names_in(inner)


def compiled_into(function: Any, seen: set[Any]) -> Iterator[tuple[str, Path]]:
    """What of our own becomes part of a kernel, and the files that say what it is: functions, constants, and theirs."""
    if function in seen:
        return
    seen.add(function)
    for name in names_in(function.__code__):
        value = function.__globals__.get(name)
        if isinstance(value, int | float | tuple) or callable(value):
            home = home_of(function.__module__, name)
            if "ridlink" in home.parts:
                yield f"{name} of {function.__module__}", home
        value = getattr(value, "py_func", value)
        if isinstance(value, FunctionType) and value.__module__.startswith("ridlink"):
            yield from compiled_into(value, seen)


def test_whatever_is_compiled_into_a_kernel_is_in_its_stamp() -> None:
    """Else an edit of it, or an update, would leave old code alive."""
    kernels = list(every_kernel())
    missing = {
        f"{what}, which is {home.name}, in {kernel.py_func.__name__}"
        for kernel in kernels
        for what, home in compiled_into(kernel.py_func, set())
        if home not in kernel._cache.sources
    }
    assert len(kernels) > 50 and not missing, sorted(missing)
