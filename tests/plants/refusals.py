"""Refusals: an error with one of some codes, its place, and what it states of the user's data."""

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import pytest

from elastid.base.errors import ElastidError


@contextmanager
def refused(
    *codes: str, place: str = "", holds: str | Sequence[str] = ()
) -> Iterator[pytest.ExceptionInfo[ElastidError]]:
    """Assert that the block is refused with one of these codes.

    place: a part of the place that it names.  holds: names and numbers of the user's that it states.
    """
    with pytest.raises(ElastidError) as caught:
        yield caught
    assert caught.value.code in codes, caught.value
    assert place in caught.value.place, caught.value
    for stated in (holds,) if isinstance(holds, str) else holds:
        assert stated in str(caught.value), caught.value


def advised(caught: pytest.ExceptionInfo[Exception], after: str) -> float:
    """The number that a refusal states after some words."""
    found = re.search(rf"{after} (\d+\.?\d*)", str(caught.value))
    assert found, caught.value
    return float(found[1])
