"""mavgen as a library: one XML in, one language binding out.

The build runs this file before the package ridlink exists, so it imports nothing of ridlink. The dialect includes
``common.xml``; mavgen resolves includes beside the including file only, so the definitions are copied into a temporary
folder together with the ones that the pymavlink wheel ships.

mavgen evaluates enum values as Python, so it is only used for our own XML. ``check`` reads any other XML.
"""

from __future__ import annotations

import contextlib
import io
import os
import tempfile
from importlib import resources
from pathlib import Path

LANGUAGES = {"python": "Python3", "c": "C", "lua": "WLua", "typescript": "TypeScript"}
"""Names of the bindings on our command line, with mavgen's names for them."""

SUFFIXES = {"python": ".py", "lua": ".lua"}
"""Bindings that are one file; the others are folders."""

DIALECT_XML = Path(__file__).with_name("ridlink.xml")
UPSTREAM_XML = ("common.xml", "standard.xml", "minimal.xml")


class GenerationError(Exception):
    """The language is unknown, or mavgen refused the definition, whose output is then the message."""


def definition_files(dialect_xml: Path = DIALECT_XML) -> dict[str, bytes]:
    """Contents of a dialect and of the upstream definitions it includes, by file name, for one folder."""
    upstream = resources.files("pymavlink") / "dialects" / "v20"
    files = {name: (upstream / name).read_bytes() for name in UPSTREAM_XML}
    return files | {dialect_xml.name: dialect_xml.read_bytes()}


def render(language: str, stem: str = "ridlink", dialect_xml: Path = DIALECT_XML) -> dict[str, bytes]:
    """One binding of a dialect in memory: contents by path relative to its folder.

    Args:
        language: A key of ``LANGUAGES``.
        stem: Name of the file without its suffix, for bindings that are one file.
        dialect_xml: The definition.

    Raises:
        GenerationError: If the language is unknown or mavgen refuses the definition.
    """
    if language not in LANGUAGES:
        raise GenerationError(f"unknown language {language!r}; known: {', '.join(LANGUAGES)}")
    from pymavlink.generator import mavgen  # takes 0.2 s and needs lxml, so it is only imported here

    printed = io.StringIO()
    with tempfile.TemporaryDirectory() as folder:
        for name, content in definition_files(dialect_xml).items():
            (Path(folder) / name).write_bytes(content)
        output = Path(folder) / "output"
        for part in ("enums", "messages") if language == "typescript" else ("",):  # mavgen expects these folders
            (output / part).mkdir(parents=True)
        target = output / f"{stem}{SUFFIXES[language]}" if language in SUFFIXES else output
        options = mavgen.Opts(str(target), wire_protocol="2.0", language=LANGUAGES[language], validate=True)
        with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(printed):
            try:
                done = mavgen.mavgen(options, [str(Path(folder) / dialect_xml.name)])
            except (SystemExit, Exception) as error:  # mavgen ends the process on a bad definition
                print(error)
                done = False
        if not done:
            raise GenerationError(printed.getvalue().strip() or f"mavgen refused {dialect_xml.name}")
        written = [path for path in sorted(output.rglob("*")) if path.is_file()]
        return {path.relative_to(output).as_posix(): path.read_bytes() for path in written}


def write_file(path: Path, content: bytes) -> None:
    """Write a file whole or not at all; a device or pipe is written directly.

    Raises:
        OSError: If the path cannot be written; ``filename`` is the path given.
    """
    target = path.resolve()
    unfinished = ""
    try:
        if target.exists() and not target.is_file() and not target.is_dir():
            target.write_bytes(content)
            return
        descriptor, unfinished = tempfile.mkstemp(prefix=f".{target.name}.", dir=target.parent)
        with os.fdopen(descriptor, "wb") as stream:
            stream.write(content)
            os.fchmod(stream.fileno(), target.stat().st_mode & 0o777 if target.exists() else 0o666 & ~_umask())
        os.replace(unfinished, target)
    except OSError as error:
        if unfinished:
            Path(unfinished).unlink(missing_ok=True)
        raise OSError(error.errno, error.strerror, str(path)) from error


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def generate(language: str, output: Path, dialect_xml: Path = DIALECT_XML) -> None:
    """Write a binding of a dialect that is one file.

    Args:
        language: ``python`` or ``lua``.
        output: The file.
        dialect_xml: The definition.

    Raises:
        GenerationError: If the language is another one, or mavgen refuses the definition.
        OSError: If the output cannot be written.
    """
    if language not in SUFFIXES:
        raise GenerationError(f"no language of one file: {language!r}; known: {', '.join(SUFFIXES)}")
    (content,) = render(language, output.stem, dialect_xml).values()
    write_file(output, content)
