"""The references on an arm that is written down again for MuJoCo, whose dynamics share no code with ours."""

import numpy as np
import pytest
from plants.commanded_arm import arm, move

from elastid.base.arrays import FloatArray
from elastid.record import JointLoop
from elastid.simulation.controller import tune
from elastid.use.commanded_robot import CommandedRobot
from elastid.use.moves import MotionLimits, References
from elastid.use.trajectory_optimisation import plan, rigid_references, sample_plan

mujoco = pytest.importorskip("mujoco", reason="mujoco is in the group oracles")
pytestmark = pytest.mark.oracle

# Springs of 0.8 times the catalogue's; motors of 2e-3 kg m^2 and 1e-3 Nms/rad behind gears of 100 turn for themselves.
XML = """
<mujoco>
  <option timestep="1e-4" integrator="implicit" gravity="0 0 -9.81"/>
  <compiler angle="radian" inertiafromgeom="false" autolimits="false"/>
  <worldbody>
    <body name="m1"><joint name="m1" type="hinge" axis="0 0 1" damping="10"/>
      <inertial pos="0 0 0" mass="1" diaginertia="20 20 20"/></body>
    <body name="m2"><joint name="m2" type="hinge" axis="0 1 0" damping="10"/>
      <inertial pos="0 0 0" mass="1" diaginertia="20 20 20"/></body>
    <body name="upper"><joint name="q1" type="hinge" axis="0 0 1"/>
      <inertial pos="0.3 0 0" mass="20" diaginertia="1 1 1"/>
      <body name="fore" pos="0.6 0 0"><joint name="q2" type="hinge" axis="0 1 0"/>
        <joint name="q2z" type="hinge" axis="0 0 1" stiffness="16000" damping="20"/>
        <inertial pos="0.3 0 0.02" mass="12" diaginertia="0.5 0.5 0.5"/>
        <site name="tool" pos="0.6 0 0"/></body></body>
  </worldbody>
  <tendon>
    <fixed name="g1" stiffness="48000" damping="80" springlength="0"><joint joint="m1" coef="1"/>
      <joint joint="q1" coef="-1"/></fixed>
    <fixed name="g2" stiffness="32000" damping="60" springlength="0"><joint joint="m2" coef="1"/>
      <joint joint="q2" coef="-1"/></fixed>
  </tendon>
</mujoco>
"""


def errors(references: References, gains: JointLoop, target: FloatArray) -> FloatArray:
    """Distance (N,) of the tool from its path, from the rest into which the loops have let it settle."""
    model = mujoco.MjModel.from_xml_string(XML)
    data = mujoco.MjData(model)
    names = ("m1", "m2")
    dof = [model.joint(name).dofadr[0] for name in names]
    steps = round(1 / references.rate_hz / 1e-4)
    for name, angle in zip((*names, "q1", "q2"), np.tile(references.position[0], 2), strict=True):
        data.qpos[model.joint(name).qposadr[0]] = angle
    away = []
    for k in [0] * 1000 + [*range(len(target))]:
        if k or away:
            mujoco.mj_forward(model, data)
        away.append(float(np.linalg.norm(data.site("tool").xpos - target[k])))
        error = gains.kp * (references.position[k] - data.qpos[dof])
        error += gains.kd * (references.velocity[k] - data.qvel[dof])
        data.qfrc_applied[dof] = references.torque[k] + error
        for _ in range(steps):
            mujoco.mj_step(model, data)
    return np.array(away[1000:])


def test_another_engine_follows_more_exactly_than_with_rigid_feedforward() -> None:
    """Largest error in the move, and vibration after it."""
    own, true = move(0.8), arm(stiffness=0.8, friction=0.0)
    commanded = CommandedRobot.of(true, "tool", own.ends[0])
    elastic = sample_plan(commanded, plan(commanded, own, MotionLimits.of(true), 0.1), 500.0, 0.4)
    rigid, after = rigid_references(true, commanded, own, elastic.time_s), elastic.time_s > own.duration
    target = commanded.poses(commanded.rigid(own, elastic.time_s)[0]).position
    gains = tune(commanded.model, commanded.rigid_posture(own.ends[0]), 4.0, 0.7)
    by_rigid, by_elastic = (errors(references, gains, target) for references in (rigid, elastic))
    assert by_elastic.max() < by_rigid.max() / 10
    assert np.ptp(by_elastic[after]) < np.ptp(by_rigid[after]) / 3
