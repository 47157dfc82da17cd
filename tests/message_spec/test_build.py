"""The build: a wheel carries the generated dialect and the data of message_spec, an sdist the sources alone."""

from __future__ import annotations

import shutil
import subprocess
import sys
import tarfile
import zipfile
from pathlib import Path

import pytest

pytest.importorskip("hatchling", reason="the build backend is not installed")

ROOT = Path(__file__).parents[2]
DATA = {"message_spec/ridlink.xml", "message_spec/README.md", "message_spec/vectors/mavlink.jsonl"}


@pytest.fixture(scope="module")
def artifacts(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the wheel and the sdist of a clean copy of the sources."""
    copy = tmp_path_factory.mktemp("build") / "source"
    copy.mkdir()
    for name in ("pyproject.toml", "hatch_build.py", "README.md", "LICENSE", "NOTICE", ".gitignore"):
        shutil.copy(ROOT / name, copy)
    for name in ("ridlink", "sitl_sim", "message_spec"):
        shutil.copytree(
            ROOT / name, copy / name, ignore=shutil.ignore_patterns("__pycache__", "dialect.py", "*.nb[ci]")
        )
    shutil.copy(ROOT / "ridlink" / "cli" / "dialect.py", copy / "ridlink" / "cli")
    for kind in ("wheel", "sdist"):
        program = f"from hatchling.build import build_{kind}; build_{kind}('dist')"
        done = subprocess.run(
            [sys.executable, "-c", program], cwd=copy, capture_output=True, text=True, timeout=120, check=False
        )
        assert done.returncode == 0, done.stderr
    return copy / "dist"


def test_the_wheel_is_complete(artifacts: Path) -> None:
    (path,) = artifacts.glob("*.whl")
    with zipfile.ZipFile(path) as wheel:
        names = set(wheel.namelist())
        dialect = wheel.read("ridlink/mavlink/dialect.py")
    assert {"ridlink/mavlink/codec.py", "message_spec/generate.py"} | DATA <= names
    assert b"class MAVLink_ridlink_separation_message" in dialect
    assert not [name for name in names if name.startswith("tests/")]


def test_the_sdist_has_no_generated_code(artifacts: Path) -> None:
    (path,) = artifacts.glob("*.tar.gz")
    with tarfile.open(path) as sdist:
        names = {name.split("/", 1)[1] for name in sdist.getnames() if "/" in name}
    assert {"hatch_build.py", "message_spec/generate.py"} | DATA <= names
    assert "ridlink/mavlink/dialect.py" not in names
