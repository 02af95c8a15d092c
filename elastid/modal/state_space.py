r"""A small stable state-space model of any frequency response, with its error by line.

.. math:: \dot x = A x + B u, \quad y = C x + D u, \qquad G(s) = C (s I - A)^{-1} B + D

Poles are those of the p-LSCF estimator, of as low an order as the error of the response allows, refined by weighted
least squares; two states for each pair and each direction of its residue that counts.  A response that grows along
frequency, as acceleration per force of a compliance beyond the band, has no such model with a finite D at high
frequencies, so that lines beyond the band are not followed.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray, frozen_value
from elastid.base.display import Display, as_html, as_text, percent
from elastid.base.errors import DataError, check_kind
from elastid.base.escape import control_label
from elastid.modal.basis import stacked
from elastid.modal.model import ModalData, ModalFit
from elastid.modal.modes import modal_data
from elastid.modal.noise import line_variance
from elastid.modal.poles import poles_over_orders
from elastid.response import FrequencyResponse


@dataclass(frozen=True)
class StateSpaceLimits:
    """Choice of the order."""

    gain: float = 0.9  # of the squares, by a further order, above which it is not worth its states
    share: float = 1e-3  # of a residue's first singular value, below which a direction is none
    lines_per_pole: int = 4
    max_pairs: int = 30


LIMITS = StateSpaceLimits()


@frozen_value
class StateSpace:
    """A (n, n), B (n, n_u), C (n_y, n), D (n_y, n_u), SI, real; stable.

    error (F,): |G - model| over |G|, RMS over elements, at freq_hz (F,), and stated (F,): by the noise of G.
    """

    A: FloatArray
    B: FloatArray
    C: FloatArray
    D: FloatArray
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    freq_hz: FloatArray
    error: FloatArray
    stated: FloatArray

    __repr__, _repr_html_ = as_text, as_html

    @property
    def display(self) -> Display:
        """Order, size and error."""
        n_y, n_u = self.D.shape
        title = f"StateSpace of {len(self.A)} states, {n_y} x {n_u}, {self.freq_hz[0]:.4g} to {self.freq_hz[-1]:.4g} Hz"
        rows = [(percent(float(np.median(self.error))), percent(float(self.error.max())))]
        return Display(title, ("median error of G", "largest"), rows)

    @property
    def poles(self) -> ComplexArray:
        """Eigenvalues (n,) of A, 1/s."""
        return np.asarray(np.linalg.eigvals(self.A))

    def response(self, freq_hz: FloatArray) -> ComplexArray:
        """G (F, n_y, n_u) at freq_hz (F,)."""
        s = 2j * np.pi * np.asarray(freq_hz, float)[:, None, None]
        return np.asarray(self.C @ np.linalg.solve(s * np.eye(len(self.A)) - self.A, self.B) + self.D)

    def to_control(self) -> Any:
        """The model as `control.StateSpace`."""
        import control  # takes a second or two

        labels = {"inputs": [*map(control_label, self.inputs)], "outputs": [*map(control_label, self.outputs)]}
        return control.ss(self.A, self.B, self.C, self.D, **labels)


def fit_state_space(
    response: FrequencyResponse, order: int | None = None, band_hz: tuple[float, float] | None = None
) -> StateSpace:
    """A stable state-space model of a response on its lines, or those in band_hz.

    order: pairs of poles; by default the lowest beyond which the error no longer decreases.  Raises DataError for fewer
    than 8 lines.
    """
    check_kind(response, FrequencyResponse, "response", "FrequencyResponse.from_control(data, ...) makes one")
    keep = response.freq_hz > 0
    if band_hz is not None:
        keep &= (response.freq_hz >= band_hz[0]) & (response.freq_hz <= band_hz[1])
    response = response.lines(keep)
    if response.n_lines < 8:
        raise DataError(f"{response.n_lines} lines above 0 Hz are too few for a model; take 8 or more, or a wider band")
    data, _ = modal_data(response)
    most = min(LIMITS.max_pairs, response.n_lines // LIMITS.lines_per_pole) if order is None else order
    orders = poles_over_orders(response.freq_hz, response.G, data.weight, max(2, 2 * most))
    best: tuple[float, ProperFit] | None = None
    for n, poles in orders:
        fit = ProperFit.of(data, _leading(data, poles / data.basis.scale, most))
        if order is not None and len(fit.poles) != order and n != orders[-1][0]:
            continue
        fit = fit.refined()
        # Each pair must pay for its states.
        cost = fit.cost / LIMITS.gain ** (-len(fit.poles))
        if best is None or cost < best[0]:
            best = (cost, fit)
        if fit.cost <= 1.0 * data.y.size / 2 or fit.cost < 1e-18 * float(np.vdot(data.y, data.y)):
            break
    assert best is not None
    return _realised(response, best[1])
