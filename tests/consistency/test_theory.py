"""The pages of theory are evaluated: every program that asserts what its page derives."""

from __future__ import annotations

import re
import textwrap
from pathlib import Path

import pytest

PAGES = Path(__file__).parents[2] / "scripts" / "docs" / "pages" / "theory"
DERIVED = ("mechanics", "linearisation", "responses", "fit", "intervals", "friction")
BLOCK = re.compile(r"^\.\. code-block:: python\n\n((?:    .*\n|\n)+)", re.MULTILINE)


@pytest.mark.parametrize("name", DERIVED)
def test_equations_of_a_page_agree_with_the_code(name: str) -> None:
    """Each program by itself, as a reader would paste it; warnings are errors."""
    texts = BLOCK.findall((PAGES / f"{name}.rst").read_text(encoding="utf-8") + "\n")
    programs = [textwrap.dedent(text) for text in texts if "assert " in text]
    assert programs != []
    for program in programs:
        exec(compile(program, f"{name}.rst", "exec"), {"__name__": name})
