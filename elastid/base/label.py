"""Labels of the fields of a value: meaning, unit and axes, with which it is written for other programs to read."""

from __future__ import annotations

from dataclasses import Field, dataclass, field
from typing import Any


@dataclass(frozen=True)
class Label:
    """Meaning of a field and where its numbers stand.

    unit: SI, `{name}` in it being an attribute of the value or of one that contains it; by default that of the ending
    of the field's name (`_hz`, `_s`).  axes: one name a dimension, of a field or property that holds the values along
    it, or of an index.  rows: a tuple or mapping of values with arrays is a table, whose columns are stacked.
    entry: attribute that names each value of a tuple.
    """

    text: str = ""
    unit: str = ""
    axes: tuple[str, ...] = ()
    rows: bool = False
    entry: str = ""


_KEY = "label"
NO_LABEL = Label()
_UNIT_OF_ENDING = {"hz": "Hz", "s": "s", "deg": "deg", "degc": "degC", "db": "dB"}


def labelled(
    text: str = "", unit: str = "", axes: str = "", rows: bool = False, entry: str = "", **default: Any
) -> Any:
    """A dataclass field with a label: `x: FloatArray = labelled("angle", "rad", "time_s inputs")`.

    axes: names with a space between them.  default: as of `dataclasses.field`.
    """
    return field(metadata={_KEY: Label(text, unit, tuple(axes.split()), rows, entry)}, **default)


def label_of(field: Field[Any]) -> Label:
    """The label of a field, an empty one where it has none."""
    label: Label = field.metadata.get(_KEY, NO_LABEL)
    return label


def unit_of_name(name: str) -> str:
    """The unit that the ending of a name states.

    >>> unit_of_name("rate_hz"), unit_of_name("message")
    ('Hz', '')
    """
    return _UNIT_OF_ENDING.get(name.rpartition("_")[2], "") if "_" in name else ""
