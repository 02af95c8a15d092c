"""The documentation is built without a warning and without a link that leads nowhere, and has what it promises."""

import doctest
import importlib.util
import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

import elastid
from elastid.app.cli import cli
from elastid.study.reference import list_keys

ROOT = Path(__file__).parents[2]
PICTURES = ROOT / "scripts" / "docs" / "pictures"
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
    commands, names = ((reference / f"{page}.html").read_text(encoding="utf-8") for page in ("commands", "names"))
    assert [
        name for name, each in cli.commands.items() if not each.hidden and f"<h2>elastid {name}<" not in commands
    ] == []
    assert [name for name in elastid.__all__ if f"<h2>{name}<" not in names] == []
    files = (reference / "files.html").read_text(encoding="utf-8")
    assert all(name in files for name in ("plan.h5", "records.h5", "frf.h5", "fit.h5", "summary.json", "robot.yml"))


def test_pictures_are_small_and_shown() -> None:
    """Below 120 KB each; every one is on the README or on a page."""
    texts = (ROOT / "README.md").read_text(encoding="utf-8") + "".join(
        page.read_text(encoding="utf-8") for page in (PICTURES.parent / "pages").rglob("*.rst")
    )
    for picture in PICTURES.iterdir():
        assert picture.stat().st_size < 120_000, picture.name
        assert f"pictures/{picture.name}" in texts, picture.name


def test_pages_name_modules_that_exist() -> None:
    """A page that says where an equation lives names a room of the code."""
    for page in (PICTURES.parent / "pages").rglob("*.rst"):
        for name in re.findall(r"``(elastid(?:\.\w+)+)``", page.read_text(encoding="utf-8")):
            assert importlib.util.find_spec(name) is not None, f"{page.name}: {name}"


def test_every_example_of_the_gallery_has_a_figure() -> None:
    """One among its variables, which the gallery draws, or a picture that stands for it."""
    for example in (ROOT / "scripts" / "examples").glob("ex[0-9]*.py"):
        text = example.read_text(encoding="utf-8")
        assert re.search(r"^    figure = |figure := Figure|sphinx_gallery_thumbnail_path", text, re.M), example.name


def test_every_public_name_has_an_example_that_runs() -> None:
    page = PICTURES.parent / "pages" / "howto" / "python.rst"
    text = page.read_text(encoding="utf-8")
    assert [name for name in elastid.__all__ if not re.search(rf"\*\*[^*]*\b{name}\b", text)] == []
    assert doctest.testfile(str(page), module_relative=False, encoding="utf-8").failed == 0
