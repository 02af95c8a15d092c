"""Names in a study (joints, bodies, configurations ...): their rules, and the patterns that select them.

A name is one line of printable characters, so that no terminal, file or program interprets it. Names in one list differ
in more than case. A text that equals a name selects this name; any other text is a pattern (`*`, `?`, `[...]`).
"""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import lru_cache
from typing import Annotated, Any, TypeAlias
from unicodedata import normalize

MAX_NAME_LENGTH = 100
MAX_FILE_NAME_BYTES = 200  # systems allow 255; file names add a number, a stamp and an extension
SEPARATOR = "@"  # between the name of a parameter and its group
# Windows reserves these names, with any extension.
_DEVICES = {"CON", "PRN", "AUX", "NUL", *(f"{port}{i}" for port in ("COM", "LPT") for i in range(1, 10))}


@dataclass(frozen=True)
class NameRule:
    """Rule of a field that is a name, in its annotation.

    is_file: the name is also the name of a file or folder.  without: characters that are not allowed.  is_optional: the
    name may be empty.
    """

    is_file: bool = False
    without: str = ""
    is_optional: bool = False

    def check(self, name: str) -> str:
        r"""Return the name; ValueError for a text that is not a valid name.

        >>> NameRule().check("1\nevil: 1")
        Traceback (most recent call last):
        ValueError: the name '1\nevil: 1' contains the character U+000A, which cannot be printed; take it out
        """
        if problem := "" if self.is_optional and not name else self._problem(name):
            text = f"'{name}'" if name.isprintable() and len(name) <= MAX_NAME_LENGTH else f"{name[:20]!a}"
            raise ValueError(f"the name {text} {problem}")
        return name

    def _problem(self, name: str) -> str:
        """Return the reason why a text is not a valid name; empty for a valid name."""
        if not 0 < len(name) <= MAX_NAME_LENGTH:
            return f"has {len(name)} characters; give 1 to {MAX_NAME_LENGTH}"
        if not name.isprintable():
            code = next(ord(character) for character in name if not character.isprintable())
            return f"contains the character U+{code:04X}, which cannot be printed; take it out"
        if name != name.strip():
            return "begins or ends with a blank; take it out"
        if any(character in name for character in self.without):
            return f"contains one of {self.without}, which separates a parameter from its group; take another character"
        if not self.is_file:
            return ""
        is_long = len(name.encode("utf-8", "surrogatepass")) > MAX_FILE_NAME_BYTES
        is_device = name.split(".")[0].upper() in _DEVICES  # of Windows
        if is_long or is_device or "." in (name[0], name[-1]) or not {*name}.isdisjoint('/\\:*?"<>|'):
            return f'cannot name a file: no / \\ : * ? " < > |, outer dot, device, or over {MAX_FILE_NAME_BYTES} bytes'
        return ""

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        """Return the pydantic schema of the field."""
        from pydantic_core import core_schema  # value types stay free of pydantic

        return core_schema.no_info_after_validator_function(self.check, handler(source))


Name: TypeAlias = Annotated[str, NameRule()]
# Name of a part of the robot, which is the end of the names of its parameters.
PartName: TypeAlias = Annotated[str, NameRule(without=SEPARATOR)]
OptionalName: TypeAlias = Annotated[str, NameRule(without=SEPARATOR, is_optional=True)]
FileName: TypeAlias = Annotated[str, NameRule(is_file=True)]


def at_amplitude(posture: str, number: int) -> str:
    """Return the name of a configuration at an amplitude, counted from 1; at the first amplitude it is unchanged.

    >>> at_amplitude("bent", 1), at_amplitude("bent", 2)
    ('bent', 'bent amplitude 2')
    """
    return posture if number == 1 else f"{posture} amplitude {number}"


def posture_of(configuration: str) -> str:
    """Return the name of a configuration without its amplitude; settings of a study apply to all amplitudes.

    >>> posture_of("bent amplitude 2")
    'bent'
    """
    return re.sub(r" amplitude [1-9][0-9]*$", "", configuration)


@lru_cache(maxsize=4096)
def _normalise(name: str) -> str:
    return normalize("NFKC", normalize("NFKC", name).casefold()).replace(" ", "_")


def check_different(noun: str, names: Iterable[str]) -> None:
    """Raise ValueError for equal names, and for names that differ only in case or blanks.

    >>> check_different("joint", ["arm", "Arm"])
    Traceback (most recent call last):
    ValueError: joint 'Arm' differs from 'arm' in case or in a blank alone; give it a name of its own
    """
    names_by_folded: dict[str, str] = {}
    for name in names:
        earlier, names_by_folded[_normalise(name)] = names_by_folded.get(_normalise(name)), name
        if earlier == name:
            raise ValueError(f"{noun} {name} is given twice; leave one out")
        if earlier is not None:
            text = f"{noun} '{name}' differs from '{earlier}' in case or in a blank alone"
            raise ValueError(f"{text}; give it a name of its own")


def is_match(name: str, pattern: str) -> bool:
    """Return True if a pattern matches a name.

    >>> is_match("k_axis [1]", "k_axis [1]"), is_match("k_1", "k_*")
    (True, True)
    """
    return name == pattern or fnmatchcase(name, pattern)


def match_names(pattern: str, names: Iterable[str]) -> tuple[str, ...]:
    """Return the name equal to a text, or else all names that match it as a pattern.

    >>> match_names("k_[1]", ["k_1", "k_[1]"])
    ('k_[1]',)
    >>> match_names("k_[1]", ["k_1", "d_1"])
    ('k_1',)
    """
    all_names = tuple(names)
    return (pattern,) if pattern in all_names else tuple(name for name in all_names if fnmatchcase(name, pattern))
