r"""Loops as closed-loop records show them: sensitivity, controller and margins from an injected torque r.

.. math:: G_{ur} = S = [I + F P]^{-1}, \qquad G_{yr} = P S, \qquad F = (I - G_{ur})\, G_{yr}^{-1}, \qquad
          L_i = 1 / S_{ii} - 1

from r, which has no noise, to torques u and angles y of all motors, by the estimator of the study's responses; no model
is in it. F is then the sampled cascade

.. math:: F = z^{-d} \Bigl(k_p + k_d \frac{1 - z^{-1}}{T_s}\Bigr) \Bigl(1 + k_i T_s \frac{z^{-1}}{1 - z^{-1}}\Bigr)

by linear least squares in 1, the difference and the sum, for each d, relative errors of equal size at all lines.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray, frozen_value, labelled
from elastid.frf.estimate import estimate
from elastid.frf.spec import EstimatorSpec
from elastid.record import MOTION_ORDER, Motion, Record
from elastid.response import FrequencyResponse
from elastid.simulation.controller import Gains
from elastid.use.loops.sensitivity import Margins, largest_gain, margins, scaled

_DRAWS = 200  # of the errors of S, for the bands of margins


@frozen_value
class MeasuredLoops:
    """Loops of n_u axes in one configuration, at F lines.

    peak_db: largest M_S over the lines.  at_edge: True if that is at an end of the band, so that the peak may lie
    beyond.  margins (1, n_u): infinite where no line has the crossing.  kp, kd, ki (n_u,), delay in samples, and
    explained (n_u,): part of the diagonal of F that these are.
    """

    configuration: str
    axes: tuple[str, ...]
    freq_hz: FloatArray = labelled("frequency", "Hz")
    sensitivity_db: FloatArray = labelled("largest sensitivity", "dB", "freq_hz")
    peak_db: float = labelled("sensitivity peak", "dB")
    peak_std: float = labelled("its standard deviation", "dB")
    at_edge: bool
    margins: Margins
    margins_low: Margins
    kp: FloatArray = labelled("position feedback", "SI", "axes")
    kd: FloatArray = labelled("velocity feedback", "SI", "axes")
    ki: FloatArray = labelled("integral", "1/s", "axes")
    delay: int
    explained: FloatArray = labelled("part of the controller that these numbers are", "", "axes")

    @property
    def gains(self) -> Gains:
        """As a simulation takes them."""
        return Gains(self.kp, self.kd, self.ki)


def measured_loops(
    records: Sequence[Record], estimator: EstimatorSpec, inertia: FloatArray, seed: int = 0
) -> MeasuredLoops:
    """Of the records of a configuration; inertia (n_u,) as in M_S.  ValueError where they lack r or a motor's angle."""
    if refused := refusal(records):
        raise ValueError(refused)
    first = records[0]
    n_u = len(first.inputs)
    spec = replace(estimator, quantity="position", method="auto", friction="none")
    response = estimate([_from_injected(record) for record in records], spec)
    order = [MOTION_ORDER[first.quantities[first.outputs.index(motor)]] for motor in first.inputs]
    s = 2j * np.pi * response.freq_hz[:, None, None]
    S, Y = response.G[:, :n_u], response.G[:, n_u:] / s ** np.array(order)[:, None]
    known = response.uncertainty
    variance = np.zeros(S.shape) if known is None else known.variance[:, :n_u]
    F = (np.eye(n_u) - S) @ np.linalg.inv(Y)
    own = np.einsum("fii->fi", F)
    D = scaled(S[None], inertia[None])[0]
    sizes, root = largest_gain(D), np.sqrt(inertia)
    line = int(sizes.argmax())
    left, _, right = np.linalg.svd(D[line])
    spread = np.abs(np.outer(left[:, 0], right[0])) ** 2 * variance[line] / root[:, None] ** 2 * root**2
    peak_std = 20 / np.log(10) * float(np.sqrt(spread.sum() / 2)) / float(sizes[line])
    kp, kd, ki, delay, explained = fitted_cascade(own, response.freq_hz, first.rate_hz)
    return MeasuredLoops(
        first.configuration.name, first.inputs, response.freq_hz, 20 * np.log10(sizes),
        float(20 * np.log10(sizes[line])), peak_std, line in (0, len(sizes) - 1),
        *_margins(S, variance, response, seed), kp, kd, ki, delay, explained,
    )  # fmt: skip


def refusal(records: Sequence[Record]) -> str:
    """Why records do not show their loops; empty where they do."""
    for record in records:
        if record.r is None:
            return f"record {record.name} holds no injected torque (role r)"
        if lacking := [motor for motor in record.inputs if motor not in record.outputs]:
            return f"record {record.name} holds no angle of {', '.join(lacking)}"
        if record.input_units or not record.rate_is_known or not record.is_periodic:
            return f"record {record.name} has no torque in N*m, no rate or no period"
    return "" if len(records) >= len(records[0].inputs) else f"{len(records)} records do not separate all motors"


def _from_injected(record: Record) -> Record:
    """The record with r as input, and with torques and angles of the motors as outputs."""
    columns = [record.outputs.index(motor) for motor in record.inputs]
    assert record.r is not None
    places = (*(f"torque of {motor}" for motor in record.inputs), *(f"angle of {motor}" for motor in record.inputs))
    y = np.hstack([np.asarray(record.u), np.asarray(record.y)[:, columns]])
    position: Motion = "position"
    return replace(
        record, outputs=places, quantities=(position,) * len(places), u=np.asarray(record.r), y=y, r=None,
        hold="band-limited", hold_samples=(), sliding=(), sampled=(),
    )  # fmt: skip


def _margins(S: ComplexArray, variance: FloatArray, response: FrequencyResponse, seed: int) -> tuple[Margins, Margins]:
    """Of the estimate, and the lower end of 95 % of errors drawn from its covariance."""
    own, std = np.einsum("fii->if", S), np.sqrt(np.einsum("fii->if", variance) / 2)
    rng = np.random.default_rng(seed)
    noise = rng.standard_normal((_DRAWS, 2, *own.shape))
    drawn = margins(1 / (own + std * (noise[:, 0] + 1j * noise[:, 1])) - 1, response.freq_hz)
    names = ("rise", "fall", "phase", "delay")
    low = (np.sort(getattr(drawn, name), axis=0)[int(0.025 * _DRAWS)] for name in names)
    nominal = margins(1 / own - 1, response.freq_hz)
    return Margins(*(np.atleast_2d(getattr(nominal, name)) for name in names)), Margins(*(each[None] for each in low))


def fitted_cascade(
    F: ComplexArray, freq_hz: FloatArray, rate_hz: float
) -> tuple[FloatArray, FloatArray, FloatArray, int, FloatArray]:
    """kp, kd, ki (n_u,), delay in samples and the explained part (n_u,) of measured controllers F (F, n_u)."""
    tried = []
    for delay in range(6):  # samples
        rows = [_fitted_axis(own, freq_hz, rate_hz, delay) for own in F.T]
        tried.append((float(np.mean([row[3] for row in rows])), -delay, rows))
    _, late, rows = max(tried, key=lambda each: each[:2])
    kp, kd, ki, explained = (np.array(part) for part in zip(*rows, strict=True))
    return kp, kd, ki, -late, explained


def _fitted_axis(F: ComplexArray, freq_hz: FloatArray, rate_hz: float, delay: int) -> tuple[float, float, float, float]:
    """kp, kd, ki and the explained part of F (F,).

    (k_p + k_d D)(1 + k_i I) with D I = 1 / z = 1 - T D is (k_p + k_i k_d) + (k_d - k_i k_d T) D + k_i k_p I.
    """
    T = 1 / rate_hz
    z_inverse = np.exp(-2j * np.pi * freq_hz * T)
    D, turned = (1 - z_inverse) / T, z_inverse**delay
    terms = np.stack([np.ones_like(D), D, z_inverse / D], axis=1) * turned[:, None] / np.abs(F)[:, None]
    target = F / np.abs(F)
    A, b = np.vstack([terms.real, terms.imag]), np.concatenate([target.real, target.imag])

    def solved(columns: slice) -> tuple[FloatArray, float]:
        c = np.linalg.lstsq(A[:, columns], b)[0]
        return c, float(np.sum((b - A[:, columns] @ c) ** 2))

    (c0, c1, c2), left = solved(slice(3))
    (p0, p1), plain = solved(slice(2))
    noise = left / max(len(b) - 3, 1)
    # A sum that the lines do not show is none, and so is one that no real cascade has.
    square = np.array([-(c0 * T + c1), c0 + c2 * T, -c2])
    # An integral is there from 4 standard deviations on: wrong in 6e-5 of loops without one.
    roots = np.roots(square) if plain - left > 4.0**2 * noise and c2 > 0 else np.zeros(0)
    real = sorted(root.real for root in roots if abs(root.imag) < 1e-9 * abs(root) and 0 < root.real < rate_hz)
    if not real:
        return float(p0), float(p1), 0.0, 1 - plain / float(b @ b)
    ki = float(real[0])
    kd = c1 / (1 - ki * T)
    return float(c0 - ki * kd), float(kd), ki, 1 - left / float(b @ b)
