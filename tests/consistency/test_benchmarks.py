"""Ratios that the benchmarks' texts quote are those of the last full run, which is kept beside them."""

import ast
import json
import re
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).parents[2] / "scripts" / "benchmarks"
LAST_RUN = json.loads((BENCHMARKS / "last_run.json").read_text(encoding="utf-8"))
# A number and the key of the line of JSON that it is from, as in: 2.5 (evaluation_over_solve).
QUOTE = re.compile(r"(\d+(?:\.\d+)?) \((\w+)\)")


def measured_paragraph(script: str) -> str:
    """What a script's docstring says about its last run."""
    text = ast.get_docstring(ast.parse((BENCHMARKS / script).read_text(encoding="utf-8"))) or ""
    return next(paragraph for paragraph in text.split("\n\n") if paragraph.startswith("Measured"))


@pytest.mark.parametrize("script", sorted(LAST_RUN))
def test_every_quoted_ratio_is_that_of_the_last_run(script: str) -> None:
    """Each number names its key, and has its value in as many digits as are quoted."""
    paragraph = measured_paragraph(script).replace("\n", " ")
    quotes = QUOTE.findall(paragraph)
    assert quotes
    for number, key in quotes:
        digits = len(number.partition(".")[2])
        assert float(number) == round(LAST_RUN[script][key], digits), key
    assert not re.search(r"\d", QUOTE.sub("", paragraph)), "a number without a source"
