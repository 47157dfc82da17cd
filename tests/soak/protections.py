"""The table of `protections.toml`: what is taken out of which file, and which test must fail then."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass, field
from pathlib import Path

TABLE = Path(__file__).with_name("protections.toml")

FAULTS = tuple(f"F{number}" for number in range(1, 35))
NO_SOCKET = {
    "F26": "the loop itself",
    "F28": "a signal",
    "F29": "the disk",
    "F33": "a file",
    "F34": "a file",
}
"""Faults that arrive by no socket, and by what they do; every other one needs a test that speaks over one."""


@dataclass(frozen=True)
class Protection:
    """One protection.

    Args:
        fault: Fault or invariant that it is against.
        gone: What is true without it.
        file: Where it stands.
        old: Its text there, which occurs once.
        new: What stands there without it.
        test: Node id of the test that names the fault, without parameters.
        also: More that belongs to it: `old`, `new` and, where it is another one, `file`.
    """

    fault: str
    gone: str
    file: str
    old: str
    new: str
    test: str
    also: list[dict[str, str]] = field(default_factory=list)

    def taken_out(self, root: Path) -> dict[str, str]:
        """The texts of the files without the protection.

        Raises:
            ValueError: If a part of it does not stand there exactly once.
        """
        texts: dict[str, str] = {}
        for part in ({"old": self.old, "new": self.new}, *self.also):
            name = part.get("file", self.file)
            text = texts.get(name) or (root / name).read_text()
            if (count := text.count(part["old"])) != 1:
                raise ValueError(f"{self.fault} ({self.gone}): stands {count} times in {name}: {part['old']!r}")
            texts[name] = text.replace(part["old"], part["new"])
        return texts

    @property
    def mark(self) -> str:
        """How a test names the fault: f01."""
        return f"{self.fault[0].lower()}{int(self.fault[1:]):0{2 if self.fault[0] == 'F' else 1}d}"


def protections() -> list[Protection]:
    """The whole table."""
    with TABLE.open("rb") as file:
        return [Protection(**row) for row in tomllib.load(file)["protection"]]
