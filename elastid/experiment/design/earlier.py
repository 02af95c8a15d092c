"""What an earlier measurement leads one to expect of the next: the variance of its responses."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.special import digamma

from elastid.arrays import FloatArray
from elastid.errors import StudyError
from elastid.response import FrequencyResponse


def variance_like(
    responses: Sequence[FrequencyResponse], freq_hz: FloatArray, outputs: tuple[str, ...], inputs: tuple[str, ...]
) -> FloatArray:
    """Variance (F, n_y, n_u) of G: geometric mean over earlier responses, between their lines.

    StudyError where they have other inputs or outputs, or no variance.
    """
    logs = []
    for response in responses:
        known = response.uncertainty
        if response.inputs != inputs or response.outputs != outputs or known is None:
            raise StudyError(
                f"design.noise.frf: configuration {response.configuration.name} was measured from "
                f"{', '.join(response.inputs)} to {', '.join(response.outputs)}"
                f"{' without a variance' if known is None else ''}; needed are {', '.join(inputs)} to "
                f"{', '.join(outputs)} with one"
            )
        # The logarithm of a variance from few degrees of freedom lies too low: E ln(v~/v) = psi(dof) - ln dof.
        shortfall = np.log(known.dof) - digamma(known.dof) if np.isfinite(known.dof) else 0.0
        log = np.log(np.maximum(known.variance, 1e-300)).reshape(response.n_lines, -1) + shortfall
        logs.append([np.interp(freq_hz, response.freq_hz, column) for column in log.T])
    variance: FloatArray = np.exp(np.mean(logs, axis=0)).T.reshape(len(freq_hz), len(outputs), len(inputs))
    return variance
