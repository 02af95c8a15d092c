"""Stiffness, damping and the delay of the commands from references and encoders alone, without any torque."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from plants.commanded_arm import arm
from plants.paths import ROBOTS
from plants.referenced_joint import ReferencedJoint
from plants.referenced_robot import write

from elastid import choose, identify
from elastid.app import cli
from elastid.fit.result import Result
from elastid.store.measured import read_responses
from elastid.store.results import read_fit
from elastid.study import load_robot

LINKAGE = ROBOTS / "irb4400_linkage.yml"
JOINT = ReferencedJoint(delay_s=0.0073)
GAINS = {f"gain_{gain}_motor_1": {"prior": {"std": 0.2}} for gain in ("kp", "kd")}


def fitted(study: Path, monkeypatch: pytest.MonkeyPatch, stages: tuple[str, ...] = ()) -> Result:
    """Result of a study, whose run stands beside it."""
    monkeypatch.chdir(study.parent)
    for stage in stages or ("measure", "estimate", "fit"):
        cli.run_command(["run", study.name, stage])
    return read_fit(study.parent / "runs" / "referenced" / "fit.h5")


def assert_within(result: Result, **truth: float) -> None:
    """Estimates are at most four standard deviations from true numbers."""
    x = dict(
        zip(result.parameters.free_names, zip(result.x, np.sqrt(np.diag(result.covariance)), strict=True), strict=True)
    )
    for name, value in truth.items():
        assert abs(x[name][0] - result.parameters[name].to_x(value)) < 4 * x[name][1], name


@pytest.mark.slow
@pytest.mark.parametrize("delay_s", [0.0, 0.0043, 0.02])
@pytest.mark.parametrize(("kp", "kd", "k"), [(400.0, 20.0, 500.0), (900.0, 45.0, 8000.0)])
def test_numbers_from_references_are_true(
    delay_s: float, kp: float, kd: float, k: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Stiffness within 1 %, damping 5 %, inertia 2 %, delay within 0.1 ms, all within 4 std; status converged."""
    plant = ReferencedJoint(k=k, kp=kp, kd=kd, delay_s=delay_s)
    result = fitted(plant.write(tmp_path / "a", Jm_1={}), monkeypatch)
    values = result.parameters.as_dict(result.x)
    assert result.status == "converged"
    assert values["k_1"] == pytest.approx(plant.k, rel=0.01)
    assert values["d_1"] == pytest.approx(plant.d, rel=0.05)
    assert values["Jm_1"] == pytest.approx(plant.motor, rel=0.02)
    assert values["delay_r"] == pytest.approx(delay_s, abs=1e-4)
    truth = {"k_1": plant.k, "d_1": plant.d, "fm_1": plant.fm, "Jm_1": plant.motor, "delay_r": delay_s}
    assert_within(result, **truth)


@pytest.mark.slow
def test_wrong_delay_is_a_misfit_whose_cause_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A stated delay that is 2.3 ms off: status misfit, and the first cause is a delay of the references."""
    result = fitted(JOINT.write(tmp_path / "a", delay_r={"start": 0.005, "fixed": True}), monkeypatch)
    assert result.status == "misfit"
    cause = max(result.indices, key=lambda index: index.explained_fraction)
    assert cause.name == "delay_r"
    assert cause.steps[0] == pytest.approx(0.0023, rel=0.05)


@pytest.mark.slow
def test_wrong_gains_are_a_misfit_or_identified(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Gains that are 20 % off the stated ones: status misfit; as parameters they are found."""
    stated = JOINT.kp / 1.2, JOINT.kd / 1.2
    assert fitted(JOINT.write(tmp_path / "a", stated=stated), monkeypatch).status in ("misfit", "model_error")
    result = fitted(JOINT.write(tmp_path / "b", stated=stated, **GAINS), monkeypatch)
    assert result.status == "converged"
    truth = {"k_1": JOINT.k, "d_1": JOINT.d, "delay_r": JOINT.delay_s} | dict.fromkeys(GAINS, 1.2)
    assert_within(result, **truth)


@pytest.mark.slow
def test_wrong_damping_gain_moves_viscous_friction_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A k_d that is 20 % off and viscous friction are alike: stiffness, damping and delay stay within 4 std."""
    result = fitted(JOINT.write(tmp_path / "a", stated=(JOINT.kp, JOINT.kd / 1.2)), monkeypatch)
    truth = {"k_1": JOINT.k, "d_1": JOINT.d, "delay_r": JOINT.delay_s}
    assert_within(result, **truth)
    assert result.parameters.as_dict(result.x)["fm_1"] == pytest.approx(JOINT.fm + JOINT.kd / 6, rel=0.05)
    value, half = combination(result)
    assert abs(value - JOINT.fm - JOINT.kd) < 2 * half


@pytest.mark.slow
def test_torques_and_references_in_one_fit_identify_gains_and_friction(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Gains that are 20 % off: references alone know k_d + f, with torques of other records each is known to 1 %."""
    stated = JOINT.kp / 1.2, JOINT.kd / 1.2
    responses = []
    for name, options in (("a", {"torque": True, "seed": 5}), ("b", {"stated": stated})):
        study = JOINT.write(tmp_path / name, **options)
        monkeypatch.chdir(study.parent)
        for stage in ("measure", "estimate"):
            cli.run_command(["run", study.name, stage])
        (response,) = read_responses(study.parent / "runs" / "referenced" / "frf.h5")
        responses.append(replace(response, configuration=replace(response.configuration, name=name)))
    robot = load_robot(tmp_path / "a" / "robot.yml")
    parameters = choose(robot, "k_1", "d_1", "fm_1", "delay_r", *GAINS)
    result = identify(responses, robot, parameters, starts=2, profile=[])
    assert result.status == "converged"
    truth = {"k_1": JOINT.k, "d_1": JOINT.d, "fm_1": JOINT.fm, "delay_r": JOINT.delay_s} | dict.fromkeys(GAINS, 1.2)
    assert_within(result, **truth)
    assert max(result.std[name] for name in GAINS) < 0.01
    alone = identify(responses, robot, choose(robot, "k_1", "d_1", "fm_1"), starts=2, profile=[])
    assert alone.status in ("misfit", "model_error")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "postures"),
    [
        ("extended joint", {"a": [0.0, 0.4], "b": [0.5, -0.6]}),
        ("linkage", {"a": [0.0, 0.2, -0.1], "b": [0.4, -0.4, 0.3], "c": [-0.3, 0.7, 0.1]}),
    ],
)
def test_numbers_of_arms_from_references_are_true(
    name: str, postures: dict[str, list[float]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An elastic joint without a motor, and a closed loop: all numbers within 4 std; stiffness 0.5 %, delay 1 us."""
    robot = arm(friction=0.0) if name == "extended joint" else load_robot(LINKAGE)
    result = fitted(write(tmp_path / "a", robot, postures, 0.006), monkeypatch)
    assert result.status == "converged"
    truth = {n: robot.parameters()[n][0] for n in result.parameters.free_names if n != "delay_r"} | {"delay_r": 0.006}
    assert_within(result, **truth)
    values = result.parameters.as_dict(result.x)
    assert all(values[n] == pytest.approx(truth[n], rel=5e-3) for n in truth if n.startswith("k_"))
    assert values["delay_r"] == pytest.approx(0.006, abs=1e-6)


def combination(result: Result) -> tuple[float, float]:
    """The sum of velocity gain and viscous friction, and half its interval, as noted."""
    (text,) = (note.text for note in result.notes if note.code == "fit/combination" and "ratio^2 fm" in note.text)
    value, half = re.search(r"([\d.]+) \+- ([\d.]+) \S+ \(motor 1\)", text).groups()
    return float(value), float(half)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("plant", "options"),
    [
        (ReferencedJoint(forward=0.5, delay_s=0.0034), {"every": 4}),
        (ReferencedJoint(delay_s=0.0034), {"sensor": "joint 1"}),
        (ReferencedJoint(exact_velocity=True), {}),
        (ReferencedJoint(forward=0.5, delay_s=0.006, cycle=4), {}),
        (ReferencedJoint(forward=0.5, delay_s=0.006, cycle=4, is_linear=True), {}),
        (ReferencedJoint(forward=0.5, delay_s=0.006, cycle=4, is_linear=True), {"target": True}),
    ],
)
def test_forms_of_logs_are_exact(
    plant: ReferencedJoint, options: dict[str, object], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Logs slower than the controller, angles behind the gear, exact velocities, references every 4 ms: no bias."""
    result = fitted(plant.write(tmp_path / "a", noise=1e-10, **options), monkeypatch)
    values = result.parameters.as_dict(result.x)
    assert result.status == "converged"
    assert values["k_1"] == pytest.approx(plant.k, rel=1e-4)
    assert values["d_1"] == pytest.approx(plant.d, rel=1e-3)
    assert values["delay_r"] == pytest.approx(plant.delay_s, abs=1e-6)


def test_check_accepts_references_of_a_known_controller(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """`elastid check` accepts the study; without a robot or controller it asks for torques."""
    study = JOINT.write(tmp_path / "a", logs=1)
    monkeypatch.chdir(study.parent)
    assert cli.run_command(["check", study.name]) == 0
    content = yaml.safe_load(study.read_text())
    del content["experiment"]["recorded"]["controller"]
    study.write_text(json.dumps(content))
    assert cli.run_command(["check", study.name]) == 2
