"""Configurations are parted only where own parameters describe them better."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plants.faults import FAULTS, SPEC, drawn, true_case

from elastid.fit.assembly import Assembly
from elastid.fit.diagnosis import configurations
from elastid.fit.diagnosis.configurations import costs_alone, find_two_groups
from elastid.fit.parameter_choice import choose
from elastid.fit.solve.solvers import solve


def test_logs_that_own_parameters_describe_no_better_are_not_parted() -> None:
    """A reference recorded as current is as wrong in each configuration."""
    case = FAULTS["reference recorded as current"](true_case())
    responses = drawn(case, np.random.default_rng(0))
    parameters = choose(SPEC, case.robot, [one.configuration.name for one in responses])
    fit = Assembly.of(responses, case.robot, SPEC, parameters).at(parameters.x, "complex")
    end = solve(fit.problem, parameters.x, 0.1)
    alone = costs_alone(fit, end.x)
    assert alone is not None
    assert find_two_groups(fit, end.x, alone, end.cost, 0.0, {}) == ()


def test_amplitudes_of_a_posture_are_one_side_of_a_split(monkeypatch: pytest.MonkeyPatch) -> None:
    """V of a posture is that of all its amplitudes, which no grouping parts and no search leaves out alone."""
    case = true_case()
    first, second, *others = drawn(case, np.random.default_rng(0))
    name = first.configuration.name
    second = replace(second, configuration=replace(second.configuration, name=f"{name} level 2"))
    responses = [first, second, *others]
    parameters = choose(SPEC, case.robot, [one.configuration.name for one in responses])
    fit = Assembly.of(responses, case.robot, SPEC, parameters).at(parameters.x, "complex")
    monkeypatch.setattr(configurations, "_solve", lambda fit, x: x)
    alone = costs_alone(fit, parameters.x)
    assert alone is not None
    assert alone.shape == (len(responses) - 1, len(responses) - 1)
    every = sum(part.normal.at(fit.theta(part, parameters.x))[0] for part in fit.parts)
    assert float(np.sum(alone[0])) == pytest.approx(every)
