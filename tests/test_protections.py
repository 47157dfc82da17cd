"""The table of protections is true: what it takes out is there, and the tests that it names are there and name it.

`python -m tests.soak.proof` takes them out one by one and sees the tests fail, which takes a quarter of an hour.
"""

from __future__ import annotations

import ast
import re
import tomllib
from functools import cache
from pathlib import Path

import pytest

from tests.soak.protections import FAULTS, NO_SOCKET, Protection, protections

ROOT = Path(__file__).resolve().parents[1]
TABLE = protections()


@cache
def functions(path: Path) -> set[str]:
    return {node.name for node in ast.parse(path.read_text()).body if isinstance(node, ast.FunctionDef)}


@cache
def documented() -> dict[str, str]:
    """Rows of docs/faults.md by fault."""
    text = (ROOT / "docs" / "faults.md").read_text()
    return dict(re.findall(r"^\| ([FI]\d+) \| (.+) \|$", text, re.M))


@pytest.mark.parametrize("row", TABLE, ids=[f"{row.fault}-{row.gone}" for row in TABLE])
def test_a_protection_stands_where_the_table_says_and_its_test_names_the_fault(row: Protection) -> None:
    for file, without in row.taken_out(ROOT).items():
        ast.parse(without)
        assert without != (ROOT / file).read_text()
    name, _, function = row.test.partition("::")
    assert function in functions(ROOT / name)
    assert f"_{row.mark}_" in function
    assert name.removeprefix("tests/") in documented()[row.fault], "docs/faults.md names the file of the test"


def test_what_is_said_of_surviving_mutants_is_about_lines_that_are_there() -> None:
    with (ROOT / "tests" / "soak" / "survivors.toml").open("rb") as file:
        rows = tomllib.load(file)["survivor"]
    for row in rows:
        lines = [line.strip() for line in (ROOT / row["file"]).read_text().splitlines()]
        assert row["at"] in lines, row
        assert row["why"] and " -> " in row["change"]


def test_every_fault_has_a_protection() -> None:
    assert {row.fault for row in TABLE} >= set(FAULTS)
    assert set(NO_SOCKET) <= set(FAULTS)
    assert set(documented()) >= set(FAULTS)
