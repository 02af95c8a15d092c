"""The singular values of the response matrix, measured beside modelled: strongest and weakest directions."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from elastid.base.arrays import FloatArray
from elastid.report.figures import style
from elastid.response import FrequencyResponse
from elastid.validation.residual_tests import sigma_of


def singular_values(measured: FrequencyResponse, modelled: FrequencyResponse, title: str) -> Figure:
    """min(n_y, n_u) singular values of G in dB by frequency; grey below 2 sigma of the whole matrix.

    Noise lifts small singular values: they cannot be told from zero below the Frobenius norm of the uncertainty.
    """
    f = measured.freq_hz
    s_measured = _singular_values(measured)
    s_modelled = _singular_values(modelled)
    noise = np.linalg.norm(sigma_of(measured)[0], axis=(1, 2))
    above = s_measured >= 2 * noise[:, None]
    height = 4.0
    figure = Figure(figsize=(7.5, height))
    axes = figure.subplots(gridspec_kw={"left": 0.1, "right": 0.97, "top": 1 - 0.75 / height, "bottom": 0.5 / height})
    size = 2.6 if len(f) <= 300 else 1.6
    points: dict[str, Any] = {"ls": "none", "marker": "o", "ms": size, "mew": 0, "zorder": 2}
    for k in range(s_measured.shape[1]):
        db, keep = style.in_db(s_measured[:, k]), above[:, k]
        axes.plot(f[keep], db[keep], **points, color=style.MEASURED, label="measured")
        if not keep.all():
            axes.plot(f[~keep], db[~keep], **points, color=style.WEAK, label="measured, below 2 sigma")
        axes.plot(f, style.in_db(s_modelled[:, k]), color=style.FITTED, lw=1.1, zorder=3, label="fitted model")
    if noise.any():
        axes.plot(f, style.in_db(noise), color=style.TOTAL, lw=1, ls=":", label="uncertainty of the matrix")
    style.light(axes)
    style.log_frequency(axes, f)
    axes.set_xlabel(style.frequency_label(measured.rate_is_known), fontsize=style.NORMAL)
    axes.set_ylabel(f"dB re 1 {style.pretty_unit(measured.unit)}", fontsize=style.NORMAL)
    style.titled(figure, f"Singular values, {title}")
    style.legend_above(figure, (axes,), markerscale=2.0)
    return figure


def _singular_values(response: FrequencyResponse) -> FloatArray:
    values: FloatArray = np.linalg.svd(response.G, compute_uv=False).astype(np.float64)
    return values
