"""mavgen as a library: one XML in, one language binding out.

The build runs this file before ridlink exists as a package, so it imports nothing of ridlink. The dialect includes
``common.xml``; mavgen resolves includes beside the including file only, so the definitions are copied into a
temporary folder together with the ones that the pymavlink wheel ships.
"""

from __future__ import annotations

import contextlib
import io
import shutil
import tempfile
from importlib import resources
from pathlib import Path

LANGUAGES = {"python": "Python3", "c": "C", "lua": "WLua", "typescript": "TypeScript"}
"""Names of the bindings on our command line, and what mavgen calls them."""

DIALECT_XML = Path(__file__).with_name("ridlink.xml")
UPSTREAM_XML = ("common.xml", "standard.xml", "minimal.xml")


class GenerationError(Exception):
    """mavgen refused the definition; the message is what it printed."""


def copy_definitions(folder: Path, dialect_xml: Path = DIALECT_XML) -> Path:
    """Copy a dialect and the upstream definitions that it may include into one folder.

    Returns:
        Path of the copied dialect.
    """
    upstream = resources.files("pymavlink") / "dialects" / "v20"
    for name in UPSTREAM_XML:
        (folder / name).write_bytes((upstream / name).read_bytes())
    target = folder / dialect_xml.name
    shutil.copyfile(dialect_xml, target)
    return target


def generate(language: str, output: Path, dialect_xml: Path = DIALECT_XML) -> None:
    """Write one binding of a dialect.

    Args:
        language: A key of ``LANGUAGES``.
        output: A file for ``python`` and ``lua``, a folder for ``c`` and ``typescript``.
        dialect_xml: The definition.

    Raises:
        GenerationError: If the language is unknown or mavgen refuses the definition.
    """
    if language not in LANGUAGES:
        raise GenerationError(f"unknown language {language!r}; known: {', '.join(LANGUAGES)}")
    from pymavlink.generator import mavgen  # the generator costs 0.2 s and lxml: only those who generate pay

    printed = io.StringIO()
    with tempfile.TemporaryDirectory() as folder:
        definition = copy_definitions(Path(folder), dialect_xml)
        if language == "typescript":  # mavgen does not make the folders that it writes into
            for part in ("enums", "messages"):
                (output / part).mkdir(parents=True, exist_ok=True)
        options = mavgen.Opts(str(output), wire_protocol="2.0", language=LANGUAGES[language], validate=True)
        with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(printed):
            try:
                done = mavgen.mavgen(options, [str(definition)])
            except SystemExit:  # mavgen ends the process on a bad definition
                done = False
    if not done:
        raise GenerationError(printed.getvalue().strip() or f"mavgen refused {dialect_xml.name}")
