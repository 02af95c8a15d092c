r"""Loops as closed-loop records show them: sensitivity and margins from an injected torque r.

.. math:: G_{ur} = S = [I + F P]^{-1}, \qquad L_i = 1 / S_{ii} - 1

from r, which has no noise, to the torques u of all motors, by the estimator of the study's responses, without a model.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from elastid.base.arrays import FloatArray, frozen_value, labelled
from elastid.frf.estimate import estimate
from elastid.frf.spec import EstimatorSpec
from elastid.record import Motion, Record
from elastid.use.loops.sensitivity import Margins, largest_gain, margins, scaled


@frozen_value
class MeasuredLoops:
    """Loops of n_u axes in one configuration, at F lines.

    peak_db: largest M_S over the lines.  at_edge: True if that is at an end of the band, so that the peak may lie
    beyond.  margins (1, n_u): infinite where no line has the crossing.
    """

    configuration: str
    axes: tuple[str, ...]
    freq_hz: FloatArray = labelled("frequency", "Hz")
    sensitivity_db: FloatArray = labelled("largest sensitivity", "dB", "freq_hz")
    peak_db: float = labelled("sensitivity peak", "dB")
    peak_std: float = labelled("its standard deviation", "dB")
    at_edge: bool
    margins: Margins


def measured_loops(records: Sequence[Record], estimator: EstimatorSpec, inertia: FloatArray) -> MeasuredLoops:
    """Of the records of a configuration; inertia (n_u,) as in M_S.  ValueError where they lack r."""
    if refused := refusal(records):
        raise ValueError(refused)
    first = records[0]
    spec = replace(estimator, quantity="position", method="auto", friction="none")
    response = estimate([_from_injected(record) for record in records], spec)
    S, known = response.G, response.uncertainty
    variance = np.zeros(S.shape) if known is None else known.variance
    D = scaled(S[None], inertia[None])[0]
    sizes, root = largest_gain(D), np.sqrt(inertia)
    line = int(sizes.argmax())
    left, _, right = np.linalg.svd(D[line])
    spread = np.abs(np.outer(left[:, 0], right[0])) ** 2 * variance[line] / root[:, None] ** 2 * root**2
    peak_std = 20 / np.log(10) * float(np.sqrt(spread.sum() / 2)) / float(sizes[line])
    nominal = margins(1 / np.einsum("fii->if", S) - 1, response.freq_hz)
    each = (np.atleast_2d(getattr(nominal, name)) for name in ("rise", "fall", "phase", "delay"))
    return MeasuredLoops(
        first.configuration.name, first.inputs, response.freq_hz, 20 * np.log10(sizes),
        float(20 * np.log10(sizes[line])), peak_std, line in (0, len(sizes) - 1), Margins(*each),
    )  # fmt: skip


def refusal(records: Sequence[Record]) -> str:
    """Why records do not show their loops; empty where they do."""
    for record in records:
        if record.r is None:
            return f"record {record.name} holds no injected torque (role r)"
        if record.input_units or not record.rate_is_known or not record.is_periodic:
            return f"record {record.name} has no torque in N*m, no rate or no period"
    return "" if len(records) >= len(records[0].inputs) else f"{len(records)} records do not separate all motors"


def _from_injected(record: Record) -> Record:
    """The record with r as input, and with the torques of the motors as outputs."""
    assert record.r is not None
    places = tuple(f"torque of {motor}" for motor in record.inputs)
    position: Motion = "position"
    return replace(
        record, outputs=places, quantities=(position,) * len(places), u=np.asarray(record.r), y=np.asarray(record.u),
        r=None, hold="band-limited", hold_samples=(), sliding=(), sampled=(),
    )  # fmt: skip
