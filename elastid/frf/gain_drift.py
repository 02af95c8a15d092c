r"""Torque constants that drift: inputs whose reading changes from period to period while the motion stays.

The slope S (F, n_u) over the periods p of the torques that explain the deviations of one record from its mean,

.. math:: S = \frac{\sum_p t_p\, (U_p - G^+ Y_p)}{\sum_p t_p^2}, \qquad \sum_p t_p = 0, \qquad
          \kappa_i = \frac{\mathrm{Re} \sum_f \bar U_i^* S_i}{\sum_f |U_i|^2}

is kappa U at every line where the reading of an input changes by kappa in a period; friction that warms up, or a robot
that changes, turns its phase from line to line.  The variance of kappa follows from what is left, S - kappa U.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.base.note import Note


@dataclass(frozen=True)
class Limits:
    """Thresholds of a drift."""

    lines: int = 12  # from which on a half of the band shows the same
    sigmas: float = 6.0  # of kappa beyond its standard deviation
    change: float = 0.003  # of a reading over a record
    part: float = 0.5  # of kappa, that it is at least in either half of the power along frequency


LIMITS = Limits()
GAIN_DRIFT = "frf/gain-drift"


@dataclass(frozen=True)
class GainDrift:
    """kappa (n_u,) of one record, its variance (n_u,), halves (2, n_u): kappa of the lower and of the upper lines."""

    kappa: FloatArray
    variance: FloatArray
    halves: FloatArray
    periods: int


def gain_drift(deviations: ComplexArray, U: ComplexArray, G: ComplexArray) -> GainDrift | None:
    """The drift of a record with the mean U (F, n_u); deviations (P, F, n_y + n_u): of Y and U of its periods.

    None for a single period, or few lines.
    """
    P, (F, n_u) = len(deviations), U.shape
    if P < 2 or 2 * LIMITS.lines > F:
        return None
    t = np.arange(P) - (P - 1) / 2
    slope = np.tensordot(t, deviations, axes=1) / np.sum(t**2)
    n_y = slope.shape[1] - n_u
    S = slope[:, n_y:] - np.einsum("fuy,fy->fu", np.linalg.pinv(G), slope[:, :n_y])
    power, product = np.abs(U) ** 2, (U.conj() * S).real
    share = np.cumsum(power, axis=0) / np.maximum(power.sum(axis=0), 1e-300)
    parts = [share <= 0.5, share > 0.5]
    halves = np.array([np.sum(product * part, axis=0) / np.maximum(np.sum(power * part, axis=0), 1e-300)
                       for part in parts])  # fmt: skip
    total = np.maximum(power.sum(axis=0), 1e-150)  # its square is a variance's
    kappa = product.sum(axis=0) / total
    left = np.abs(S - kappa * U) ** 2
    return GainDrift(kappa, np.sum(power * left, axis=0) / (2 * total**2), halves, P)


def drift_notes(drifts: Sequence[GainDrift], inputs: Sequence[str]) -> tuple[Note, ...]:
    """A note on the inputs whose reading drifts alike in the mean over the records of a configuration."""
    if not drifts:
        return ()
    kappa, halves = np.mean([d.kappa for d in drifts], axis=0), np.mean([d.halves for d in drifts], axis=0)
    std = np.sqrt(np.sum([d.variance for d in drifts], axis=0)) / len(drifts)
    change = kappa * max(d.periods for d in drifts)
    is_seen = (np.abs(kappa) > LIMITS.sigmas * std) & (np.abs(change) > LIMITS.change)
    is_seen &= np.all(halves * np.sign(kappa) > LIMITS.part * np.abs(kappa), axis=0)
    if not is_seen.any():
        return ()
    sizes = [f"{100 * change[i]:+.2g} % of u at {inputs[i]}" for i in np.flatnonzero(is_seen).tolist()]
    text = (
        f"the torque that is read for the same motion changes over each record, {', '.join(sizes)}: torque constants "
        "fall while motors warm up, and stiffness is off by as much as they are; measure at the temperature at which "
        "they were calibrated, or calibrate them again"
    )
    return (Note(GAIN_DRIFT, text),)
