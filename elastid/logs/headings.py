"""Units in the headings of a log: in brackets at the end, or as a word."""

import re
from dataclasses import dataclass

from elastid.base.units import SPELLINGS, TABLE, dimension_and_size, table_unit, translation_unit, units_of
from elastid.experiment.specs.channels import QUANTITY_UNIT

# Too short to be units elsewhere than as the last word, or in brackets.
_LAST, _IN_BRACKETS = ("g", "kN", "daN", "mN", "N"), ("a", "v", "kv", "m", "rev", "turn")
_UNITS = sorted(
    {"g", *(name for unit in QUANTITY_UNIT.values() for name in (*units_of(unit), *units_of(translation_unit(unit))))},
    key=lambda unit: (unit in _LAST, -len(unit), unit),
)
# Words in brackets that are no unit.
_NO_UNIT = re.compile(
    r"(?!.*\d/\d)[\d_\s.,:;#+\-/]*|.*\b(joint|axis|achse|motor|link|actual|filtered)\b.*", re.IGNORECASE
)
_IS_TIME = re.compile(r"(.*[./])?(t|time|zeit|timestamp|seconds)([^a-z./][^./]*)?", re.IGNORECASE)
TIME_UNIT = re.compile(r"s|sec(onds?)?|m?s|[mnuµμ]s|с|мс|秒|毫秒", re.IGNORECASE)
_COUNTS = re.compile(r"inc|count|cnt|tick|pulse|puls|digit|lsb|step|raw|^c$|qc", re.IGNORECASE)


@dataclass(frozen=True)
class HeadingUnit:
    """Unit in a heading, by its name in the table of units, or the unknown text instead."""

    unit: str = ""
    unknown: str = ""

    @property
    def quantity(self) -> str:
        """Quantity of a channel with the unit; empty where no quantity of a channel has it."""
        if self.unit == "g":
            return "acceleration"
        dimension = dimension_and_size(self.unit)[0]
        quantities = [name for name, unit in QUANTITY_UNIT.items() if dimension in (unit, translation_unit(unit))]
        return min(quantities, key=lambda name: QUANTITY_UNIT[name] != dimension, default="")  # N: a force first

    @property
    def remedy(self) -> str:
        """The remedy for an unknown unit."""
        if re.search("%|‰|rated|mille|/1000", self.unknown, re.IGNORECASE):
            remedy = "scale = rated torque or current / its number in the log (1000 for 0.1 %)"
        elif _COUNTS.search(self.unknown):
            remedy = "scale = 360 / counts per turn, with unit: deg"
        else:
            remedy = "give unit and scale"
        return f"the unit '{self.unknown}' is unknown: {remedy}"


def in_brackets(name: str) -> list[str]:
    """Return the text in brackets at the end of a heading, in a list; an empty list without one.

    >>> in_brackets("Torque [mNm]"), in_brackets("時間（s）")
    (['mNm'], ['s'])
    """
    return re.findall(r"[\[(（]([^\[\]()（）]+)[\])）]\s*$", name)


def is_time(name: str) -> bool:
    """Return True for the name of a channel that is a time by its name, or by a unit in brackets."""
    return _IS_TIME.fullmatch(name) is not None or any(TIME_UNIT.fullmatch(unit.strip()) for unit in in_brackets(name))


def unit_of_heading(name: str, stated: str = "") -> HeadingUnit:
    """Return the unit in a heading; stated: unit in a row or an attribute, used if the heading has no known unit.

    >>> unit_of_heading("Torque[mNm]").unit, unit_of_heading("present_current_mA").unit
    ('mN*m', 'mA')
    >>> unit_of_heading("Position actual value [inc]").unknown
    'inc'
    """
    texts = [text for text in (*in_brackets(name), stated) if text and not _NO_UNIT.fullmatch(text.strip())]
    if texts:
        units = map(HeadingUnit, map(unit_of_text, texts))
        return next((unit for unit in units if unit.quantity), HeadingUnit(unknown=texts[0].strip()))
    # A capital letter begins a word, but not behind the prefix of a unit: mNm, mA, daNm.
    text = re.sub(r"(?<=[a-z])(?<![^A-Za-z][mk])(?<!^[mk])(?<![^A-Za-z]da)(?=[A-Z])", "_", name).lower()
    for unit in _UNITS:
        word = re.search(rf"(?<![a-zµμ])({SPELLINGS[unit]})(?![a-z]){'$' * (unit in _LAST)}", text, re.IGNORECASE)
        if word and word[0] not in _IN_BRACKETS:
            return HeadingUnit(unit)
    return HeadingUnit()


def unit_of_text(text: str) -> str:
    """Return the name in the table of a unit that stands alone, empty for other texts.

    >>> unit_of_text("N·m"), unit_of_text("U/min"), unit_of_text("Arms")
    ('N*m', 'rpm', '')
    """
    text = table_unit(text.strip())
    units = (unit for unit in _UNITS if re.fullmatch(SPELLINGS[unit], text, re.IGNORECASE))
    return text if text in TABLE else next(units, "")
