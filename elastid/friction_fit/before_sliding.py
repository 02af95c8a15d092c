"""What the records of a joint that does not slide yet tell: Maxwell slip of loops, bristles at rest, LuGre by shooting.

A part that fails leaves a note in its place: the rest of the friction does not depend on it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import DataError, FitError
from elastid.base.note import Note
from elastid.friction_fit.at_rest import AtRest, fit_at_rest
from elastid.friction_fit.lugre_prior import Prior
from elastid.friction_fit.pass_levels import PassLevels
from elastid.friction_fit.presliding import Loops, Presliding, fit_presliding
from elastid.friction_fit.rest_response import rest_responses
from elastid.friction_fit.shooting import JointLog, LuGreFit, fit_lugre
from elastid.friction_fit.spec import FrictionSpec
from elastid.friction_fit.static_law import StaticLaw
from elastid.friction_record import FrictionRecord
from elastid.robot import Robot
from elastid.simulation.elastic_joint import ElasticJoint
from elastid.simulation.held_joint import held_joint

# Damping of bristles over sqrt(stiffness times inertia), from which a search begins.
START_DAMPING = 0.3


@dataclass(frozen=True)
class BeforeSliding:
    """loops: the log of `presliding`.  bristles: a LuGre law by shooting.  notes: on what failed."""

    loops: Loops | None = None
    presliding: Presliding | None = None
    at_rest: AtRest | None = None
    bristles: LuGreFit | None = None
    notes: tuple[Note, ...] = ()


def find_before_sliding(
    robot: Robot,
    loops: Sequence[FrictionRecord],
    rest: Sequence[FrictionRecord],
    levels: PassLevels | None,
    static: StaticLaw | None,
    spec: FrictionSpec,
) -> BeforeSliding:
    """All that the records of one joint tell; levels, static: what its passes told."""
    notes, law = list[Note](), spec.law
    at_rest = _at_rest(robot, rest, static, notes) if rest else None
    if not loops or law.presliding == "no":
        return BeforeSliding(at_rest=at_rest, notes=tuple(notes))
    log = _loops(loops[0], spec)
    if law.presliding == "lugre":
        bristles = _bristles(robot, loops[0], levels, static, at_rest, notes)
        return BeforeSliding(log, None, at_rest, bristles, tuple(notes))
    try:
        return BeforeSliding(log, fit_presliding(log, law.elements), at_rest, None, tuple(notes))
    except DataError as error:
        notes.append(Note("no-presliding", str(error), f"record {loops[0].name}"))
        return BeforeSliding(None, None, at_rest, None, tuple(notes))


def _loops(record: FrictionRecord, spec: FrictionSpec) -> Loops:
    """The log; its first half loop only tells the elements where they start."""
    if spec.presliding is not None:
        frequency_hz = spec.presliding.frequency_hz
    else:
        about = record.torque - record.torque.mean()
        frequency_hz = max(1.0, np.sum(np.diff(np.sign(about)) != 0) / 2) / record.duration_s
    settled = round(record.rate_hz / frequency_hz / 2)
    return Loops(
        f"joint {record.joint}", record.rate_hz, record.position, record.torque, float(frequency_hz),
        record.resolution, settled,
    )  # fmt: skip


def _at_rest(
    robot: Robot, records: Sequence[FrictionRecord], static: StaticLaw | None, notes: list[Note]
) -> AtRest | None:
    joint = records[0].joint
    viscous = (0.0, 0.0)
    if static is not None and "viscous" in static.names:
        i = static.names.index("viscous")
        viscous = static.viscous, float(np.sqrt(static.covariance[i, i]))
    try:
        spring = _held(robot, records[0])
        return fit_at_rest(f"joint {joint}", rest_responses(records), spring, viscous)
    except (DataError, FitError) as error:
        notes.append(Note("nothing-at-rest", str(error), f"record {records[0].name}"))
        return None


def _held(robot: Robot, record: FrictionRecord) -> ElasticJoint | None:
    """The joint with its spring, the others held; None for a rigid one."""
    angles = np.zeros(len(robot.driven)) if record.configuration is None else record.configuration.angles
    return held_joint(robot, record.joint, angles)


def _bristles(
    robot: Robot,
    record: FrictionRecord,
    levels: PassLevels | None,
    static: StaticLaw | None,
    rest: AtRest | None,
    notes: list[Note],
) -> LuGreFit | None:
    """LuGre by multiple shooting through the joint's spring, what passes and responses at rest told beforehand."""
    spring = _held(robot, record)
    if spring is None or static is None or levels is None or record.resolution <= 0:
        text = (
            "a LuGre law by shooting takes passes, a joint with a linear spring of its own and the resolution of its "
            "encoder; give what is missing, or take law.presliding: maxwell_slip"
        )
        notes.append(Note("no-bristles", text, f"record {record.name}"))
        return None
    prior = Prior.of_law(static) if rest is None else Prior.of_law(static).with_other(Prior.of_rest(rest))
    torque = record.torque - _held_torque(levels, record.position)
    log = JointLog(
        f"joint {record.joint}", record.rate_hz, torque[:-1], record.position[1:] - record.position[0],
        max(levels.residual_rms, _white_std(torque), 1e-12), record.resolution / np.sqrt(12),
    )  # fmt: skip
    stiffness = float(np.ptp(torque) / np.ptp(record.position))
    damping = START_DAMPING * np.sqrt(stiffness * spring.motor_inertia)
    start = {"sigma_0": stiffness, "sigma_1": damping, "coulomb": static.values["coulomb"], "viscous": static.viscous}
    start |= {"stiction": static.values.get("stiction", static.values["coulomb"])}
    start |= {"stribeck_velocity": static.values.get("stribeck_velocity", float(static.levels.speed.max()))}
    try:
        return fit_lugre(log, spring, start, prior, exponent=static.fit.values.get("exponent", 2.0))
    except (FitError, DataError) as error:
        notes.append(Note("no-bristles", str(error), f"record {record.name}"))
        return None


def _white_std(signal: FloatArray) -> float:
    """Of white noise on a slow signal, by its second differences."""
    return float(np.std(np.diff(signal, 2)) / np.sqrt(6))


def _held_torque(levels: PassLevels, position: FloatArray) -> FloatArray:
    """Gravity and offset (n,), as the passes of the joint have them."""
    cos, sin, offset = (levels.shared.get(name, (0.0, 0.0))[0] for name in ("gravity.cos", "gravity.sin", "offset"))
    return np.asarray(cos * np.cos(position) + sin * np.sin(position) + offset)
