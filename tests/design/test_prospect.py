"""What is said before the robot moves: a motor that friction holds, a motion that leaves the posture."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elastid.design.design import moved_posture_notes, sticking
from elastid.design.problem import DesignProblem
from elastid.experiment.plan.plan import make_plan
from elastid.experiment.specs.simulated import CarrierSpec
from elastid.study import load


@pytest.mark.parametrize(("coulomb", "words"), [(0.02, 0), (0.05, 1), (0.5, 1)])
def test_coulomb_friction_beyond_a_third_of_the_rms_torque_is_reported(tiny: Path, coulomb: float, words: int) -> None:
    """On the link side: half of it behind a gear of 2; 0.1 Nm rms, in two realisations and two configurations."""
    study = load(tiny).study
    assert study.excitation is not None
    plan = make_plan(study.excitation, study.experiment, study.robot, 0)
    body = study.robot.bodies[0]
    joint = body.joints[0]
    assert joint.motor is not None
    geared = replace(joint, motor=replace(joint.motor, ratio=-2.0, coulomb=coulomb / 2))
    robot = replace(study.robot, bodies=(replace(body, joints=(geared,)),))
    assert [note.code for note in sticking(plan, robot, None)] == words * ["design/sticking-motor"]
    assert not sticking(plan, robot, CarrierSpec(amplitude=0.1))


@pytest.mark.parametrize(("torque", "words"), [(45.0, 0), (1500.0, 1)])
def test_a_motion_that_would_move_a_stiffness_by_its_deviation_is_told(torque: float, words: int) -> None:
    """Of the linkage, whose rod feels it first: the planned motion of the motors goes with the torque."""
    study = load(Path(__file__).parents[2] / "configs" / "linkage_arm.yml").study
    assert study.excitation is not None
    excitation = replace(study.excitation, torque_rms=(torque, torque), band_hz=(2.0, 60.0))
    postures = {name: study.experiment.configurations[name] for name in ("c1", "c2", "c4")}
    experiment = replace(study.experiment, configurations=postures)
    problem = DesignProblem(study.as_robot(), excitation, experiment, study.fit, "acceleration", 1)
    x, within = problem.parameters.x, problem.fitted(problem.plan(experiment))
    expected = [prospect.expected(c, x, M) for prospect, c, M in within]
    notes = moved_posture_notes(within, expected, x)
    assert len(notes) == words
    if notes:
        assert "k_rod off by" in notes[0].text
    prospect, configuration, _ = within[1]
    motion = prospect.motor_motion(configuration, x)
    np.testing.assert_allclose(motion.rms / torque, [9.2e-6, 1.77e-5], rtol=0.02)
