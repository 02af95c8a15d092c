r"""Records on the shafts of motors whose gears couple the axes, and back to the link side: dry friction acts on shafts.

.. math:: q_m' = E q_a, \qquad \tau_a = E^T \tau_m'

q_m', tau_m': angles and torques of the shafts, each referred to the link side by its own ratio alone; E (n_u, n_u) is
the robot's matrix of couplings. Shafts keep the names of their motors.

Friction cannot be found everywhere: the torque is no input, or the velocity is noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.frf.spectra import RecordSpectra
from elastid.nonlinear.motion import motion_of
from elastid.nonlinear.spectra import unsuited
from elastid.record import Record
from elastid.robot import Robot

# Noise over the RMS of a velocity, above which its sign is noise.
VELOCITY_NOISE = 0.04


def on_shafts(record: Record, E: FloatArray | None) -> Record:
    """The record with torques and motions of shafts instead of motors; itself without couplings (None).

    Motions of motors are left out where they are not of all motors, or not of one quantity: no shaft is known then.
    """
    if E is None:
        return record
    columns = [record.outputs.index(place) for place in record.inputs if place in record.outputs]
    if len(columns) < len(record.inputs) or len({record.quantities[i] for i in columns}) > 1:
        rest = [i for i in range(len(record.outputs)) if i not in columns]
        outputs = tuple(record.outputs[i] for i in rest)
        quantities = tuple(record.quantities[i] for i in rest)
        sampled = tuple(record.sampled[i] for i in rest) if record.sampled else ()
        return replace(record, y=record.y[:, rest], outputs=outputs, quantities=quantities, sampled=sampled)
    return _turned(record, columns, np.asarray(np.linalg.inv(E)), E.T)


def on_links(record: Record, E: FloatArray | None) -> Record:
    """The inverse of `on_shafts`, for records of all motors."""
    if E is None:
        return record
    columns = [record.outputs.index(place) for place in record.inputs]
    return _turned(record, columns, E, np.asarray(np.linalg.inv(E).T))


def _turned(record: Record, columns: list[int], of_torque: FloatArray, of_motion: FloatArray) -> Record:
    """Rows of torque times one matrix, rows of motion times the other."""
    y = record.y.copy()
    y[:, columns] = record.y[:, columns] @ of_motion
    r = None if record.r is None else record.r @ of_torque
    return replace(record, u=record.u @ of_torque, y=y, r=r)


def refusal(records: Sequence[Record]) -> str:
    """Why friction cannot be found in the records of a configuration; empty where it can."""
    first = records[0]
    if reason := unsuited(first):
        return reason
    equal = np.zeros(len(first.inputs)) if first.r is None else np.all(first.u == first.r, axis=0)
    if same := [place for place, is_equal in zip(first.inputs, equal, strict=True) if is_equal]:
        return (
            f"the torque of {', '.join(same)} equals the reference to the last bit, so that the controller's part "
            "against friction is not in it and friction cannot be found; log the torque, or the current, that the "
            "drive is given"
        )
    if any(RecordSpectra(record).is_large for record in records):
        return "the records are worked on in pieces, since they are large; leave periods out, or lower their rate"
    n_u, K = len(first.inputs), len(records)
    if n_u > K:
        return f"{K} experiments do not separate {n_u} inputs; measure more, since friction is what responses leave"
    for place in first.inputs:
        motion = motion_of(first, place)
        if motion.velocity_noise > VELOCITY_NOISE * motion.speed:
            return (
                f"the velocity of {place} is {motion.speed:.2g} RMS and its noise {motion.velocity_noise:.2g}, so that "
                "its sign is not known; use an encoder of more counts, or excite slower or larger motions"
            )
    return ""


def shaft_couplings(robot: Robot | None) -> FloatArray | None:
    """E (n_u, n_u) from the link side to the shafts of the motors; None where no gear couples two axes."""
    if robot is None:
        return None
    E = robot.mixing
    return None if np.array_equal(E, np.eye(len(E))) else E
