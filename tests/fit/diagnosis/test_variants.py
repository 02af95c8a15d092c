"""Robots mounted otherwise, or read otherwise, than their files have them: found by a fit, not by a held number."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
from plants.faults import SPEC, drawn, exact, true_case
from plants.measured_robots import responses_of

from elastid.fit.identify import identify
from elastid.fit.result import ModificationIndex
from elastid.fit.spec import WeightSpec
from elastid.response import Covariance, Response
from elastid.robot import Payload, Robot, Tolerances
from elastid.study import load


@pytest.mark.slow
def test_a_robot_on_the_ceiling_is_named() -> None:
    """Gravity along +z in the truth; the first cause and the first sentence agree."""
    case = true_case()
    hanging = replace(case.truth, gravity=(0.0, 0.0, 9.81))
    result = identify(drawn(replace(case, responses=exact(hanging)), np.random.default_rng(0)), case.robot, SPEC)
    first = result.indices[0]
    assert first.name == "gravity along +z of the base"
    assert first.share > 0.9
    sentence = next(note.text for note in result.notes if note.code == "fit/likely-cause")
    assert sentence.startswith("gravity along +z of the base instead of the file's")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("stated", "name"),
    [
        (np.degrees, "angles of all configurations in degrees, read as radians"),
        (lambda q: q * (1, -1), "angle of axis 2 counted in the other direction in all configurations"),
        (lambda q: q[::-1], "angles of axes 1 and 2 exchanged in all configurations"),
    ],
)
def test_angles_in_another_unit_direction_or_order_are_named(
    stated: Callable[[np.ndarray], Iterable[float]], name: str
) -> None:
    """Of all configurations; the first cause explains 99 % of the excess."""
    case = true_case()
    data = [
        replace(G, configuration=replace(G.configuration, angles=tuple(stated(np.array(G.configuration.angles)))))
        for G in drawn(case, np.random.default_rng(0))
    ]
    first = identify(data, case.robot, SPEC).indices[0]
    assert first.name == name
    assert first.share > 0.99


@pytest.mark.slow
def test_inertias_of_motors_on_the_link_side_are_named() -> None:
    """The file has n^2 times the inertias of the motors, as referred through their gears."""
    case = true_case()
    numbers = case.robot.parameters()
    given = {f"Jm_{j.name}": numbers[f"Jm_{j.name}"][0] * case.robot.ratio(j.name) ** 2 for j in case.robot.driven}
    first = identify(drawn(case, np.random.default_rng(0)), case.robot.with_parameters(given), SPEC).indices[0]
    assert first.name == "inertias of all motors given on the link side, or in kg cm^2"
    assert first.share > 0.99


def first_of_demo(change: Callable[[Robot], Robot], seed: int) -> tuple[ModificationIndex, Robot]:
    """The first cause where the demo's arm was measured as changed, and its file with the common tolerances."""
    study = load(Path(str(files("elastid"))) / "app" / "templates" / "serial" / "study.yml").study
    assert study.robot is not None
    postures, rng, lines = study.experiment.configurations, np.random.default_rng(seed), np.linspace(2, 60, 40)
    responses = responses_of(change(study.robot), postures, rng, lines, 0.005, 0.0, spec=study.model)
    spec = replace(study.fit, weights=WeightSpec(floor=0.0), criterion="complex", seed=1, starts=2)
    robot = replace(study.robot, tolerances=Tolerances())
    return identify(responses, robot, spec, model=study.model).indices[0], robot


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 3])
def test_a_load_beyond_a_linear_step_is_found_where_the_file_has_tolerances(seed: int) -> None:
    """5 kg at the end of the demo's fore arm of 75 kg are the first cause; mass within 0.5 kg, place within 60 mm."""
    load = Payload(5.0, (0.9, 0.1, 0.15), 0.05, "fore_arm")
    first, robot = first_of_demo(lambda robot: replace(robot, payload=load), seed)
    change = dict(zip(first.members, first.steps.tolist(), strict=True))
    m, c = robot.bodies[-1].mass, np.array(robot.bodies[-1].center_of_mass)
    mass = m * np.expm1(change["m_fore_arm"])
    place = c + (m + mass) / mass * np.array([change[f"c_fore_arm_{axis}"] for axis in "xyz"])
    assert first.name == "payload_fore_arm"
    assert first.share > 0.95
    assert mass == pytest.approx(load.mass, abs=0.5)
    np.testing.assert_allclose(place, load.center_of_mass, atol=0.06)


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
