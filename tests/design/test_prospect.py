"""What is said before the robot moves: a motor that friction holds."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from elastid.design.design import sticking
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
