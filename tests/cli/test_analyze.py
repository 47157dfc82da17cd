"""``ridlink analyze``: the table, the JSON, the figures, and what happens without matplotlib."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from ridlink.cli import cli
from tests.full_disk import largest_file

WITHOUT = """
import sys
sys.modules.update(dict.fromkeys(({blocked}), None))
sys.argv = ["ridlink", "analyze", *{arguments}]
from ridlink.cli import main
main()
"""


def invoke(*arguments: str | Path) -> Result:
    return CliRunner().invoke(cli, ["analyze", *map(str, arguments)])


@pytest.fixture(scope="module")
def drawn(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Result]:
    """A folder of figures, and what the command said: they take seconds to draw."""
    pytest.importorskip("matplotlib", reason="figures need the extra 'plot'")
    folder = tmp_path_factory.mktemp("drawn") / "figures"
    return folder, invoke("--out", folder, "--json")


def without(*blocked: str, arguments: tuple[str, ...] = ()) -> subprocess.CompletedProcess[str]:
    """The command in a process where some modules cannot be imported."""
    code = WITHOUT.format(blocked="".join(f"{name!r}, " for name in blocked), arguments=list(arguments))
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False)


def test_the_table_has_both_numbers_a_verdict_and_a_reason() -> None:
    result = invoke()
    assert result.exit_code == 0, result.output
    lines = result.stdout.splitlines()
    (at,) = (k for k, line in enumerate(lines) if "mean error of a pair, sigma 4.85" in line)
    assert lines[at].split()[-5:] == ["7.4", "m", "7.739", "m", "differs"]
    assert "4.62 m" in lines[at + 1]
    (beacon,) = (line for line in lines if "Wi-Fi beacon" in line)
    assert beacon.endswith("several m      2.8 to 9.0 m  equal")
    assert ["0.999", "43.7", "52.6", "78.0", "60.0"] in [line.split() for line in lines]
    assert max(map(len, lines)) <= 140


def test_a_full_disk_gets_no_figure(drawn: tuple[Path, Result], tmp_path: Path) -> None:
    sizes = [Path(file).stat().st_size for file in json.loads(drawn[1].stdout)["files"]]
    assert sizes[0] < max(sizes) - 1  # one before it would fit
    with largest_file(max(sizes) - 1):
        result = invoke("--out", tmp_path / "new" / "folder")
    assert isinstance(result.exception, OSError) and not [*tmp_path.iterdir()]


def test_json_is_one_object() -> None:
    result = invoke("--json")
    assert result.exit_code == 0
    (line,) = result.stdout.splitlines()
    document = json.loads(line)
    assert {row["verdict"] for row in document["comparisons"]} == {"equal", "close", "differs", "not printed"}
    assert [row["eta"] for row in document["excess_distance_m"]] == [0.95, 0.99, 0.999]
    assert document["files"] == []


def test_out_draws_and_names_the_files(drawn: tuple[Path, Result]) -> None:
    folder, result = drawn
    assert result.exit_code == 0, result.output
    files = json.loads(result.stdout)["files"]
    assert sorted(files) == sorted(map(str, folder.iterdir()))
    assert {Path(file).suffix for file in files} == {".png", ".svg"}
    device = subprocess.run(
        [sys.executable, "-m", "ridlink", "analyze", "--out", "/dev/null"], capture_output=True, text=True, check=False
    )
    assert (device.returncode, device.stderr) == (3, "ridlink: /dev/null: Not a directory\n")


def test_the_table_needs_no_matplotlib_and_the_figures_say_how_to_get_it(tmp_path: Path) -> None:
    assert without("matplotlib").returncode == 0
    missing = without("matplotlib", arguments=("--out", str(tmp_path / "figures")))
    assert missing.returncode == 2
    assert missing.stderr == "ridlink: drawing figures needs the extra 'plot': pip install 'ridlink[plot]'\n"
    assert missing.stdout == "" and not (tmp_path / "figures").exists()


def test_help_needs_neither_numpy_nor_matplotlib() -> None:
    done = without("numpy", "matplotlib", "numba", arguments=("--help",))
    assert done.returncode == 0, done.stderr
    assert "--out" in done.stdout
