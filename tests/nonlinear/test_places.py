"""Records on the shafts of coupled motors.

Where friction found in records ends, the records' own sentence says so.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from plants.dry_friction import measured

from elastid.frf.spec import EstimatorSpec
from elastid.nonlinear.find import find_friction
from elastid.nonlinear.take_out import on_links, on_shafts
from elastid.record import Configuration, Record

E = np.array([[1.0, 0.0], [-0.4, 1.0]])


def record() -> Record:
    rng = np.random.default_rng(0)
    places = ("motor 5", "motor 6")
    return Record(
        "r", Configuration("c", [0.0, 0.0]), 0, 0, 100.0, 40, places, ("accelerometer tool z", *places[::-1]),
        ("acceleration", "position", "position"), rng.standard_normal((80, 2)), rng.standard_normal((80, 3)),
        rng.standard_normal((80, 2)),
    )  # fmt: skip


def test_power_is_the_same_on_both_sides_and_the_way_back_leads_home() -> None:
    """u^T q of motors, whatever the order of the outputs; other outputs stay."""
    links, shafts = record(), on_shafts(record(), E)

    def power(one: Record) -> np.ndarray:
        return np.asarray(one.u[:, 0] * one.y[:, 2] + one.u[:, 1] * one.y[:, 1])

    np.testing.assert_allclose(power(shafts), power(links))
    np.testing.assert_array_equal(shafts.y[:, 0], links.y[:, 0])
    np.testing.assert_allclose(shafts.y[:, 1], -0.4 * links.y[:, 2] + links.y[:, 1])
    back = on_links(shafts, E)
    for name in ("u", "y", "r"):
        np.testing.assert_allclose(getattr(back, name), getattr(links, name), atol=1e-14)
    assert on_shafts(links, None) is links


def test_a_shaft_needs_the_motions_of_all_motors() -> None:
    """With one motor's encoder missing no motor is among the outputs, and friction is left where it is."""
    one = record()
    partial = replace(one, y=one.y[:, :2], outputs=one.outputs[:2], quantities=one.quantities[:2])
    assert on_shafts(partial, E).outputs == ("accelerometer tool z",)


AUTO = EstimatorSpec(friction="auto")


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
