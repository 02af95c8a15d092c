"""The documentation: built without a warning, tutorials followed from an empty folder, programs of theory run."""

import doctest
import importlib.util
import json
import re
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest
from plants.paths import ROOT
from plants.reader import Reader

import elastid
from elastid.app.cli import cli
from elastid.study.reference import list_keys

PICTURES, PAGES = ROOT / "scripts" / "docs" / "pictures", ROOT / "scripts" / "docs" / "pages"
TUTORIALS = sorted(page.stem for page in PAGES.glob("tutorials/*.rst") if page.stem != "index")
BLOCK = re.compile(r"^\.\. code-block:: (\w+)\n\n((?:    .*\n|\n)+)", re.MULTILINE)


def blocks(name: str) -> list[tuple[str, str]]:
    """Language and text of each block of a page."""
    page = (PAGES / f"{name}.rst").read_text(encoding="utf-8") + "\n"
    return [(language, textwrap.dedent(text)) for language, text in BLOCK.findall(page)]


def test_every_tutorial_is_in_the_table_of_contents() -> None:
    contents = (PAGES / "tutorials" / "index.rst").read_text(encoding="utf-8")
    assert TUTORIALS
    assert sorted(re.findall(r"^   (\w+)$", contents, re.MULTILINE)) == TUTORIALS
    assert all("bash" in dict(blocks(f"tutorials/{tutorial}")) for tutorial in TUTORIALS)


@pytest.mark.slow
@pytest.mark.parametrize("tutorial", TUTORIALS)
def test_a_tutorial_does_what_it_says(tutorial: str, tmp_path: Path) -> None:
    """A program runs after those before it, in which the data are made and the numbers are checked."""
    folder = tmp_path / "empty"
    folder.mkdir()
    reader, program = Reader(folder), ""
    for language, text in blocks(f"tutorials/{tutorial}"):
        if language == "bash":
            reader.run_shell(text)
        elif language == "python":
            program += text
            reader.run(sys.executable, "-c", program)
        else:
            assert language == "yaml", language  # a part of a study that the commands have written
    assert list(folder.glob("runs/*/report.html")) != []


DERIVED = ("mechanics", "linearisation", "responses", "fit", "intervals", "friction")


@pytest.mark.parametrize("name", DERIVED)
def test_equations_of_a_page_agree_with_the_code(name: str) -> None:
    """Each program by itself, as a reader would paste it; warnings are errors."""
    programs = [text for language, text in blocks(f"theory/{name}") if language == "python" and "assert " in text]
    assert programs != []
    for program in programs:
        exec(compile(program, f"{name}.rst", "exec"), {"__name__": name})


HAS_SPHINX = all(importlib.util.find_spec(name) for name in ("sphinx", "sphinx_gallery", "pydata_sphinx_theme"))


@pytest.mark.slow
@pytest.mark.skipif(not HAS_SPHINX, reason="the group docs is not installed; `uv sync --group docs` brings Sphinx")
def test_the_documentation_is_built_without_a_warning(tmp_path: Path) -> None:
    """All pages but the figures of the gallery; each key, command and public name has a heading of its own."""
    command = [sys.executable, str(ROOT / "scripts" / "docs" / "build.py"), "--quick", "--to", str(tmp_path / "html")]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-3000:]
    numbers = json.loads(done.stdout.splitlines()[-1])
    assert numbers["pages"] > 40
    assert numbers["links"] > 1000
    reference = tmp_path / "html" / "reference"
    of_keys = "".join(page.read_text(encoding="utf-8") for page in (reference / "keys").glob("*.html"))
    of_keys = of_keys.replace("<h1>", "<h2>")  # a section has a page
    assert [
        key.path for key in list_keys() if f"<h2>{key.path.replace('<', '&lt;').replace('>', '&gt;')}<" not in of_keys
    ] == []
    commands = (reference / "commands.html").read_text(encoding="utf-8")
    assert [
        name for name, each in cli.commands.items() if not each.hidden and f"<h2>elastid {name}<" not in commands
    ] == []
    of_names = {page.stem: page.read_text(encoding="utf-8") for page in (reference / "names").glob("*.html")}
    assert [name for name in elastid.__all__ if f"<h1>{name}<" not in of_names[name]] == []
    files = (reference / "files.html").read_text(encoding="utf-8")
    assert all(name in files for name in ("plan.h5", "records.h5", "frf.h5", "fit.h5", "summary.json", "robot.yml"))


def test_pictures_are_small_and_shown() -> None:
    """Below 120 KB each; every one is on the README or on a page."""
    texts = (ROOT / "README.md").read_text(encoding="utf-8") + "".join(
        page.read_text(encoding="utf-8") for page in PAGES.rglob("*.rst")
    )
    for picture in PICTURES.iterdir():
        assert picture.stat().st_size < 120_000, picture.name
        assert f"pictures/{picture.name}" in texts, picture.name


def test_pages_name_modules_that_exist() -> None:
    """A page that says where an equation lives names a room of the code."""
    for page in PAGES.rglob("*.rst"):
        for name in re.findall(r"``(elastid(?:\.\w+)+)``", page.read_text(encoding="utf-8")):
            assert importlib.util.find_spec(name) is not None, f"{page.name}: {name}"


def test_every_public_name_has_an_example() -> None:
    text = (PAGES / "howto" / "python.rst").read_text(encoding="utf-8")
    assert [name for name in elastid.__all__ if not re.search(rf"\*\*[^*]*\b{name}\b", text)] == []


@pytest.mark.slow
def test_the_examples_of_public_names_run() -> None:
    assert doctest.testfile(str(PAGES / "howto" / "python.rst"), module_relative=False, encoding="utf-8").failed == 0
