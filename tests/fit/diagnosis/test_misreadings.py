"""A reading is found from the numbers of the robot's file, wherever the fit of misread responses ended."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from plants.faults import SPEC, drawn, true_case

from elastid.base.arrays import FloatArray
from elastid.fit.assembly import Assembly
from elastid.fit.diagnosis.hypothesis import Evidence, Hypothesis, Scores
from elastid.fit.diagnosis.misreadings import READINGS, _from_the_file
from elastid.fit.diagnosis.prediction import Reading, evaluate, predict, settle
from elastid.fit.diagnosis.sensitivities import Evaluated
from elastid.fit.identify import identify
from elastid.fit.parameter_choice import choose
from elastid.fit.result import ModificationIndex
from elastid.fit.spec import FitSpec
from elastid.response import Response
from elastid.robot import Robot, Tolerances


def readings(evaluated: Sequence[Evaluated], costs: FloatArray) -> list[Reading]:
    """Every reading that is tried."""
    return [reading for each in READINGS if each.changes is not None for reading in each.changes(evaluated, costs)]


def assembled(data: Sequence[Response], robot: Robot, spec: FitSpec) -> Assembly:
    return Assembly.of(data, robot, spec, choose(spec, robot, [G.configuration.name for G in data]))


def misread(name: str, data: Sequence[Response]) -> list[Response]:
    """Responses as a laboratory would have them that took one thing for another."""
    if "exchanged" in name:
        first, second, *others = data
        taken = [replace(first, configuration=second.configuration), replace(second, configuration=first.configuration)]
        return [taken[1], taken[0], *others]
    signs = np.array([1.0, -1.0])
    return [replace(G, G=G.G * np.outer(signs, signs)) for G in data]


def test_every_change_of_a_reading_is_undone() -> None:
    """By its inverse, or by itself: of signs, exchanges, conjugates and powers of j omega."""
    case = true_case()
    assembly = assembled(drawn(case, np.random.default_rng(0)), case.robot, SPEC)
    evaluated = evaluate(assembly.at(assembly.parameters.x, "complex"), assembly.parameters.x)
    every = readings(evaluated, np.arange(len(evaluated), dtype=float))
    assert len({reading.name for reading in every}) > 12
    for reading in every:
        for e in evaluated:
            back = (reading.undo or reading.change)(e, reading.change(e, e.G))
            np.testing.assert_allclose(back, e.G, rtol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["c1 and c2 exchanged", "motor 2 counted in the other direction"])
def test_a_reading_is_solved_from_the_file_with_its_numbers_held(name: str) -> None:
    """There V is that of the noise, where the fit of the responses as read is far beyond it."""
    case, seen = true_case(), list[tuple[float, float, float]]()

    def probe(indices: list[ModificationIndex], evidence: Evidence, _: Scores) -> list[ModificationIndex]:
        fit, x = evidence.optimum.fit, evidence.assembly.parameters.x
        evaluated, costs = evaluate(fit, x), np.arange(len(fit.parts), dtype=float)
        reading = next(reading for reading in readings(evaluated, costs) if name in reading.name)
        there, start = _from_the_file(reading, evidence)
        free = np.ones(len(x), dtype=bool)
        began = predict(reading, evaluate(there, start), there.prior_slopes, free).before
        seen.append((began, settle(reading, there, start, free)[0], there.problem.dof))
        return indices

    robot = replace(case.robot, tolerances=Tolerances())
    data = misread(name, drawn(case, np.random.default_rng(0)))
    result = identify(data, robot, SPEC, hypotheses=(Hypothesis("probe", ("*",), search=probe),))
    began, ended, dof = seen[0]
    assert result.cost > 10 * result.cost_expected
    assert ended <= began
    assert ended == pytest.approx(dof, rel=0.15)
