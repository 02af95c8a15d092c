"""Refusals: an error with one of some codes, and its place."""

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from elastid.base.errors import ElastidError


@contextmanager
def refused(*codes: str, place: str = "") -> Iterator[pytest.ExceptionInfo[ElastidError]]:
    """Assert that the block is refused with one of these codes; place: a part of the place that it names."""
    with pytest.raises(ElastidError) as caught:
        yield caught
    assert caught.value.code in codes, caught.value
    assert place in caught.value.place, caught.value
