"""YAML text as plain data with the place of every key."""

from elastid.study.source import parse


def test_every_key_and_value_has_its_place() -> None:
    """Line and column from 1; a key that is not given has the place of the nearest above it."""
    source = parse("name: a\nfit:\n  starts: [1, 2.5]\n", "s.yml")
    assert source.data == {"name": "a", "fit": {"starts": [1, 2.5]}}
    assert str(source.place(("fit", "starts"))) == "s.yml:3:3"
    assert str(source.place(("fit", "starts", 1))) == "s.yml:3:15"
    assert str(source.place(("fit", "bounds"))) == "s.yml:2:1"
