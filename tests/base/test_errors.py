"""Messages that list names: where there is none, they say so."""

import pytest

from elastid.base.errors import Named, UnknownNameError, did_you_mean, index_of


def test_a_list_of_no_names_is_none() -> None:
    """`there are ` with nothing behind it."""
    assert did_you_mean("bench", []) == "there are none"
    with pytest.raises(UnknownNameError, match=r"no joint 1; there are none$"):
        index_of("1", [], "joint")
    with pytest.raises(UnknownNameError, match=r"no result bench; there are none$"):
        Named[int]("result", {})["bench"]
