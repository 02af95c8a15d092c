"""The same note from many places is one line."""

from elastid.base.errors import Note, grouped


def test_notes_that_differ_in_their_numbers_are_grouped_by_place() -> None:
    """Up to three places are named; of more the first, with a count."""
    three = [Note("late-log", f"{i} samples late", f"log {i}") for i in range(3)]
    (group,) = grouped([*three, three[0]])
    assert str(group) == "log 0, log 1, log 2: 0 samples late"
    (group,) = grouped([*three, Note("late-log", "9 samples late", "log 3")])
    assert str(group) == "log 0 and 3 more: 0 samples late"
