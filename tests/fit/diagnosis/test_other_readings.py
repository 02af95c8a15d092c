"""Studies that are far off: a sampling rate by factors, an inertia of a motor by orders of magnitude."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plants.faults import SPEC, drawn, true_case

from elastid.fit.identify import identify
from elastid.response import Covariance, Response


def at_stated_rate(response: Response, e: float) -> Response:
    """As it is read from logs of positions whose rate is e times the stated one."""
    assert response.total is not None
    total = Covariance(response.total.variance / e**4, response.total.dof)
    return replace(response, freq_hz=response.freq_hz / e, G=response.G / e**2, total=total)


@pytest.mark.slow
@pytest.mark.parametrize("e", [2.0, 0.1])
def test_a_sampling_rate_that_is_off_by_a_factor_is_not_believed(e: float) -> None:
    """Twice it, or logs of every tenth sample."""
    case = true_case()
    data = [at_stated_rate(G, e) for G in drawn(case, np.random.default_rng(0))]
    assert identify(data, case.robot, SPEC).status == "model_error"


@pytest.mark.slow
@pytest.mark.parametrize(("names", "factor"), [(("Jm_1",), 0.1), (("Jm_1", "Jm_2"), 1e-4)])
def test_an_inertia_of_a_motor_that_is_far_off_is_not_believed(names: tuple[str, ...], factor: float) -> None:
    """A tenth of it, or all in g m^2 times ten."""
    case = true_case()
    known = case.robot.parameters()
    wrong = case.robot.with_parameters({name: factor * known[name][0] for name in names})
    data = drawn(case, np.random.default_rng(0))
    alone = [replace(G, noise=G.total, total=None) for G in data]
    result, of_one = (identify(responses, wrong, SPEC) for responses in (data, alone))
    assert result.status == of_one.status == "model_error"
    assert of_one.notes[0].code == "nonlinear/friction-left"  # one realisation does not show the motors' friction
    assert "nonlinear/friction-left" not in {note.code for note in result.notes}


@pytest.mark.slow
def test_angles_of_an_axis_that_are_off_in_every_posture_are_named_together() -> None:
    """By -2.5, 3 and -2 deg, more than one axis' zero: all three to 0.6 deg, and no two robots."""
    case, off = true_case(), np.radians([-2.5, 3.0, -2.0])
    data = [
        replace(G, configuration=replace(G.configuration, angles=tuple(np.array(G.configuration.angles) - (0.0, by))))
        for G, by in zip(drawn(case, np.random.default_rng(0)), off, strict=True)
    ]
    result = identify(data, case.robot, SPEC)
    first = result.indices[0]
    assert first.name == "angles_2"
    assert first.steps == pytest.approx(off, abs=np.radians(0.6))
    assert not any(note.code == "fit/unlike-responses" for note in result.notes)


@pytest.mark.slow
def test_torques_that_read_more_in_one_posture_are_named() -> None:
    """4 % in c2, to 0.5 %."""
    case = true_case()
    data = drawn(case, np.random.default_rng(0))
    data[1] = replace(data[1], G=data[1].G / 1.04)
    first = identify(data, case.robot, SPEC).indices[0]
    assert first.name == "torques@c2"
    assert first.steps[0] == pytest.approx(np.log(1.04), abs=0.005)
