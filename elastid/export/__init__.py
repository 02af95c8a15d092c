"""The fitted model for other tools, one target a file."""

from importlib.resources import files
from string import Template
from typing import Any


def filled(template: str, /, **values: Any) -> str:
    """The text of a file of `templates` with its $names filled in."""
    return Template((files("elastid.export") / "templates" / template).read_text("utf-8")).substitute(values)
