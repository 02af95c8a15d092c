"""Units in the headings of a log: in brackets at the end, or as a word."""

import re
from dataclasses import dataclass

from elastid.base.units import TABLE, of_translation, usual_spelling
from elastid.experiment.specs.channels import QUANTITY_UNIT

_TIMES, _PER = r"[*·⋅. ]?", r"(/|_?per_?|_)"
_SECOND, _SQUARED = r"s(ec)?", r"s(ec)?(\^?2|²)"
# Spelling (of lower case) of a unit as a word, and the unit; the first that fits.
_SPELLINGS = (
    *((rf"{u}{_PER}{_SQUARED}", f"{u}/s^2") for u in ("rad", "deg", "mm", "m")),
    *((rf"{u}{_PER}{_SECOND}", f"{u}/s") for u in ("mrad", "rad", "mdeg", "deg", "um", "mm", "m")),
    (rf"°{_PER}{_SQUARED}", "deg/s^2"), (rf"°{_PER}{_SECOND}", "deg/s"),
    (r"rpm|([ur]|rev|turns?|1)/min|min\^?-1", "rpm"),
    (r"mdeg|m°", "mdeg"), (r"deg(rees?)?|grad|°", "deg"), (r"mrad", "mrad"), (r"rad(ians?)?", "rad"),
    (r"arcmin", "arcmin"), (r"arcsec", "arcsec"), (rf"mn{_TIMES}m", "mN*m"), (rf"kn{_TIMES}m", "kN*m"),
    (rf"dan{_TIMES}m", "daN*m"), (rf"n{_TIMES}cm", "N*cm"), (rf"n{_TIMES}mm", "N*mm"), (rf"n{_TIMES}m", "N*m"),
    (r"mm", "mm"), (r"[uµμ]m", "um"), (r"ma(mps?)?", "mA"), (r"amps?|amperes?", "A"), (r"mv", "mV"),
)  # fmt: skip
# As the last word: too short to be a unit elsewhere.
_LAST = ((r"g", "g"), (r"kn", "kN"), (r"dan", "daN"), (r"mn", "mN"), (r"n", "N"))
_IN_BRACKETS = ((r"a", "A"), (r"v", "V"), (r"kv", "kV"), (r"m", "m"), (r"rev|turns?", "rev"))
# Words in brackets that are no unit.
_NO_UNIT = re.compile(r"[^A-Za-z%°µμ]*|.*\b(joint|axis|achse|motor|link|actual|filtered)\b.*", re.IGNORECASE)
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
        dimension = TABLE.get(self.unit, ("", 1.0))[0]
        fitting = [name for name, unit in QUANTITY_UNIT.items() if dimension in (unit, of_translation(unit))]
        return min(fitting, key=lambda name: QUANTITY_UNIT[name] != dimension, default="")  # N: a force first

    @property
    def question(self) -> str:
        """The remedy for an unknown unit."""
        if "%" in self.unknown or "rated" in self.unknown.lower():
            remedy = "scale = rated torque or current / its number in the log (1000 for 0.1 %)"
        elif _COUNTS.search(self.unknown):
            remedy = "scale = 360 / counts per turn, with unit: deg"
        else:
            remedy = "give unit and scale"
        return f"the unit '{self.unknown}' is unknown: {remedy}"


def unit_of_heading(name: str, stated: str = "") -> HeadingUnit:
    """Return the unit in a heading; stated: by the file, in a row or an attribute of its own.

    >>> unit_of_heading("Torque[mNm]").unit, unit_of_heading("present_current_mA").unit
    ('mN*m', 'mA')
    >>> unit_of_heading("Position actual value [inc]").unknown
    'inc'
    """
    for text in (stated, *re.findall(r"[\[(]([^\[\]()]+)[\])]\s*$", name)):
        if text and not _NO_UNIT.fullmatch(text.strip()):
            unit = unit_of_text(text)
            return HeadingUnit(unit) if HeadingUnit(unit).quantity else HeadingUnit(unknown=text.strip())
    # A capital letter begins a word, but not behind the prefix of a unit: mNm, mA, daNm.
    text = re.sub(r"(?<=[a-z])(?<![^A-Za-z][mk])(?<!^[mk])(?<![^A-Za-z]da)(?=[A-Z])", "_", name).lower()
    for spelling, unit in _SPELLINGS:
        if re.search(rf"(?<![a-zµμ])({spelling})(?![a-z])", text):
            return HeadingUnit(unit)
    return HeadingUnit(next((unit for spelling, unit in _LAST if re.search(rf"(?<![a-z]){spelling}$", text)), ""))


def unit_of_text(text: str) -> str:
    """Return the name in the table of a unit that stands alone, empty for other texts.

    >>> unit_of_text("N·m"), unit_of_text("U/min"), unit_of_text("Arms")
    ('N*m', 'rpm', '')
    """
    text = text.strip()
    if text in TABLE:
        return usual_spelling(text)
    every = (*_SPELLINGS, *_LAST, *_IN_BRACKETS)
    return next((unit for spelling, unit in every if re.fullmatch(spelling, text.lower())), "")
