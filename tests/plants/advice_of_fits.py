"""Cases of advice in messages of fits: responses of a robot that is off its file, or a fit that cannot be."""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np

from elastid.app import cli
from elastid.base.arrays import ComplexArray, FloatArray
from elastid.fit.checks import find_dependence_on_amplitude
from elastid.fit.diagnosis import hypothesis
from elastid.fit.diagnosis.hypotheses import HYPOTHESES
from elastid.fit.identify import identify
from elastid.fit.result import ModificationIndex
from elastid.fit.spec import ParameterSpec
from elastid.model.formulation import EXACT, formulate
from elastid.report.content import parameter_rows
from elastid.report.overview import next_steps
from elastid.response import BENT
from elastid.robot import Robot
from elastid.store.measured import read_responses, write_responses
from elastid.study import load, load_robot
from elastid.study.reference import words_in
from plants.advice import Desk, case, keys, pasted, refusal, rendered, value_of
from plants.report_values import fit_result
from plants.two_axes import ROBOT, STUDY, measured

FREE = "fit.parameters={k_*: {}, d_*: {}}"


def fitted(desk: Desk, *overrides: str) -> tuple[int, str]:
    """Exit code and words of a fit of the responses in the folder."""
    sets = [word for override in ("fit.starts=1", *overrides) for word in ("--set", override)]
    study, run = str(desk.folder / "study.yml"), str(desk.folder / "run")
    return desk.said("fit", study, "--run", run, "--jobs", "1", *sets)


def responses_of(desk: Desk, *truth: str, noise: float = 0.02) -> None:
    """Responses in the folder, of the study's robot with some of its numbers changed."""
    study = Path(desk.write(study=STUDY, robot=ROBOT))
    measured(study, load(study, truth).study.robot, noise=noise)


@case("fit/checks.py", "fit.parameters: {‹›: {fixed: true}}", slow=True)
def without_effect(desk: Desk) -> None:
    responses_of(desk)
    fault = "fit.parameters={k_*: {}, p_upper_z: {}}"
    text = rendered("fit.parameters: {‹›: {fixed: true}}", fitted(desk, fault)[1])
    (name,) = re.findall(r"\{(\w+): \{fixed", text)
    assert "without effect" not in fitted(desk, fault, f"fit.parameters.{name}={{fixed: true}}")[1]


@case("fit/checks.py", "fit.parameters: {‹›}", "fixed: true", "prior: {std: 0.05}}", slow=True)
def without_scale(desk: Desk) -> None:
    responses_of(desk)
    fault = "fit.parameters={k_*: {}, gain_u_motor_1: {}, gain_u_motor_2: {}, gain_y_motor_1: {}, gain_y_motor_2: {}}"
    said = fitted(desk, fault)[1]
    priors = re.findall(r"(\w+): (\{prior: \{std: 0.05\}\})", rendered("fit.parameters: {‹›} for", said))
    assert priors
    assert rendered("fixed: true", said)
    for known in ([f"fit.parameters.{name}={prior}" for name, prior in priors],
                  [f"fit.parameters.{name}={{fixed: true}}" for name, _ in priors]):  # fmt: skip
        assert fitted(desk, fault, *known)[0] == 0


@case("fit/problem/weights.py", "fit.weights.covariance: diagonal")
def singular_covariance(desk: Desk) -> None:
    from fit.problem.test_full_covariance import FULL, correlated, weigh

    response = correlated(np.random.default_rng(4), "kronecker")
    right = np.array(response.noise.right)
    right[7, 1], right[7, :, 1] = right[7, 0], right[7, :, 0]
    right[7, 1, 1] = right[7, 0, 0]
    variance = np.einsum("faa->fa", right).real[:, :, None] * np.ones(2)
    singular = replace(response, noise=replace(response.noise, right=right, variance=variance))
    text = rendered("fit.weights.covariance: diagonal", refusal(lambda: weigh(singular, FULL)))
    study = load(Path(desk.write(study=STUDY, robot=ROBOT)), [pasted(text), "fit.weights.floor=0"]).study
    assert refusal(lambda: weigh(singular, study.fit)) == ""


@case(
    "fit/diagnosis/hypothesis.py",
    "fit.parameters: {{{name}: {{prior: {{std: {usual:g}}}}}}}",
    "fit.parameters: {{{name}: {{start: {start:.2g}}}}}",
)
def freed_number(desk: Desk) -> None:
    """Every number of the robot, and factors of inertias, as a message names them: the study takes what it says."""
    study = Path(desk.write(study=STUDY, robot=ROBOT))
    robot = load(study).study.robot
    model: Any = SimpleNamespace(linearisation=SimpleNamespace(model=formulate(robot, EXACT)))
    evidence: Any = SimpleNamespace(hypotheses=HYPOTHESES, result=None, assembly=model)
    factors = {f"I_{body.name}": (1.0, "1") for body in robot.bodies if len(body.inertia_entries) > 1}
    assert factors
    starts = 0
    for name, (value, unit) in (robot.parameters() | factors).items():
        family = hypothesis.hypothesis_of(name, HYPOTHESES).family
        index = ModificationIndex(
            name=name, group=family, members=(name,), values=np.array([value]), units=(unit,), log=(value > 0,),
            steps=np.array([0.1]), std=0.1, drop=9.0, share=0.5, effects=np.zeros(1),
        )  # fmt: skip
        said = hypothesis._advice(index, evidence)
        key, _, entry = said.partition("fit.parameters: {")[2].partition(": ")
        override = f"fit.parameters.{key}={entry.removesuffix(')').removesuffix('}')}"
        assert refusal(lambda override=override: load(study, [override])) == "", said
        starts += "start" in entry
    assert starts > 0


def spoilt(desk: Desk, factor: Callable[[FloatArray], ComplexArray]) -> None:
    """Responses in the folder, each times a factor over frequency."""
    study = Path(desk.write(study=STUDY, robot=ROBOT))
    run = measured(study, load(study).study.robot)
    read = read_responses(run.path("estimate"))
    spoilt = [replace(each, G=each.G * factor(each.freq_hz)[:, None, None]) for each in read]
    write_responses(run.path("estimate"), spoilt, run.stamps["estimate"])


@case("fit/diagnosis/phrases.py", "fit.parameters: {delay: {}}", slow=True)
def late_torque(desk: Desk) -> None:
    spoilt(desk, lambda f: np.exp(-2j * np.pi * f * 2e-3))
    text = rendered("fit.parameters: {delay: {}}", fitted(desk, FREE)[1])
    assert text == "fit.parameters: {delay: {}}"
    assert fitted(desk, FREE, "fit.parameters.delay={}")[0] == 0


@case("fit/diagnosis/hypothesis.py", "fit.parameters: {fm_*: {}}", slow=True)
def friction_of_motors(desk: Desk) -> None:
    """Of a robot whose file has none, as data sheets have."""
    without = re.sub(r", viscous: [\d.]+", "", ROBOT)
    study = Path(desk.write(study=STUDY, robot=without))
    truth = replace_viscous(load(study).study.robot, 0.2)
    measured(study, truth)
    text = rendered("fit.parameters: {fm_*: {}}", fitted(desk, FREE)[1])
    assert text == "fit.parameters: {fm_*: {}}"
    assert fitted(desk, FREE, "fit.parameters.fm_*={}")[0] == 0


def replace_viscous(robot: Robot, viscous: float) -> Robot:
    """The robot with viscous friction of its motors, Nms/rad on their side."""
    motors = {joint.name: joint.motor for joint in robot.driven if joint.motor is not None}
    bodies = [
        replace(
            body,
            joints=tuple(
                replace(joint, motor=replace(motors[joint.name], viscous=viscous)) if joint.name in motors else joint
                for joint in body.joints
            ),
        )
        for body in robot.bodies
    ]
    return replace(robot, bodies=tuple(bodies))


@case("fit/diagnosis/phrases.py", "hold: zero-order", slow=True)
def held_torque(desk: Desk) -> None:
    """Responses to a torque that was held for 8 ms: so recorded logs say it, and so responses from elsewhere."""
    spoilt(desk, lambda f: np.sinc(f * 8e-3) * np.exp(-1j * np.pi * f * 8e-3))
    hold = value_of(
        rendered("hold: zero-order", fitted(desk, FREE)[1].replace("hold: zero-order in", "hold: zero-order"))
    )
    assert hold in words_in(next(key for key in keys()["hold"] if key.path == "experiment.recorded.hold").annotation)
    assert any(key.path == "experiment.responses.rate_hz" for key in keys()["rate_hz"])


@case("fit/diagnosis/phrases.py", "chain: {differentiator: ‹› ms}", slow=True)
def differenced_velocities(desk: Desk) -> None:
    """Responses by velocities that are differences over 8 ms, which act as a torque that is held so long.

    What the fit does with the key: tests/fit/diagnosis/test_response_columns.py.
    """
    spoilt(desk, lambda f: np.sinc(f * 8e-3) * np.exp(-1j * np.pi * f * 8e-3))
    text = rendered("chain: {differentiator: ‹› ms}", fitted(desk, FREE)[1])
    robot = desk.folder / "robot.yml"
    robot.write_text(f"{robot.read_text()}{text}\n")
    time = load_robot(robot).chain.differentiator
    assert time is not None
    assert abs(time / 8e-3 - 1) < 0.02


@case("fit/diagnosis/hypotheses.py", "estimator.friction: auto")
def friction_left_in_the_responses(desk: Desk) -> None:
    (advice,) = (each.advice for each in HYPOTHESES if each.family == "friction by posture")
    own = pasted(rendered("estimator.friction: auto", advice))
    loaded = load(Path(desk.write(study=STUDY, robot=ROBOT)), ["estimator.friction=none", own])
    assert loaded.study.estimator.friction == "auto"


@case("fit/diagnosis/hypotheses.py", "elastid compare --search judge it")
@case("fit/diagnosis/hypothesis.py", "elastid compare --search find which the data show")
@case("report/overview.py", "elastid compare STUDY --search")
def search_for_springs(desk: Desk) -> None:
    """As the command line reads it; tests/app/test_elasticity_search.py carries it out."""
    study = desk.write(study=STUDY, robot=ROBOT)
    given = cli.cli.commands["compare"].make_context("compare", [study, "--search"]).params
    assert given["search"] is True


@case("report/overview.py", "--set 'fit.parameters.‹›={prior: {std: ‹›}}'")
def prior_that_the_page_advises(desk: Desk) -> None:
    result, r = fit_result(), np.eye(4)
    r[0, 1] = r[1, 0] = -0.99
    std = np.array([0.1, 0.5, 0.01, 0.001])
    result = replace(result, covariance=r * np.outer(std, std), status="converged")
    texts = [action.text for action in next_steps(result, parameter_rows(result, {}, {})) if action.text]
    (text,) = (text for text in texts if text.startswith("--set"))
    assert desk.elastid("check", desk.write(study=STUDY, robot=ROBOT), *shlex.split(text)) == ""


@case("report/overview.py", "--set 'gears={}'")
def gears_that_the_page_advises(desk: Desk) -> None:
    said = f"{BENT} 1 is not straight: the numbers are those of this amplitude alone"
    result = replace(fit_result(), status="misfit", message=said)
    text = next_steps(result, parameter_rows(result, {}, {}))[0].text
    assert desk.elastid("check", desk.write(study=STUDY, robot=ROBOT), *shlex.split(text)) == ""


@case("fit/checks.py", "gears: {}")
def gears_where_responses_depend_on_amplitude(desk: Desk) -> None:
    from fit.test_checks import POSTURES, arm, measured

    responses = [measured(arm(), POSTURES[0], "a"), measured(arm(k_1=9e4), POSTURES[0], "a level 2")]
    advice = rendered("gears: {}", " ".join(map(str, find_dependence_on_amplitude(responses))))
    assert desk.elastid("check", desk.write(study=STUDY, robot=ROBOT), "--set", pasted(advice)) == ""


@case("fit/diagnosis/configurations.py", "per: robot", slow=True)
def two_robots_taken_for_one(desk: Desk) -> None:
    from fit.test_two_robots import ROBOTS, SPEC, A, arm, both

    responses = both(0, A, arm(k_1=3.9e4))
    plain = replace(SPEC, robots={}, parameters={}, seed=0)
    said = " ".join(map(str, identify(responses, arm(k_1=2.5e4), plain).notes))
    per = value_of(rendered("per: robot", said))
    named = replace(plain, robots=ROBOTS, parameters={"k_*": ParameterSpec(per=per), "d_*": ParameterSpec()})
    result = identify(responses, arm(k_1=2.5e4), named)
    assert "disagree" not in " ".join(map(str, result.notes))
