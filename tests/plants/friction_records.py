"""Records of the passes of a plan under a law that is known, without a loop: the joint follows its reference."""

import numpy as np

from elastid.design.friction import design_friction
from elastid.experiment.plan.friction import FrictionPlan, pass_reference
from elastid.experiment.simulated.plant import true_robot
from elastid.friction_record import FrictionRecord, FrictionRecords
from elastid.friction_study.result import true_numbers
from elastid.robot import Robot
from elastid.study import LoadedStudy, load
from plants.paths import TEMPLATES

TEMPLATE = TEMPLATES / "friction"
# Torques of gravity and noise (Nm), and inertia (kg m^2) of the axis.
GRAVITY, NOISE, INERTIA = 78.0, 0.5, 8.2


def template(*overrides: str) -> LoadedStudy:
    return load(TEMPLATE / "study.yml", overrides)


def simulated(loaded: LoadedStudy) -> Robot:
    return true_robot(loaded.study.as_robot(), loaded.study.experiment.as_simulated().truth)


def records(loaded: LoadedStudy, seed: int = 0) -> tuple[FrictionPlan, FrictionRecords]:
    """The passes of its plan under its true law."""
    study = loaded.study
    plan = design_friction(study.as_friction(), study.friction_joints, study.experiment, study.as_robot(), study.seed)
    truth = true_numbers(simulated(loaded), "1")
    limits = {design.joint: design.limits for design in plan.designs}
    rng = np.random.default_rng(seed)
    found = []
    for motion in plan.motions:
        path = pass_reference(motion.planned, limits[motion.joint], plan.rate_hz)
        v = np.abs(path.velocity)
        level = truth["Fc_m1"] + (truth["Fs_m1"] - truth["Fc_m1"]) * np.exp(-((v / truth["vs_m1"]) ** 2))
        torque = np.sign(path.velocity) * (level + truth["f_m1"] * v) - GRAVITY * np.sin(path.position)
        torque = torque + INERTIA * path.acceleration + NOISE * rng.standard_normal(len(v))
        found.append(
            FrictionRecord(
                motion.name, motion.joint, "constant_velocity", plan.rate_hz, path.position, torque, path.velocity,
                there=path.there, back=path.back, speed=motion.planned.speed, start_s=motion.start_s,
                configuration=motion.configuration, is_reference=motion.planned.is_reference,
                place=f"motion {motion.name}",
            )
        )  # fmt: skip
    return plan, FrictionRecords(tuple(found))
