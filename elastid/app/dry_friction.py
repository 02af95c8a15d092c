"""Dry friction in the results of a study: what was taken out of the responses, and what the viscous numbers contain."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.display import digits, number
from elastid.nonlinear.result import FrictionTakenOut, friction_rows
from elastid.parameters import Parameter
from elastid.robot import Robot
from elastid.study import Study

VISCOUS = "viscous friction alone"
# Of sgn(v) the best linear approximation is 2 p_v(0) v, p_v the density of the velocity.
WITH_COULOMB = "viscous friction and 2 F_c p_v(0) of Coulomb friction"


def shaft_couplings(robot: Robot | None) -> FloatArray | None:
    """E (n_u, n_u) from the link side to the shafts of the motors; None where no gear couples two axes."""
    if robot is None:
        return None
    E = robot.mixing
    return None if np.array_equal(E, np.eye(len(E))) else E


def mixed_numbers(study: Study, friction: FrictionTakenOut | None) -> frozenset[str]:
    """Names of viscous coefficients that contain dry friction, which looks viscous to a multisine.

    A motor's own, and those of a joint that turns rigidly with its motor; where the rig is simulated only with dry
    friction there, and never of a motor that friction was taken out of.
    """
    robot = study.as_robot()
    rigid = {joint.name for joint in robot.driven} - {joint.name for joint in robot.flexible}
    if study.experiment.simulated is not None:
        from elastid.friction.robot_friction import frictions  # brings CasADi

        rough = {law.place for law in frictions(robot)}
    else:
        rough = set(robot.motor_locations)
    for place in () if friction is None else friction.taken_places():
        joint = place.removeprefix("motor ")
        rough -= {place} | ({f"joint {joint}"} & {f"joint {name}" for name in rigid})
    own = {place.replace("motor ", "fm_").replace("joint ", "f_") for place in rough}
    return frozenset(
        own | {f"{f}_{name}" for name in rigid for f in ("f", "fm") if {f"motor {name}", f"joint {name}"} & rough}
    )


def contents(study: Study, friction: FrictionTakenOut | None, parameters: Iterable[Parameter]) -> dict[str, str]:
    """Parameter name to what it contains, for motors' viscous coefficients and others that contain dry friction."""
    mixed = mixed_numbers(study, friction)
    of_motors = {place.replace("motor ", "fm_") for place in study.as_robot().motor_locations}
    return {
        parameter.name: WITH_COULOMB if parameter.stands_for in mixed else VISCOUS
        for parameter in parameters
        if parameter.stands_for in of_motors | mixed
    }


def friction_summary(robot: Robot, friction: FrictionTakenOut | None) -> list[dict[str, Any]] | None:
    """The section `friction` of summary.json, an entry a motor; None where the study asked for none.

    Torques in the motor's unit on the link side, thresholds in rad (m) there, of a sign in rad/s (m/s).  before, after:
    amplitude of the torque that no response explains, by configuration.  coulomb: F_c on the motor side, as the robot's
    file has it under `motor`.
    """
    if friction is None:
        return None
    entries = []
    ratio = {f"motor {j.name}": abs(j.motor.ratio) for j in robot.driven if j.motor is not None}
    for i, row in enumerate(friction_rows(friction)):
        shapes = zip(friction.shapes, friction.levels.tolist(), friction.std.tolist(), strict=True)
        entries.append(
            {
                "motor": row.place,
                "taken_out": row.level is not None,
                "F_c": row.level,
                "std": row.std,
                "interval95": None if row.interval is None else list(row.interval),
                "unit": row.unit,
                "coulomb": None if row.level is None else row.level / ratio[row.place],
                "shapes": [
                    {"kind": shape.kind, "threshold": shape.threshold, "level": level, "std": std}
                    for shape, level, std in shapes
                    if shape.place == row.place and level > 0
                ],
                "before": dict(zip(friction.configurations, friction.before[:, i].tolist(), strict=True)),
                "after": dict(zip(friction.configurations, friction.after[:, i].tolist(), strict=True)),
                "kept_share": row.kept_share,
            }
        )
    return entries


def friction_line(friction: FrictionTakenOut) -> str:
    """One line for the terminal: the levels that were taken out; empty where none was."""
    parts = []
    for row in friction_rows(friction):
        if row.level is not None and row.std is not None:
            parts.append(f"{row.place} {number(row.level, digits(row.level, row.std))} ± {row.std:.2g} {row.unit}")
    if not parts:
        return ""
    left = max(row.kept_share for row in friction_rows(friction) if row.level is not None)
    return (
        f"friction taken out of the torque: {', '.join(parts)}; of the power of distortion and noise at most "
        f"{100 * left:.2g} % is left"
    )
