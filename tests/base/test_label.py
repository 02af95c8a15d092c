"""The label of a field, and the unit that a name states."""

from dataclasses import dataclass, fields

from elastid.base.label import NO_LABEL, Label, label_of, labelled, unit_of_name


@dataclass(frozen=True)
class Values:
    """A value with a labelled field and a bare one."""

    angle: float = labelled("angle of the motor", "rad", "time_s inputs", default=0.0)
    bare: int = 1


def test_a_field_carries_its_label_and_its_default() -> None:
    """A field without one has the empty label."""
    angle, bare = fields(Values)
    assert label_of(angle) == Label("angle of the motor", "rad", ("time_s", "inputs"))
    assert label_of(bare) == NO_LABEL
    assert Values() == Values(0.0, 1)


def test_a_unit_is_the_ending_behind_an_underscore() -> None:
    """Not a letter that a name happens to end with."""
    assert [unit_of_name(name) for name in ("freq_hz", "start_s", "s", "gains")] == ["Hz", "s", "", ""]
