r"""The motion of the motors in the records of a response: its spectra, and the feedback of the controller in them.

.. math:: u - r = -\Big( \frac{F_0}{s} + F_1 + F_2 s \Big) q_m

at lines where r is known: all that move where it was recorded, else those between the excited lines. That covers PD
controllers, PID, and the cascades of robots; F is found by least squares.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.fft import rfft

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from elastid.frf.matrices import adjoint, squared_magnitude
from elastid.record import MOTION_ORDER, Record
from elastid.response import MotorMotion, Response

# Lines with less than this part of the motion's power are noise, or move no posture.
_LEAST_SHARE = 1e-5
_LEAST_RECORDS = 6  # that show the motion, where there are more
_MOST_LINES = 128  # that are kept, or from which the feedback is found
# Part of the power of u - r that the feedback must explain; noise alone is explained by less.
_EXPLAINED = 0.5


def motor_motion(records: Sequence[Record], response: Response) -> MotorMotion | None:
    """Motion of the motors among the outputs of one configuration; None without any, or without a rate."""
    records = _representative(records)
    first = records[0]
    columns = [i for i, place in enumerate(first.outputs) if place.startswith("motor ")]
    if not columns or not first.rate_is_known or not first.is_periodic:
        return None
    N = first.period_samples
    lines = np.rint(response.freq_hz * N / first.rate_hz).astype(np.int64)
    K = min(N // 2, 2 * int(lines[-1]) + 2)  # beyond twice the band angles hardly move
    s = (2j * np.pi * first.rate_hz / N * np.arange(1, K)).astype(np.complex128)
    orders = [MOTION_ORDER[first.quantities[i]] for i in columns]
    over = np.stack([s**-order for order in orders], axis=1)
    y = np.stack([_amplitudes(record, record.y, columns)[:K] for record in records])
    q = y[:, 1:] * over
    excited = lines[lines < K] - 1
    power = np.sum(squared_magnitude(q), axis=(0, 2))
    moving = power > _LEAST_SHARE * power[excited].sum()
    moving[excited] = True
    of_lines = q[:, moving].transpose(1, 2, 0)
    spectra = of_lines @ adjoint(of_lines) / (2 * len(records))
    motors = tuple(first.outputs[i] for i in columns)
    has_all = set(motors) == set(first.inputs) and not first.input_units
    feedback = _feedback(records, motors, q, s, excited, moving) if has_all else None
    mean = np.where([order == 0 for order in orders], y[:, 0].real.mean(axis=0) / 2, np.nan)
    return MotorMotion(motors, s.imag[moving] / (2 * np.pi), spectra, mean, feedback).grouped(_MOST_LINES)


def _representative(records: Sequence[Record]) -> list[Record]:
    """Whole realisations, until all inputs have moved: further ones move the robot as far, with other phases."""
    first, by_realisation = records[0], sorted(records, key=lambda record: record.realisation)
    least = min(max(_LEAST_RECORDS, len(first.inputs)), len(records))
    last = by_realisation[least - 1].realisation
    return [record for record in by_realisation if record.realisation <= last]


def _amplitudes(record: Record, signals: FloatArray, columns: list[int]) -> ComplexArray:
    """Complex amplitudes (N // 2, c) of some signals in the last period of a record that is used; twice at 0."""
    N, P = record.period_samples, record.n_periods
    last = max((p for p in range(P) if p not in record.left_out), default=P - 1)
    return np.asarray(rfft(signals[last * N : (last + 1) * N, columns], axis=0)[: N // 2] * (2 / N))


def _feedback(
    records: Sequence[Record],
    motors: tuple[str, ...],
    q: ComplexArray,
    s: ComplexArray,
    excited: IntArray,
    moving: BoolArray,
) -> FloatArray | None:
    """(3, n_m, n_m) from motors' angles q (E, K, n_m) at s (K,); None where they do not explain the torques."""
    order = [records[0].inputs.index(motor) for motor in motors]
    drive = np.stack([_amplitudes(record, record.u, order)[1 : len(s) + 1] for record in records])
    injected = [record.r for record in records if record.r is not None]
    if len(injected) == len(records):
        of_r = [_amplitudes(record, r, order)[1 : len(s) + 1] for r, record in zip(injected, records, strict=True)]
        drive = drive - np.stack(of_r)
        lines = np.flatnonzero(moving)
    else:
        lines = np.setdiff1d(np.arange(excited[0], excited[-1]), excited)
    lines = lines[:: -(-len(lines) // _MOST_LINES) or 1]
    q, drive, s = q[:, lines], drive[:, lines], s[lines]
    terms = np.concatenate([q / s[:, None], q, q * s[:, None]], axis=2)
    A, b = terms.reshape(-1, terms.shape[2]), -drive.reshape(-1, len(motors))
    A, b = np.concatenate([A.real, A.imag]), np.concatenate([b.real, b.imag])
    if len(A) < 2 * A.shape[1]:
        return None
    size = np.maximum(np.linalg.norm(A, axis=0), 1e-300)
    F = np.linalg.lstsq(A / size, b)[0] / size[:, None]
    if np.sum((b - A @ F) ** 2) > (1 - _EXPLAINED) * np.sum(b**2):
        return None
    return np.asarray(F.reshape(3, len(motors), len(motors)).swapaxes(1, 2))
