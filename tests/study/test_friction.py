"""Friction, drives and the measurement chain as a study gives them: read, simulated, identified, refused."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from plants.refusals import refused

from elastid.app.console import Console
from elastid.app.identified_robot import truth
from elastid.app.run import Run, run_all
from elastid.design.design import sticking
from elastid.experiment.plan.plan import make_plan
from elastid.friction.dynamic import Bristle
from elastid.friction.robot_friction import frictions
from elastid.study import load

FRICTION = """\
        friction:
          coulomb: 4 mN*m
          stiction: 6 mN*m
          stribeck_velocity: 0.05
          quadratic: 1e-6 N*m*s^2/rad^2
          exponent: 1.4
          load: {coulomb: 0.01, stiction: 0.02, stribeck_velocity: 0.2}
          directions: {coulomb: 0.1 mN*m, viscous: 1e-5}
          measured: {speed: [0, 20], load: [0, 5 N*m], temperature: [20, 60 degC]}
          temperature: {reference: 25 degC, stiction: 1e-5 N*m/K, viscous: 1e-4, decay: 20 K}
          lugre: {stiffness: 20, damping: 1e-3, damping_velocity: 2}
"""
MOTOR = "{inertia: 1e-3, ratio: 1, viscous: 1e-3}"
RIG = """\
    controller: {kind: cascade, bandwidth_hz: 1.5, integral_time: 0.4}
    saturation: true
    torque_ripple: [{amplitude: 1e-4, periods: 6, phase: 30 deg}]
    carrier: {amplitude: 5 deg, cycles: 4}
    substeps: 4
"""


def rewritten(study: Path, robot: tuple[str, str] = ("", ""), rig: str = "", extra: str = "") -> Path:
    """The tiny study with a piece of its robot replaced, keys added to its rig and to its robot."""
    path = study.parent / "robot.yml"
    text = path.read_text()
    assert robot[0] in text
    path.write_text(text.replace(*robot, 1) + extra)
    assert "    noise:" in study.read_text()
    study.write_text(study.read_text().replace("    noise:", rig + "    noise:"))
    return study


def lugre_robot() -> tuple[str, str]:
    """The tiny robot's motor in lines of its own, with friction under it."""
    law = "".join("  " + line + "\n" for line in FRICTION.splitlines())
    return f"motor: {MOTOR}\n", "motor:\n          inertia: 1e-3\n          viscous: 1e-3\n" + law


@pytest.mark.slow
def test_a_study_with_lugre_friction_and_a_lag_finds_stiffness_and_lag(tiny: Path) -> None:
    """From YAML to the interval: the joint slides under its carrier; the rig lags, ripples and warms."""
    study = rewritten(tiny, lugre_robot(), RIG, "chain: {torque_lag: 1 ms}\n")
    text = study.read_text().replace("truth: {k_1: 60 N*m/rad}", "truth: {k_1: 60 N*m/rad, torque_lag: 2 ms}")
    text = text.replace("    d_1: {}", "    d_1: {}\n    fm_1: {}\n    torque_lag: {}")
    study.write_text(text.replace("torque_rms: 0.1", "torque_rms: 0.05"))
    path = study.parent / "robot.yml"
    path.write_text(
        path.read_text().replace("limits: {angle: [-90 deg, 90 deg]}", "limits: {torque: 1, angle: [-2, 2]}")
    )
    loaded = load(study)
    (law,) = frictions(loaded.study.robot)
    assert law.law == Bristle(20.0, 1e-3, 0.5)
    assert "fm_1" not in (
        truth(loaded.study.as_robot(), loaded.study.experiment.simulated, loaded.study.fit.parameters) or {}
    )
    run_all(Run(loaded, study.parent / "run", 1, Console(-1)))
    summary = json.loads((study.parent / "run" / "summary.json").read_text())
    found = summary["parameters"]
    # Warm and loaded, 4 to 6 mNm; a bristle longer than the motion would be a spring of the robot.
    assert 3e-3 < summary["friction"][0]["F_c"] < 8e-3
    assert found["k_1"]["value"] == pytest.approx(60, rel=0.01)
    assert found["torque_lag"]["value"] == pytest.approx(2e-3, rel=0.03)
    assert found["torque_lag"]["unit"] == "s"


def test_sticking_is_told_for_every_law(tiny: Path) -> None:
    """LuGre's Coulomb level against the rms torque."""
    robot = lugre_robot()
    law = robot[1].replace("coulomb: 4 mN*m", "coulomb: 0.1").replace("stiction: 6 mN*m", "stiction: 0.2")
    study = load(rewritten(tiny, (robot[0], law))).study
    assert study.excitation is not None
    plan = make_plan(study.excitation, study.experiment, study.robot, 0)
    (note,) = sticking(plan, study.robot, None)
    assert "motor 1: its Coulomb friction (0.1 N*m) is more than a third" in str(note)


@pytest.mark.parametrize(
    ("key", "word"),
    [
        ("saturaton: true", "did you mean 'saturation'?"),
        ("controller: {kind: pid}", "expected one of pd, cascade"),
        ("controller: {kind: cascade, integral_time: -1}", "integral_time is -1 s"),
        ("torque_ripple: [{amplitude: 1, periods: 0}]", "at least 1"),
    ],
)
def test_wrong_hardware_is_refused_at_its_line(tiny: Path, key: str, word: str) -> None:
    with refused("study/invalid", holds=(word, "study.yml:")):
        load(rewritten(tiny, rig=f"    {key}\n"))
