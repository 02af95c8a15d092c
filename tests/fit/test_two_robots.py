"""Several robots of one type in one fit: what they share, what each has of its own, and what is said where they mix."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from plants.data_sheet_arm import FREQ, POSTURES, arm
from plants.marks import SEEDS
from plants.measured_robots import responses_of
from plants.refusals import refused

from elastid.fit.fitted_robot import FittedRobot, models_by_group
from elastid.fit.identify import identify
from elastid.fit.parameter_choice import choose
from elastid.fit.result import Result
from elastid.fit.spec import FitSpec, ParameterSpec, RatioSpec, TieSpec
from elastid.linear.response.transfer import frequency_response
from elastid.model.formulation import EXACT
from elastid.response import Response
from elastid.robot import Robot
from elastid.validation.comparison import ComparedVariant, RefitTask, refit

A = arm()
B = arm().with_parameters({"k_1": 3.6e4, "fm_1": 3e-2, "fm_2": 5e-3})
ROBOTS = {"A": ("a1", "a2", "a3"), "B": ("b1", "b2", "b3")}


def measure(robot: Robot, name: str, seed: int, postures: tuple[tuple[float, float], ...] = POSTURES) -> list[Response]:
    """Responses in each posture with 2 % noise of known variance."""
    named = {f"{name}{i + 1}": angles for i, angles in enumerate(postures)}
    return responses_of(robot, named, np.random.default_rng(seed), FREQ)


def both(seed: int, one: Robot = A, other: Robot = B) -> list[Response]:
    """Two robots, measured in the same postures."""
    return [*measure(one, "a", 2 * seed), *measure(other, "b", 2 * seed + 1)]


SPEC = FitSpec(
    starts=2,
    robots=ROBOTS,
    parameters={
        "k_1": ParameterSpec(per="robot"),
        "k_2": ParameterSpec(),
        "d_*": ParameterSpec(),
        "fm_*": ParameterSpec(per="robot"),
    },
)
TRUTH = {"k_1@A": 3e4, "k_1@B": 3.6e4, "k_2": 2e4, "fm_1@A": 1e-2, "fm_1@B": 3e-2, "fm_2@A": 1e-2, "fm_2@B": 5e-3}


def off(result: Result, name: str, truth: float) -> float:
    i = result.parameters.free_names.index(name)
    return float(abs(result.x[i] - math.log(truth)) / math.sqrt(result.covariance[i, i]))


@pytest.mark.parametrize("seed", SEEDS)
def test_shared_and_own_values_of_two_robots_are_found(seed: int) -> None:
    """Each robot's stiffness and friction by its name, what they share once, all within the claimed intervals."""
    result = identify(both(seed), arm().with_parameters({"k_1": 2.5e4, "k_2": 2.5e4}), replace(SPEC, seed=seed))
    assert result.status == "converged"
    assert set(result.parameters.free_names) == {*TRUTH, "d_1", "d_2"}
    assert max(off(result, name, truth) for name, truth in TRUTH.items()) < 3.5
    assert not {"fit/responses", "fit/unlike-responses"} & {note.code for note in result.notes}
    place = result.parameters.index("k_1")
    assert result.parameters.expand(result.x, "b3")[place] == result.values["k_1@B"]
    # A third robot of the type, of which nothing was fitted: the mean of those that were.
    assert result.parameters.expand(result.x, "c1")[place] == pytest.approx(
        math.sqrt(result.values["k_1@A"] * result.values["k_1@B"])
    )


def test_a_left_out_configuration_has_the_numbers_of_its_robot() -> None:
    """What is found for robot B from b1 and b2 predicts b3; without any of B's, the mean of the others does."""
    data = both(0)
    result = identify([G for G in data if G.configuration.name != "b3"], arm(), SPEC)
    (predicted,) = FittedRobot.of(result, arm(), data[-1:]).responses
    assert np.median(np.abs(predicted.G / data[-1].G - 1)) < 0.03
    own = ComparedVariant("own", arm(), SPEC, EXACT)
    fold = refit(data, RefitTask(own, ("b3",)))
    assert fold.left_out["b3"].misfit < 1.2
    without = refit(data, RefitTask(own, ROBOTS["B"]))
    assert without.left_out["b1"].misfit > 10


def test_robots_must_be_named_once_and_at_all() -> None:
    with refused("fit/parameters", place="fit.parameters.k_1.per"):
        choose(replace(SPEC, robots={}), arm(), ["a1"])
    with pytest.raises(ValueError, match="robots: configuration a1 is given to A, B"):
        FitSpec(robots={"A": ("a1",), "B": ("a1",)})


def test_an_export_is_of_one_robot_each() -> None:
    """The linear models of robot B have its numbers: their response is that of the fit, and A's are another's."""
    data = both(0)
    ratio = {"beta": RatioSpec(start=2e-3)}
    tied = SPEC.parameters | {"d_*": ParameterSpec(tie=TieSpec("k_*", by="beta"))}
    result = identify(data, arm(), replace(SPEC, parameters=tied, ratios=ratio, starts=1))
    models = models_by_group(result, arm(), data)
    assert {name: tuple(G.configuration.name for G in of.measured) for name, of in models.items()} == ROBOTS
    for name, model in models.items():
        assert model.robot.parameters()["k_1"][0] == result.values[f"k_1@{name}"]
        names = [p.name for p in model.parameters]
        assert f"fm_1@{name}" in names
        assert not {"k_1", "fm_1", f"fm_1@{'BA'['AB'.index(name)]}"} & set(names)
        for linear, fitted in zip(model.linear, FittedRobot.of(result, arm(), model.measured).responses, strict=True):
            np.testing.assert_allclose(frequency_response(linear, model.theta, FREQ), fitted.G, rtol=1e-9)
