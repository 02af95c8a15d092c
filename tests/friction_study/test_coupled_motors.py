"""Friction of motors that gears couple with other joints: it acts at the speed of the shaft, not of the joint."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from plants.arm import RATIO
from plants.moving_arm import ARM, COULOMB, RATE, VISCOUS, motion

from elastid.base.arrays import FloatArray
from elastid.design.friction import design_friction
from elastid.experiment.simulated.friction_rig import SimulatedFrictionRig
from elastid.experiment.specs.channels import ChannelSpec
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.logs import FileSpec, RecordedSpec
from elastid.experiment.specs.simulated import SimulatedSpec
from elastid.friction_study.constant_velocity import estimate_friction_curve, passes_of
from elastid.friction_study.sliding_friction import SlidingFriction, identify_sliding_friction
from elastid.friction_study.spec import ConstantVelocitySpec, FrictionSpec
from elastid.logs.friction_logs import read_friction_logs
from elastid.robot import Limits, Motor
from elastid.robot.gears import GearCoupling
from elastid.robot.simplified import with_joints

# Half a turn of the second motor's gear for a turn of the first joint.
WRIST = replace(ARM, gears=(GearCoupling("2", "1", RATIO / 2),))
E = np.array([[1.0, 0.0], [0.5, 1.0]])
OF_JOINT = 3.0  # Nm, Coulomb friction of the second joint behind the coupling


def signals(seed: int) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Angles and torques (n, 2) of both joints, and of both motors by their own ratios."""
    log = motion(seed, noise=0.1)
    q, rigid = (np.stack([getattr(log[name], key) for name in "12"]) for key in ("position", "torque"))
    v = np.gradient(q, 1 / RATE, axis=1)
    F, f = np.array(COULOMB)[:, None], np.array(VISCOUS)[:, None]
    rigid = rigid - F * np.sign(v) - f * v + np.array([[0.0], [OF_JOINT]]) * np.sign(v)
    of_motors = F * np.sign(E @ v) + f * (E @ v)
    return q.T, (rigid + E.T @ of_motors).T, (E @ q).T, (np.linalg.inv(E).T @ rigid + of_motors).T


def friction_of(folder: Path, side: str) -> dict[str, SlidingFriction]:
    """Friction by motor, from two logs on one side of the gears."""
    for seed in (0, 1):
        q, tau, s, u = signals(seed)
        columns = np.hstack([u / RATIO, s * RATIO] if side == "motor" else [tau, q])
        np.savetxt(folder / f"{seed}.csv", columns, delimiter=",", header="u_1,u_2,q_1,q_2", comments="")
    channels = [
        ChannelSpec(role, f"motor {name}", f"{letter}_{name}", quantity=quantity, side=side)
        for name in "12"
        for role, letter, quantity in (("u", "u", "torque"), ("y", "q", "position"))
    ]
    spec = ExperimentSpec(recorded=RecordedSpec(RATE, tuple(channels), (FileSpec("0.csv"), FileSpec("1.csv"))))
    records = read_friction_logs(WRIST, spec, folder, ("1", "2"), {})
    return {joint.joint: joint for joint in identify_sliding_friction(WRIST, WRIST.driven, records)}


@pytest.mark.parametrize("side", ["motor", "link"])
def test_friction_of_coupled_motors_lies_within_intervals(side: str, tmp_path: Path) -> None:
    """Of friction at the joint's speed instead, 16 % of the second motor's torque would be left."""
    friction = friction_of(tmp_path, side)
    for i, name in enumerate("12"):
        motion_friction = friction[name].motion
        fit = motion_friction.regression
        assert abs(fit["coulomb"] - COULOMB[i]) < 3 * fit.std("coulomb")
        assert abs(fit["viscous"] - VISCOUS[i]) < 3 * fit.std("viscous")
        assert fit.std("coulomb") < 0.1 * COULOMB[i]
        assert fit.relative_error < 0.02
    body = motion_friction.rigid_body
    of_joint = dict(zip(body.names, zip(body.values, body.std, strict=True), strict=True))["F_2"]
    assert of_joint[0] == pytest.approx(OF_JOINT, abs=3 * of_joint[1])


def test_coupled_joint_runs_show_friction_of_motor() -> None:
    """The first joint turns both motors, each with 9 Nm: at the joint, 13.5 Nm would be its friction."""
    motor = Motor(2e-3, RATIO, coulomb=COULOMB[0] / RATIO)
    limits = Limits((-1.5, 1.5), velocity=2.0, torque=2000.0, acceleration=10.0)
    robot = with_joints(replace(WRIST, gravity=(0, 0, 0)), lambda joint: replace(joint, motor=motor, limits=limits))
    runs = ConstantVelocitySpec((0.2, 1.0), count=5, repeat=1, window=(-0.8, 0.8))
    spec = FrictionSpec(joints=("1",), rate_hz=500.0, constant_velocity=runs)
    experiment = ExperimentSpec({"a": (0.0, 0.2)}, simulated=SimulatedSpec(substeps=4))
    plan = design_friction(spec, robot.driven[:1], experiment, robot, 3)
    bench = SimulatedFrictionRig(robot, experiment, plan, 1)
    passes = [one for motion in plan.motions for one in passes_of(bench.measure(motion))]
    levels = estimate_friction_curve(passes, False, 0.0)
    assert len(levels.torque) > 1
    assert levels.torque.mean() == pytest.approx(COULOMB[0], rel=0.02)
