r"""Records on the shafts of motors whose gears couple the axes, and back to the link side: dry friction acts on shafts.

.. math:: q_m' = E q_a, \qquad \tau_a = E^T \tau_m'

q_m', tau_m': angles and torques of the shafts, each referred to the link side by its own ratio alone; E (n_u, n_u) is
the robot's matrix of couplings. Shafts keep the names of their motors.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.record import Record


def on_shafts(record: Record, E: FloatArray | None) -> Record:
    """The record with torques and motions of shafts in the place of those of motors; itself without couplings (None).

    Motions of motors are left out where they are not of all motors, or not of one quantity: no shaft is known then.
    """
    if E is None:
        return record
    columns = [record.outputs.index(place) for place in record.inputs if place in record.outputs]
    if len(columns) < len(record.inputs) or len({record.quantities[i] for i in columns}) > 1:
        others = [i for i in range(len(record.outputs)) if i not in columns]
        return replace(
            record,
            y=record.y[:, others],
            outputs=tuple(record.outputs[i] for i in others),
            quantities=tuple(record.quantities[i] for i in others),
        )
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
