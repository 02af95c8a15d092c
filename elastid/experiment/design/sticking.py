"""Motors that the planned torque hardly moves, because Coulomb friction holds them."""

from __future__ import annotations

import numpy as np

from elastid.experiment.plan import Plan
from elastid.experiment.simulated.spec import CarrierSpec
from elastid.friction.placed import coulomb_levels
from elastid.robot import Robot

# A multisine whose peaks are three times its rms still slides where Coulomb friction is a third of that rms.
STICKING = 1 / 3


def sticking(plan: Plan, robot: Robot, carrier: CarrierSpec | None) -> tuple[str, ...]:
    """A word for each motor whose Coulomb friction is more than a third of its rms torque (Nm, link side), at rest.

    Under a carrier joints slide whatever the multisine.
    """
    if carrier is not None:
        return ()
    # Friction holds shafts, which gears may couple.
    power = np.sum(np.abs(plan.R @ np.linalg.inv(robot.mixing)) ** 2, axis=3) / 2
    rms = np.sqrt(power.sum(axis=(0, 1, 2)) / len(plan.experiments))
    words = []
    for joint, torque, coulomb in zip(robot.driven, rms.tolist(), coulomb_levels(robot).tolist(), strict=True):
        if coulomb > STICKING * torque:
            unit = "N" if joint.slides else "N*m"
            words.append(
                f"Coulomb friction of motor {joint.name} ({coulomb:.3g} {unit}) is more than a third of its rms torque "
                f"({torque:.3g} {unit}): the joint sticks, and friction looks like stiffness; raise "
                "excitation.torque_rms or add experiment.simulated.carrier"
            )
    return tuple(words)
