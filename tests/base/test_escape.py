"""No text, hostile or not a name at all, leaves the place in its target that it was written into."""

import csv
import io
import json
import re
from pathlib import Path
from xml.etree import ElementTree as ET

import pytest
from plants.hostile_names import HOSTILE, REFUSED
from ruamel.yaml import YAML

from elastid.base import escape
from elastid.base.display import Display

TEXTS = (*HOSTILE, *REFUSED)
CONTROLS = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u200b\u2028\u2029\u202a-\u202e\u2066-\u2069\ufeff]")


@pytest.mark.parametrize("text", TEXTS)
def test_a_text_stays_in_its_place(text: str) -> None:
    assert not CONTROLS.search(escape.printable(text))
    assert escape.one_line(text).isprintable()
    comment = escape.c_comment([text, f"{text}*", text])
    assert comment.count("*/") == comment.count("/*") == 1
    assert YAML(typ="safe").load(escape.comment_lines(text) + "a: 1\n") == {"a": 1}
    assert ET.fromstring(f"<r><!-- {escape.xml_comment(text)} --><a/></r>").find("a") is not None
    assert json.loads(escape.embedded_json({text: text})) == {text: text}
    assert "<" not in escape.embedded_json([text])
    exec(f'def f():\n    """{escape.docstring(text)}"""\n', {})
    assert len(list(csv.reader(io.StringIO(f"{escape.csv_cell(text)!s}".replace(",", ""))))) <= 1
    assert not str(escape.csv_cell(text)).startswith(("=", "+", "-", "@"))
    assert re.fullmatch(r"[ -~]{1,80}", escape.uff_text(text))
    assert escape.uff_text(text).strip() != "-1"
    assert Path(escape.file_name(f"{text}x")).name == escape.file_name(f"{text}x")


def test_identifiers_differ() -> None:
    identifiers = escape.c_identifiers(TEXTS).values()
    assert len({name.lower() for name in identifiers}) == len(identifiers)
    assert [escape.group_name(name) for name in (".", "..", "a.b/c")] == ["%2E", "%2E%2E", "a.b%2Fc"]
    assert all(re.fullmatch(r"joint(_[a-zA-Z0-9]+)*", each) for each in identifiers)


@pytest.mark.parametrize("text", TEXTS)
def test_prompt_and_notebook_show_same_text(text: str) -> None:
    display = Display(f"Robot {text}", ("name",), [(text,)])
    assert not CONTROLS.search(display.text)
    assert not CONTROLS.search(display.html)
    assert "<script" not in display.html
    assert len(display.text.splitlines()) == len(f"Robot {escape.printable(text)}".split("\n")) + 2 - (not text)
