"""Names that a study got wrong."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches


def did_you_mean(name: str, known: Iterable[str], further: Iterable[str] = ()) -> str:
    """The name that was probably meant, or else those that there are: the end of a message about an unknown name.

    further: names that may have been meant, too, but are too many to be listed.

    >>> did_you_mean("bamd_hz", ["band_hz", "period"])
    "did you mean 'band_hz'?"
    >>> did_you_mean("x", ["band_hz", "period"])
    'there are band_hz, period'
    """
    names = list(known)
    close = get_close_matches(name, [*names, *further], n=1)
    return f"did you mean '{close[0]}'?" if close else f"there are {', '.join(names)}"
