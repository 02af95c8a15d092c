"""The same note from many places is one line."""

import pytest

from elastid.base.errors import Note, ProgramError, check_theta, group_notes, is_program_fault


def test_notes_that_differ_in_their_numbers_are_grouped_by_place() -> None:
    """Up to three places are named; of more the first, with a count."""
    three = [Note("late-log", f"{i} samples late", f"log {i}") for i in range(3)]
    (group,) = group_notes([*three, three[0]])
    assert str(group) == "log 0, log 1, log 2: 0 samples late"
    (group,) = group_notes([*three, Note("late-log", "9 samples late", "log 3")])
    assert str(group) == "log 0 and 3 more: 0 samples late"


def test_program_fault_is_an_attribute_error_raised_inside_elastid() -> None:
    """An AttributeError of the caller's code is not a program fault; a ValueError states a fault of the data."""
    check_theta([1.0], ["k_1"])
    for call, is_fault in (
        (lambda: group_notes([1]), True),
        (lambda: (1).text, False),
        (lambda: check_theta([1.0, 2.0], ["k_1"]), False),
    ):
        with pytest.raises((AttributeError, ValueError)) as error:
            call()
        assert is_program_fault(error.value) == is_fault
    assert is_program_fault(ProgramError())
    assert not is_program_fault(TypeError())
