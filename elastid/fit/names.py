"""Names that a study got wrong."""

from __future__ import annotations

from collections.abc import Sequence
from difflib import get_close_matches


def did_you_mean(name: str, known: Sequence[str]) -> str:
    """'did you mean k_1? there are k_1, k_2': the end of a message about an unknown name.

    >>> did_you_mean("k1", ["k_1", "d_1"])
    'did you mean k_1? there are k_1, d_1'
    """
    near = get_close_matches(name, known, n=1, cutoff=0.5)
    return (f"did you mean {near[0]}? " if near else "") + f"there are {', '.join(known)}"
