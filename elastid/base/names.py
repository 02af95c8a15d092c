"""Names that a study gives to joints, bodies, configurations and the like, and the patterns that choose among them.

A name is one line of printable characters, so that it is nothing but a name in a terminal, a file or a program. Within
one list, names differ in more than case. A name always stands for itself, whatever characters it has; only where no
name is equal to it, a text is a pattern (`*`, `?`, `[...]`).
"""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import lru_cache
from typing import Annotated, Any, TypeAlias
from unicodedata import normalize

# Of a place on a robot, too.
MAX_NAME_LENGTH = 100
# Names of files are those of configurations with a number, a stamp and an ending; systems end at 255 bytes.
MAX_FILE_NAME_BYTES = 200
# Between the name of a parameter, which ends in that of a part of the robot, and its group.
SEPARATOR = "@"

# Behind the name of a configuration that is measured at several amplitudes, from the second one on.
_AMPLITUDE = re.compile(r" amplitude [1-9][0-9]*$")

_NOT_IN_FILE_NAMES = '/\\:*?"<>|'
# Names of devices on Windows, with any ending.
_DEVICES = {"CON", "PRN", "AUX", "NUL", *(f"{port}{i}" for port in ("COM", "LPT") for i in range(1, 10))}


@dataclass(frozen=True)
class NameRule:
    """Marks a text of a section as a name, which is checked however the section is made.

    is_file: it also names a file or a folder.  without: characters that have a meaning next to it.  is_optional: it may
    be empty.
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
        """Return the reason why a text is no name: a blank end or unprintable characters; empty for a valid name."""
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
        if is_long or is_device or "." in (name[0], name[-1]) or not {*name}.isdisjoint(_NOT_IN_FILE_NAMES):
            return f'cannot name a file: no / \\ : * ? " < > |, outer dot, device, or over {MAX_FILE_NAME_BYTES} bytes'
        return ""

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        """How pydantic validates the field; imported here so that value types stay free of pydantic."""
        from pydantic_core import core_schema

        return core_schema.no_info_after_validator_function(self.check, handler(source))


Name: TypeAlias = Annotated[str, NameRule()]
# Of a part of the robot: names of parameters end in it.
PartName: TypeAlias = Annotated[str, NameRule(without=SEPARATOR)]
# Default names.
OptionalName: TypeAlias = Annotated[str, NameRule(without=SEPARATOR, is_optional=True)]
FileName: TypeAlias = Annotated[str, NameRule(is_file=True)]


def at_amplitude(posture: str, number: int) -> str:
    """Name of a configuration at one amplitude, counted from 1; the first has the name of the configuration.

    >>> at_amplitude("bent", 1), at_amplitude("bent", 2)
    ('bent', 'bent amplitude 2')
    """
    return posture if number == 1 else f"{posture} amplitude {number}"


def posture_of(configuration: str) -> str:
    """Name of a configuration without its amplitude; settings of a study apply to all amplitudes.

    >>> posture_of("bent amplitude 2")
    'bent'
    """
    return _AMPLITUDE.sub("", configuration)


@lru_cache(maxsize=4096)
def _normalise(name: str) -> str:
    return normalize("NFKC", normalize("NFKC", name).casefold()).replace(" ", "_")


def check_different(noun: str, names: Iterable[str]) -> None:
    """Raise ValueError for a name that is given twice, or differs from another in case or blanks alone.

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
            raise ValueError(
                f"{noun} '{name}' differs from '{earlier}' in case or in a blank alone; give it a name of its own"
            )


def is_match(name: str, pattern: str) -> bool:
    """True if a pattern matches a name.

    >>> is_match("k_axis [1]", "k_axis [1]"), is_match("k_1", "k_*")
    (True, True)
    """
    return name == pattern or fnmatchcase(name, pattern)


def matching(pattern: str, names: Iterable[str]) -> tuple[str, ...]:
    """Return the name equal to a text, or else all names that match it as a pattern.

    >>> matching("k_[1]", ["k_1", "k_[1]"])
    ('k_[1]',)
    >>> matching("k_[1]", ["k_1", "d_1"])
    ('k_1',)
    """
    known_names = tuple(names)
    return (pattern,) if pattern in known_names else tuple(name for name in known_names if fnmatchcase(name, pattern))
