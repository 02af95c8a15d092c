"""Every tutorial is followed from an empty folder, and every program of the pages of theory asserts what it derives."""

from __future__ import annotations

import re
import sys
import textwrap
from pathlib import Path

import pytest
from plants.reader import Reader

PAGES = Path(__file__).parents[2] / "scripts" / "docs" / "pages" / "tutorials"
TUTORIALS = sorted(page.stem for page in PAGES.glob("*.rst") if page.stem != "index")
BLOCK = re.compile(r"^\.\. code-block:: (\w+)\n\n((?:    .*\n|\n)+)", re.MULTILINE)


def blocks(tutorial: str) -> list[tuple[str, str]]:
    """Language and text of each block."""
    page = (PAGES / f"{tutorial}.rst").read_text(encoding="utf-8")
    return [(language, textwrap.dedent(text)) for language, text in BLOCK.findall(page)]


def test_every_tutorial_is_in_the_table_of_contents() -> None:
    """And has commands to follow."""
    contents = (PAGES / "index.rst").read_text(encoding="utf-8")
    assert re.findall(r"^   (\w+)$", contents, re.MULTILINE) != []
    assert sorted(re.findall(r"^   (\w+)$", contents, re.MULTILINE)) == TUTORIALS
    assert all("bash" in dict(blocks(tutorial)) for tutorial in TUTORIALS)


@pytest.mark.slow
@pytest.mark.parametrize("tutorial", TUTORIALS)
def test_a_tutorial_does_what_it_says(tutorial: str, tmp_path: Path) -> None:
    """A program runs after those before it, in which the data are made and the numbers are checked."""
    folder = tmp_path / "empty"
    folder.mkdir()
    reader, program = Reader(folder), ""
    for language, text in blocks(tutorial):
        if language == "bash":
            reader.run_shell(text)
        elif language == "python":
            program += text
            reader.run(sys.executable, "-c", program)
        else:
            assert language == "yaml", language  # a part of a study that the commands have written
    assert list(folder.glob("runs/*/report.html")) != []


PAGES_THEORY = Path(__file__).parents[2] / "scripts" / "docs" / "pages" / "theory"
DERIVED = ("mechanics", "linearisation", "responses", "fit", "intervals", "friction")
BLOCK_THEORY = re.compile(r"^\.\. code-block:: python\n\n((?:    .*\n|\n)+)", re.MULTILINE)


@pytest.mark.parametrize("name", DERIVED)
def test_equations_of_a_page_agree_with_the_code(name: str) -> None:
    """Each program by itself, as a reader would paste it; warnings are errors."""
    texts = BLOCK_THEORY.findall((PAGES_THEORY / f"{name}.rst").read_text(encoding="utf-8") + "\n")
    programs = [textwrap.dedent(text) for text in texts if "assert " in text]
    assert programs != []
    for program in programs:
        exec(compile(program, f"{name}.rst", "exec"), {"__name__": name})
