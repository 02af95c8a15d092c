"""Where friction found in records ends, the records' own sentence says so."""

from dataclasses import replace

import numpy as np
from plants.dry_friction import measured

from elastid.frf.spec import EstimatorSpec
from elastid.nonlinear.find import find_friction
from elastid.nonlinear.places import limits_of
from elastid.record import Record

AUTO = EstimatorSpec(friction="auto")


def test_a_motor_that_slides_has_no_note() -> None:
    assert limits_of(measured()[0][0]) == ()


def stuck(record: Record) -> Record:
    """Motor 2 stands for the middle of each period, and swings in the rest as before and back."""
    t = np.arange(record.n_samples) % record.period_samples / record.period_samples
    y = record.y.copy()
    y[:, 1] = np.where(t < 0.5, 1e-3 * np.sin(4 * np.pi * t) ** 3, 0.0)
    return replace(record, y=y)


def test_a_motor_that_sticks_is_named_with_its_share() -> None:
    """Half of the time and a little more, about its turning points."""
    (note,) = limits_of([stuck(record) for record in measured()[0][0]])
    assert note.code == "friction-sticks"
    assert note.text.startswith("motor 2 hardly moves for 5")


def test_a_motor_beside_the_inputs_keeps_its_friction() -> None:
    alone = [replace(r, inputs=("motor 1",), u=r.u[:, :1], r=None) for r in measured()[0][0]]
    (note,) = limits_of(alone)
    assert "motor 2: friction stays in the responses" in note.text


def test_nothing_is_taken_out_of_a_torque_that_is_the_reference() -> None:
    """Of the second motor alone: its controller's torque was not logged."""
    configurations, lines = measured()
    copied = [
        [replace(r, r=np.column_stack([r.r[:, 0], r.u[:, 1]])) for r in records if r.r is not None]
        for records in configurations
    ]
    result = find_friction(copied, AUTO, lines)
    assert result.shapes == ()
    assert "the torque of motor 2 equals the reference to the last bit" in result.notes[0].text
