"""Logs of torques, positions and references: the torques show which gain of the stated controller is wrong."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from plants.referenced_joint import RATE, N, ReferencedJoint

from elastid.experiment.specs.channels import ChannelSpec
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.logs import CascadeSpec, FileSpec, RecordedSpec
from elastid.logs.commanded_torques import Drives, match_torques, report_controller
from elastid.logs.repair import LogReport
from elastid.logs.rig import RecordedRig
from elastid.robot import Body, Joint, Motor, Robot, Spring

JOINT = ReferencedJoint(delay_s=0.0034)
CHANNELS = tuple(
    ChannelSpec(role, "motor 1", name, quantity=quantity)
    for role, name, quantity in (
        ("u", "torque", "torque"), ("y", "angle", "position"), ("reference", "command", "position")
    )
)  # fmt: skip
ROBOT = Robot(
    "joint",
    (
        Body(
            "load", joints=(Joint("1", "z", Spring(JOINT.k, JOINT.d), Motor(JOINT.motor, 1.0, JOINT.fm)),), inertia=0.8
        ),
    ),
)


@pytest.mark.parametrize(("of_kp", "of_kd", "wrong"), [
    (1.0, 1.0, ()), (1.04, 1.0, ()), (1.0, 1.25, ("velocity_gain = 0.8",)), (1.25, 1.0, ("position_gain = 0.8",)),
    (1.25, 1.25, ("velocity_gain = 0.8",)),
])  # fmt: skip
def test_gains_that_the_torques_contradict_are_reported(
    of_kp: float, of_kd: float, wrong: tuple[str, ...], tmp_path: Path
) -> None:
    """Gains k_p and k_d of the study that are a factor off; references act 3.4 ms late, which is not stated."""
    torque, command = (JOINT.log(0, torque=is_torque) for is_torque in (True, False))
    rows = np.column_stack([torque, command[:, 0]])
    np.savetxt(tmp_path / "log.csv", rows, "%.14g", ",", header="torque,angle,command", comments="")
    kp, kd = of_kp * JOINT.kp, of_kd * JOINT.kd
    controller = CascadeSpec(position_gain=kp / kd, velocity_gain=kd)
    files = (FileSpec("log.csv", "c"),)
    recorded = RecordedSpec(RATE, CHANNELS, files, period=N / RATE, controller=controller)
    rig = RecordedRig(ROBOT, ExperimentSpec({"c": (0.0,)}, recorded=recorded), tmp_path)
    texts = [note.text for note in rig.measure(rig.experiments[0]).notes if note.code == "records/controller"]
    assert len(texts) == bool(wrong)
    assert all(gain in text for text, gain in zip(texts, wrong, strict=True))


def test_a_motor_at_rest_contradicts_no_gain() -> None:
    """Motor 1 obeys the controller of the study, motor 2 has noise alone; of both 99.9 % of the power is explained."""
    f, rng = np.linspace(1.0, 40.0, 80), np.random.default_rng(0)
    axis = Body("next", "load", joints=(replace(ROBOT.driven[0], name="2"),), inertia=JOINT.load)
    torques = [ChannelSpec("u", f"motor {i}", f"u{i}") for i in (1, 2)]
    controller = CascadeSpec(position_gain=20.0, velocity_gain=20.0)
    drives = Drives.of(controller, replace(ROBOT, bodies=(*ROBOT.bodies, axis)), torques, RATE)
    R, Q = (rng.standard_normal((80, 2)) + 1j * rng.standard_normal((80, 2)) for _ in range(2))
    R[:, 1] = Q[:, 1] = 0.0
    C_fb, C_ff = drives.controller_responses(f)
    U = C_ff * R - C_fb * Q + 0.1 * rng.standard_normal((80, 2))
    match = match_torques(drives, f, U, R, Q, 0.0)
    assert match.explained > 0.999
    log = LogReport("log", ("u1", "u2"))
    report_controller(match, log)
    assert not log.findings.at("record")
