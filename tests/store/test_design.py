"""Plans come back to the last bit, with limits, rehearsal and forecast, and as tables for a controller."""

import csv

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given
from plants.artefacts import QUICK, STAMP, complex_numbers, finite, names, same

from elastid.base.note import Note
from elastid.design.forecast import Forecast, LimitUse
from elastid.experiment.plan.movement import Reference, Rehearsal
from elastid.experiment.plan.plan import Experiment, Plan
from elastid.record import Configuration
from elastid.store.design import (
    read_forecast,
    read_peaks,
    read_plan,
    read_rehearsal,
    write_movement,
    write_plan,
    write_torque,
)

HOME, AWAY = Configuration("home", [0.1, -0.2]), Configuration("a/way", [1.0, 2.0])
NOTES = (Note("code", "text", "place", "information"), Note("other", "a longer text"))


def some_plan():
    """Two motors, the second on a slide, in two configurations."""
    R = np.random.default_rng(0).standard_normal((2, 1, 2, 3, 2)) + 0j
    return Plan((HOME, AWAY), ("motor 1", "motor 2"), 8.0, 16, 2, 1, np.array([1, 3, 5]), R, sliding=("motor 2",))


def some_reference():
    """Ten samples of which the third begins the periods."""
    columns = [np.arange(20.0).reshape(10, 2) * 10**i for i in range(4)]
    return Reference(AWAY, 8.0, 2, *columns, np.linspace(0, 1, 10))


@given(data=st.data())
@QUICK
def test_a_plan_comes_back_to_the_last_bit(tmp_path_factory, data):
    """All that the rig needs."""
    n_u = data.draw(st.integers(1, 3))
    configurations = tuple(Configuration(name, data.draw(finite(n_u))) for name in data.draw(names(2)))
    R = data.draw(complex_numbers(2, 2, n_u, 3, n_u))
    plan = Plan(configurations, data.draw(names(n_u)), data.draw(st.floats(1, 1e5)), 64, 2, 1, np.array([1, 3, 5]), R)
    path = tmp_path_factory.mktemp("store") / "plan.h5"
    write_plan(path, plan, STAMP)
    assert same(read_plan(path), plan)


def test_limits_rehearsal_and_forecast_come_back_to_the_last_bit(tmp_path):
    """Beside the plan; without them only the forecast may be asked for."""
    limits = np.full((2, 5, 2), np.inf)
    use = LimitUse(
        ("home", "a/way"),
        ("motor 1", "motor 2"),
        np.arange(20.0).reshape(2, 5, 2),
        limits,
        np.array([[1.0, 0.5], [0.25, 1.0]]),
        0.9,
        NOTES,
        "a/way-r0-e1",
        ("motor 2",),
    )
    run = Rehearsal(Experiment(AWAY, 0, 1), 8.0, 2, np.arange(20.0).reshape(10, 2), np.ones((10, 2)))
    forecast = Forecast(
        ("k_1", "k_2"),
        ("N*m/rad", "N/m"),
        np.array([1e4, 2e4]),
        (True, False),
        np.array([[1e-4, 0.0], [0.0, np.inf]]),
        ("home",),
        np.array([0.5, 1.5]),
        np.arange(4.0).reshape(1, 2, 2),
        np.array([[0.0, 1.0]]),
        NOTES,
        "by D-optimality",
    )
    path = tmp_path / "plan.h5"
    write_plan(path, some_plan(), STAMP, (some_reference(),), use, forecast, run)
    assert same(read_plan(path), some_plan())
    assert same(read_peaks(path), use)
    assert same(read_forecast(path), forecast)
    assert same(read_rehearsal(path), run)
    write_plan(path, some_plan())
    assert read_forecast(path) is None


def rows(path):
    with path.open() as file:
        heading, *numbers = csv.reader(file)
    return heading, np.array(numbers, float)


def test_a_movement_is_a_table_with_a_row_for_each_sample(tmp_path):
    """Time 0 where the periods begin; newtons and metres for an input that translates."""
    write_movement(tmp_path / "a.csv", some_reference(), ("motor 1", "motor 2"), ("motor 2",))
    heading, numbers = rows(tmp_path / "a.csv")
    assert heading[:4] == [
        "time_s",
        "torque scale",
        "position of motor 1 (rad, link side)",
        "position of motor 2 (m, link side)",
    ]
    assert heading[-1] == "feed_forward of motor 2 (N, link side)"
    np.testing.assert_allclose(numbers[:, 0], (np.arange(10) - 2) / 8)
    expected = some_reference()
    columns = [
        expected.scale,
        *(getattr(expected, n) for n in ("position", "velocity", "acceleration", "feed_forward")),
    ]
    np.testing.assert_allclose(numbers[:, 1:], np.column_stack(columns), rtol=1e-8)


def test_the_torque_is_a_table_of_one_period(tmp_path):
    """From time 0 on, in the unit of each input."""
    plan, experiment = some_plan(), Experiment(AWAY, 0, 1)
    write_torque(tmp_path / "u.csv", plan, experiment)
    heading, numbers = rows(tmp_path / "u.csv")
    assert heading == ["time_s", "motor 1 (N*m, link side)", "motor 2 (N, link side)"]
    assert numbers[0, 0] == 0
    assert numbers.shape == (16, 3)
    assert numbers[:, 1:] == pytest.approx(plan.torque(experiment), rel=1e-8)
