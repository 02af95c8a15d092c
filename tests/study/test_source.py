"""YAML text as plain data with the place of every key; whatever is no plain data is refused with its place."""

import pytest

from elastid.base.errors import StudyError
from elastid.study.source import parse


def test_every_key_and_value_has_its_place() -> None:
    """Line and column from 1; a key that is not given has the place of the nearest above it."""
    source = parse("name: a\nfit:\n  starts: [1, 2.5]\n", "s.yml")
    assert source.data == {"name": "a", "fit": {"starts": [1, 2.5]}}
    assert str(source.place(("fit", "starts"))) == "s.yml:3:3"
    assert str(source.place(("fit", "starts", 1))) == "s.yml:3:15"
    assert str(source.place(("fit", "bounds"))) == "s.yml:2:1"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: 1\na: 2\n", r"s\.yml:2:1: key 'a' is given twice \(first in line 1\)"),
        ("a: !!python/none x\n", r"s\.yml:1:4: the tag .* is refused"),
        ("a: 99999999999999999999\n", "out of the range of numbers"),
        ("? [1]\n: 2\n", "a key must be a name"),
        ("a: [1\n", "broken YAML"),
    ],
)
def test_a_text_that_is_no_plain_data_is_refused(text: str, message: str) -> None:
    """With file, line and column."""
    with pytest.raises(StudyError, match=message):
        parse(text, "s.yml")
