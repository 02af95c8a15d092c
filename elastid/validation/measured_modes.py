r"""Modes of the measured responses compared with the identified model's, and modes that the model lacks.

Each measured mode is assigned to one mode of the model with a similar frequency, within 10 % or the smaller half width,
and a similar shape. Shapes at the outputs, psi of the measurement and C phi of the model, are compared by

.. math:: \mathrm{MAC} = \frac{|\psi^H C \phi|^2}{\psi^H \psi\; (C \phi)^H C \phi}

A mode without a partner is missing in the model if the model error at the peak exceeds half of its height
|R| / (zeta omega), which must exceed eight standard deviations.  Friction causes smaller errors of a correct model.
"""

from __future__ import annotations

from itertools import compress
from typing import TYPE_CHECKING

import numpy as np

from elastid.base.arrays import BoolArray, FloatArray, IntArray, frozen_value, labelled
from elastid.base.display import digits, number, percent
from elastid.base.errors import Note
from elastid.modal.spec import ModalSpec

if TYPE_CHECKING:  # pages use this file without the model
    from elastid.fit.fitted_robot import FittedRobot
    from elastid.linear.linear_model import LinearModel
    from elastid.modal.modes import Modes
    from elastid.response import Response

# Limits of missing modes. Of 150 correct models one had a false alarm (`scripts/studies/results.csv`).
MAX_DISTANCE = 0.1  # relative difference of the frequencies of one mode
MIN_MAC = 0.5  # of one mode, if its frequencies differ by more than the smaller half width
MIN_ERROR_FRACTION = 0.5  # model error at a peak over its height
HEIGHT_STD = 8.0  # least height of a peak in standard deviations
MIN_AMPLITUDE = 0.3  # of an output that is listed, over the largest entry of the shape


@frozen_value
class MeasuredModes:
    """Measured modes (n,) of one configuration with their modes of the model; outputs: with the largest amplitudes."""

    configuration: str
    frequency_unit: str
    outputs: tuple[str, ...]
    freq_hz: FloatArray = labelled("natural frequency", "{frequency_unit}")
    freq_std: FloatArray = labelled("its standard deviation", "{frequency_unit}")
    zeta: FloatArray = labelled("damping ratio")
    zeta_std: FloatArray = labelled("its standard deviation")
    model_hz: FloatArray = labelled("natural frequency of the model, NaN without such a mode", "{frequency_unit}")
    model_zeta: FloatArray = labelled("damping ratio of the model")
    mac: FloatArray = labelled("modal assurance criterion")
    is_missing: BoolArray = labelled("the model has no such mode")

    @property
    def rows(self) -> list[tuple[str, ...]]:
        """Texts of a table: frequency, 95 %, damping in %, 95 %, frequency and damping of the model, MAC, outputs."""
        rows: list[tuple[str, ...]] = []
        numbers = zip(self.freq_hz, self.freq_std, self.zeta, self.zeta_std, strict=True)
        for i, (f, f_std, zeta, zeta_std) in enumerate(numbers):
            model = number(self.model_hz[i], 4), percent(self.model_zeta[i], 2), number(self.mac[i], 2)
            rows.append((
                number(f, digits(f, f_std)), number(1.96 * f_std, 2),
                percent(zeta, digits(zeta, zeta_std)), percent(1.96 * zeta_std, 2),
                *(model if np.isfinite(self.model_hz[i]) else ("missing" if self.is_missing[i] else "-", "", "")),
                self.outputs[i]
            ))  # fmt: skip
        return rows

    @property
    def notes(self) -> tuple[Note, ...]:
        """Note on each mode that the model lacks."""
        return tuple(
            Note(
                "validation/missing-mode",
                f"a mode at {number(self.freq_hz[i], 3)} {self.frequency_unit}, "
                f"visible at {self.outputs[i]}, is missing in the model. Add "
                "the elastic part of structure, base or tool to the robot model, as a joint without a motor",
                self.configuration,
            )
            for i in np.flatnonzero(self.is_missing).tolist()
        )


def measured_modes(fitted: FittedRobot) -> tuple[MeasuredModes, ...]:
    """Estimate the modes of each measured configuration and compare them with the model's."""
    return tuple(map(_compare_modes, fitted.measured, fitted.responses, fitted.linear))


def _compare_modes(response: Response, modelled: Response, linear: LinearModel) -> MeasuredModes:
    from elastid.linear.modes import modes as modes_of_model
    from elastid.modal.estimate import estimate_all_modes  # SciPy's linear algebra, which pages do not need
    from elastid.modal.modes import mac

    (modes,), model_modes = estimate_all_modes((response,), ModalSpec()), modes_of_model(linear, linear.theta_ref)
    agreement = np.empty((modes.n_modes, 0))
    if len(model_modes.freq_hz):
        agreement = mac(modes.shapes, linear.C @ model_modes.shapes)
    partner = _partners(modes, model_modes.freq_hz, model_modes.zeta, agreement)
    missed = np.array([_is_missed(modes, r, response, modelled) for r in range(modes.n_modes)], dtype=bool)
    # Index -1 of a mode without a partner selects the appended NaN.
    model_hz, model_zeta = (np.append(values, np.nan)[partner] for values in (model_modes.freq_hz, model_modes.zeta))
    mac_of_each = np.pad(agreement, ((0, 0), (0, 1)), constant_values=np.nan)[np.arange(modes.n_modes), partner]
    largest = (size >= MIN_AMPLITUDE * size.max() for size in np.abs(modes.shapes.T))
    outputs = tuple(", ".join(compress(modes.outputs, flags)) for flags in largest)
    numbers = modes.freq_hz, modes.freq_std, modes.zeta, modes.zeta_std, model_hz, model_zeta, mac_of_each
    return MeasuredModes(modes.configuration, modes.frequency_unit, outputs, *numbers, (partner < 0) & missed)


def _partners(modes: Modes, freq_hz: FloatArray, zeta: FloatArray, agreement: FloatArray) -> IntArray:
    """Return the index (n,) of the model's mode of each measured one, -1 for none; agreement (n, n_model): MAC."""
    from scipy.optimize import linear_sum_assignment

    gap = np.abs(modes.freq_hz[:, None] - freq_hz)
    width = np.minimum((modes.freq_hz * modes.zeta)[:, None], freq_hz * zeta)
    distance = gap / np.maximum(MAX_DISTANCE * modes.freq_hz[:, None], width)
    is_excluded = (distance >= 1) | ((gap > width) & (agreement < MIN_MAC))
    rows, columns = linear_sum_assignment(np.where(is_excluded, 1e3, distance + 1 - agreement))
    partners = np.full(modes.n_modes, -1)
    partners[rows] = np.where(is_excluded[rows, columns], -1, columns)
    return partners


def _is_missed(modes: Modes, r: int, response: Response, modelled: Response) -> bool:
    """Return whether the model has a large error at the peak of mode r in its strongest element."""
    residue = np.abs(np.outer(modes.shapes[:, r], modes.participation[:, r]))
    i, j = np.unravel_index(int(np.argmax(residue)), residue.shape)
    height = residue[i, j] / (2 * np.pi * modes.freq_hz[r] * modes.zeta[r])
    line = int(np.argmin(np.abs(response.freq_hz - modes.freq_hz[r])))
    error = abs(response.G[line, i, j] - modelled.G[line, i, j])
    covariance = response.uncertainty
    std = 0.0 if covariance is None else float(np.sqrt(covariance.variance[line, i, j]))
    return bool(error > MIN_ERROR_FRACTION * height and height > HEIGHT_STD * std)
