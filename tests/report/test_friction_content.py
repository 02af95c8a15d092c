"""Rows of the table of friction."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from plants.friction_study import friction_content
from plants.taken_friction import LEVELS, STDS, taken_friction

from elastid.base.statistics import QUANTILE_95
from elastid.friction_study.result import FrictionResult
from elastid.nonlinear.friction import friction_rows
from elastid.validation.twin import TORQUE, TwinFindings, TwinRun, TwinSignal


def test_sliding_friction_is_the_sum_of_its_levels_with_their_covariance() -> None:
    """F_c 4.5 Nm; a motor that keeps its friction has no level."""
    taken, kept = friction_rows(taken_friction())
    std = math.hypot(*STDS)
    assert (taken.level, taken.std) == (sum(LEVELS), pytest.approx(std))
    assert taken.interval == pytest.approx((4.5 - QUANTILE_95 * std, 4.5 + QUANTILE_95 * std))
    assert (taken.unit, taken.kept_share) == ("N*m", 0.0321)
    assert (kept.place, kept.unit, kept.level, kept.interval) == ("motor 2", "N", None, None)


def test_numbers_are_good_where_the_least_known_of_them_is(monkeypatch: pytest.MonkeyPatch) -> None:
    """Coulomb friction to 5 % is; to 28 %, as where logs of several temperatures are taken for one, it is named."""
    content = friction_content()
    number = next(each for each in content.result.numbers if each.symbol == "F_c")
    said = []
    for width in (0.05, 0.28):
        ends = {"low": number.value * (1 - width), "high": number.value * (1 + width)}
        monkeypatch.setattr(FrictionResult, "numbers", (replace(number, **ends),))
        said.append(replace(content, result=replace(content.result, status="identified")).questions[0][1][0])
    assert said == ["Yes.", f"Not all of them: {number.name} is known to ±28 % alone."]


@pytest.mark.parametrize(("error", "first"), [(0.02, "Yes, as far"), (0.15, "Yes, though")])
def test_numbers_are_good_as_far_as_a_twin_with_them_moves_as_its_log(error: float, first: str) -> None:
    """One whose torque is 15 % off, or that is lost, is said in the first sentence."""
    t = np.arange(500) / 100
    torque = np.sin(2 * np.pi * t)
    signal = TwinSignal(TORQUE, "motor 1", "N*m", torque, torque + error * np.cos(2 * np.pi * t))
    run = TwinRun("log a", "torque", 0.5, 5.0, 100.0, (signal,))
    content = replace(friction_content(), twin=TwinFindings((), (run,)))
    said = content.questions[0][1][0]
    assert said.startswith(first)
    assert ("is off in the torque of motor 1 by 15 %" in said) == (error > 0.1)
    lost = replace(content, twin=TwinFindings((), (replace(run, signals=(), lost="it falls"),)))
    assert lost.questions[0][1][0].startswith("Yes, though a robot with them is lost")
