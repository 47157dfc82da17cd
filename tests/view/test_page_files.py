"""The files of the page: valid, small, asking nobody else for anything, and putting no text into the page as HTML."""

from __future__ import annotations

import hashlib
import re
import shutil
import subprocess
from html.parser import HTMLParser
from pathlib import Path

import pytest

from ridlink.view.book import MOST_ENCOUNTERS

STATIC = Path(__file__).resolve().parents[2] / "ridlink" / "view" / "static"
SCRIPTS = sorted(STATIC.glob("*.js"))
STYLES = sorted(STATIC.glob("*.css"))

VENDORED = {
    "leaflet.js": "2d98625bad9de241c7e78b06eb1d5f917c2f57ec6c84c3092a00438a01dab758",
    "leaflet.css": "50d32b5c9d2a71b901650298b9a4252f69e5d08730e61f9859e259fc1720598c",
    "uplot.js": "5dd9b3281aa64b461b42d9945f6adb2649d346502b12281a9ae0d46599a80eba",
    "uplot.css": "df630c6a8d6f8eeaff264b50f73ce5b114f646ffd9a0bb74f049b0a00135fa04",
}
"""SHA-256 of Leaflet 1.9.4 and uPlot 1.6.32 as npm has them, without source maps and without images."""


class Elements(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, str | None]]] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, dict(attrs)))


def elements() -> list[tuple[str, dict[str, str | None]]]:
    parser = Elements()
    parser.feed((STATIC / "index.html").read_text())
    return parser.found


def node_or_skip(least: tuple[int, int]) -> str:
    node = shutil.which("node")
    if node is None:
        pytest.skip("needs node: apt-get install nodejs")
    version = subprocess.run([node, "--version"], capture_output=True, text=True, check=True).stdout.strip()
    major, minor = map(int, version.lstrip("v").split(".")[:2])
    if (major, minor) < least:
        pytest.skip(f"needs node {least[0]}.{least[1]}, this is {version}")
    return node


def test_what_the_modules_compute() -> None:
    """History, clock, loader, interpolation, addresses and names, by ``page.test.mjs`` in node's own test runner."""
    node = node_or_skip((20, 19))  # from here on it takes .js files for modules if they are some
    done = subprocess.run(
        [node, "--test", str(Path(__file__).with_name("page.test.mjs"))], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stdout


def test_scripts_are_valid_modules() -> None:
    node = node_or_skip((18, 0))
    # One process: a module that only names the others would fetch them, so each is compiled from its text.
    program = (
        "import fs from 'node:fs'; import vm from 'node:vm';"
        "for (const file of process.argv.slice(1)) new vm.SourceTextModule(fs.readFileSync(file, 'utf8'), "
        "{ identifier: file });"
    )
    command = [node, "--no-warnings", "--experimental-vm-modules", "--input-type=module", "-e", program, "--"]
    done = subprocess.run([*command, *map(str, SCRIPTS)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_what_modules_import_is_there_and_exported() -> None:
    exported = {
        path.name: set(re.findall(r"^export (?:default )?(?:class|function|const) ([\w$]+)", path.read_text(), re.M))
        | set(re.findall(r"([A-Z_]+) = \d+[,;]", path.read_text()))
        for path in SCRIPTS
    }
    for path in SCRIPTS:
        for names, module in re.findall(r"^import (?:\{([^}]*)\} )?.*?from \"\./([\w./]+)\";", path.read_text(), re.M):
            assert (STATIC / module).is_file(), f"{path.name} imports {module}"
            if names:
                wanted = {name.strip() for name in names.split(",") if name.strip()}
                assert wanted <= exported[module], f"{path.name} imports {wanted - exported[module]} from {module}"


@pytest.mark.parametrize("path", [*SCRIPTS, *STYLES], ids=lambda path: path.name)
def test_a_file_tells_one_story(path: Path) -> None:
    assert len(path.read_text().splitlines()) <= 300


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.name)
def test_text_never_becomes_html_or_code(path: Path) -> None:
    text = path.read_text()
    for word in (
        "innerHTML",
        "outerHTML",
        "insertAdjacentHTML",
        "document.write",
        "eval(",
        "new Function",
        "DOMParser",
    ):
        assert word not in text, f"{path.name} uses {word}"


def test_nothing_is_asked_of_another_host() -> None:
    for path in [*SCRIPTS, *STYLES, *STATIC.glob("vendor/*.css")]:
        text = re.sub(r"/\*.*?\*/", "", path.read_text(), flags=re.S)
        assert not re.findall(r"url\(|@import|https?://|sourceMappingURL", text), path.name
    for tag, attributes in elements():
        for name in ("href", "src"):
            address = attributes.get(name)
            assert address is None or (STATIC.parent / address).is_file(), f"<{tag} {name}={address}>"


def test_the_policy_allows_all_of_the_page() -> None:
    """Under ``default-src 'self'`` neither style attributes nor handlers nor scripts in the page work."""
    for tag, attributes in elements():
        assert "style" not in attributes and tag != "style", tag
        assert not [name for name in attributes if name.startswith("on")], tag
        assert tag != "script" or attributes.get("src"), "script in the page"


def test_buttons_and_fields_have_names() -> None:
    labelled = False
    for tag, attributes in elements():
        labelled = labelled or tag == "label"
        if tag == "button" and "icon" in (attributes.get("class") or ""):
            assert attributes.get("aria-label"), attributes
        if tag == "input":
            assert attributes.get("aria-label"), attributes
    assert labelled


def test_the_page_knows_how_many_encounters_it_is_told_at_most() -> None:
    assert f"MOST_TOLD = {MOST_ENCOUNTERS};" in (STATIC / "encounters.js").read_text()
    assert f"newest {MOST_ENCOUNTERS}." in (STATIC / "index.html").read_text()


def test_what_runs_on_is_not_read_out() -> None:
    """An ``output`` is a live region unless it says otherwise: and the clock would be read out all the time."""
    outputs = [attributes for tag, attributes in elements() if tag == "output"]
    assert outputs and all(attributes.get("aria-live") == "off" for attributes in outputs), outputs


@pytest.mark.parametrize("name", sorted(VENDORED))
def test_vendored_libraries_are_those_that_notice_names(name: str) -> None:
    assert hashlib.sha256((STATIC / "vendor" / name).read_bytes()).hexdigest() == VENDORED[name]
    library = name.split(".")[0]
    assert (STATIC / "vendor" / f"{library}.LICENSE.txt").is_file()
    assert f"vendor/{library}.LICENSE.txt" in (STATIC.parents[2] / "NOTICE").read_text()


def luminance(colour: str) -> float:
    channels = [int(colour[at : at + 2], 16) / 255 for at in (1, 3, 5)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(one: str, other: str) -> float:
    lighter, darker = sorted((luminance(one), luminance(other)), reverse=True)
    return (lighter + 0.05) / (darker + 0.05)


@pytest.mark.parametrize("theme", [0, 1], ids=["light", "dark"])
def test_text_can_be_read(theme: int) -> None:
    """4.5 to 1 for text and 3 to 1 for what is drawn, as WCAG 2.1 has it at level AA."""
    found = re.findall(r"--([\w-]+): light-dark\((#\w{6}), (#\w{6})\);", (STATIC / "base.css").read_text())
    colours = {name: pair[theme] for name, *pair in found}
    for text in ("text", "muted", "accent", "good", "warn", "alarm"):
        for ground in ("panel", "raised", "ground"):
            assert contrast(colours[text], colours[ground]) >= 4.5, (text, ground)
    assert contrast(colours["on-accent"], colours["accent"]) >= 4.5
    assert contrast(colours["grid-text"], colours["ground"]) >= 4.5
    for drawn in ("vehicle", "stranger", "stale", "truth", "trail", "velocity", "goal", "clear", "near", "inside"):
        assert contrast(colours[drawn], colours["ground"]) >= 3.0, drawn
