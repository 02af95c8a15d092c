r"""Compensation of motor friction: net torques of records on the motor shafts.

Dry friction acts on shafts, and gears may couple the axes. Shafts have the names of their motors:

.. math:: q_m' = E q_a, \qquad \tau_a = E^T \tau_m'

q_m', tau_m': angles and torques of the shafts, each referred to the link side by its own ratio; E (n_u, n_u): matrix of
the gear couplings.
"""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.nonlinear.compensated_friction import CompensatedFriction
from elastid.nonlinear.friction_basis import zoh_samples
from elastid.nonlinear.motion import whole_samples
from elastid.record import Record
from elastid.robot import Robot


def compensated_records(
    records: Iterable[Record], friction: CompensatedFriction | None, E: FloatArray | None = None
) -> Iterator[Record]:
    """Yield records with the net torque as u, one at a time; unchanged without compensation.

    E: gear couplings from motor shafts, at which friction acts, to links; None without couplings.
    """
    for record in records:
        if friction is None or not friction.shapes:
            yield record
        else:
            yield to_links(compensate_friction(to_shafts(record, E), friction), E)


def compensate_friction(record: Record, friction: CompensatedFriction) -> Record:
    """Return the record over its whole periods with the net torque as u."""
    record = record.part(slice(whole_samples(record)))
    u = record.u.copy()
    for location in friction.compensated_motors():
        basis, motion = friction.compensated_basis(location), friction.motion(record, location)
        u[:, record.inputs.index(location)] -= zoh_samples(record, location, motion, basis)
    return replace(record, u=u)


def to_shafts(record: Record, E: FloatArray | None) -> Record:
    """Return the record with torques and motions of shafts instead of motors; unchanged for E None.

    The motions are dropped unless all motors have one, of one quantity: the motion of no shaft is known then.
    """
    if E is None:
        return record
    columns = [record.outputs.index(location) for location in record.inputs if location in record.outputs]
    if len(columns) < len(record.inputs) or len({record.quantities[i] for i in columns}) > 1:
        other_outputs = [i for i in range(len(record.outputs)) if i not in columns]
        names = [name for name in ("outputs", "quantities", "sampled") if getattr(record, name)]
        fields: dict[str, Any] = {name: tuple(getattr(record, name)[i] for i in other_outputs) for name in names}
        return replace(record, y=record.y[:, other_outputs], **fields)
    return _transform_record(record, columns, np.asarray(np.linalg.inv(E)), E.T)


def to_links(record: Record, E: FloatArray | None) -> Record:
    """Return the inverse of `to_shafts`, for records of all motors."""
    if E is None:
        return record
    columns = [record.outputs.index(motor) for motor in record.inputs]
    return _transform_record(record, columns, E, np.asarray(np.linalg.inv(E).T))


def _transform_record(
    record: Record, columns: list[int], torque_matrix: FloatArray, motion_matrix: FloatArray
) -> Record:
    y = record.y.copy()
    y[:, columns] = record.y[:, columns] @ motion_matrix
    return replace(record, u=record.u @ torque_matrix, y=y, r=None if record.r is None else record.r @ torque_matrix)


def shaft_couplings(robot: Robot | None) -> FloatArray | None:
    """Return E (n_u, n_u) from the link side to the motor shafts; None without gear couplings."""
    E = np.eye(1) if robot is None else robot.mixing
    return None if np.array_equal(E, np.eye(len(E))) else E
