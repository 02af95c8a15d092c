"""The interactive FRF matrix of the page: its data as JSON, and its scripts.

Values are whole hundredths of a dB and tenths of a degree in 16 bits, so that 20 configurations of six axes take a few
megabytes; -32768 stands for values that are not finite.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.report.figures import style
from elastid.report.figures.responses import configuration_title
from elastid.report.page.embedding import asset, embedded
from elastid.response import FrequencyResponse
from elastid.validation.residual_tests import smoothed_std

DB_STEP, DEGREE_STEP = 0.01, 0.1
_NOT_FINITE = -32768


@dataclass(frozen=True)
class Explorer:
    """data: JSON for a script element.  scripts: texts, in order.  style: CSS."""

    data: str
    scripts: tuple[str, ...]
    style: str


def explorer(
    pairs: Sequence[tuple[FrequencyResponse, FrequencyResponse | None]],
    left_out: Sequence[str] = (),
    model_std: Sequence[FloatArray] = (),
) -> Explorer:
    """Response of every configuration, measured and, where there is a model, modelled with its std (F, n_y, n_u)."""
    first = pairs[0][0]
    content = {
        "frequency_unit": "Hz" if first.rate_is_known else "of the sampling rate",
        "quantities": _quantities(first),
        "responses": [
            _response(measured, modelled, left_out, std)
            for (measured, modelled), std in zip(pairs, model_std or (None,) * len(pairs), strict=True)
        ],
    }
    scripts = asset("uplot", "uPlot.iife.min.js"), asset("explorer.js")
    return Explorer(embedded(content), scripts, asset("uplot", "uPlot.min.css"))


def _quantities(response: FrequencyResponse) -> Mapping[str, Any]:
    """The quantities to choose from, and the look of their curves."""
    measured = {"key": "measured", "label": "measured", "color": style.MEASURED, "points": True, "ranged": True}
    fitted = {"key": "fitted", "label": "model", "color": style.FITTED, "points": False, "width": 1.5, "ranged": True}
    levels = [
        {"key": "residual", "label": "|measured − model|", "color": style.RESIDUAL, "points": False, "width": 0.7},
        {"key": "noise", "label": "std of noise", "color": style.NOISE, "points": False, "width": 1, "dash": [6, 4]},
        {"key": "total", "label": "std of noise + nonlinear", "color": style.TOTAL, "points": False, "width": 1}
        | {"dash": [2, 3]},
        {"key": "model", "label": "std of the model", "color": style.START, "points": False, "width": 1}
        | {"dash": [8, 3, 2, 3]},
    ]
    phase = [one | {"key": f"{one['key']}_phase"} for one in (measured, fitted)]
    return {
        "magnitude": {
            "title": f"magnitude, dB re 1 {style.pretty_unit(response.unit)}",
            "unit": "dB",
            "step": DB_STEP,
            "digits": 2,
            "curves": [measured, fitted, *levels],
        },
        "phase": {
            "title": "phase, degrees",
            "unit": "degrees",
            "step": DEGREE_STEP,
            "digits": 1,
            "range": [-190, 190],
            "curves": phase,
        },
    }


def _response(
    measured: FrequencyResponse,
    modelled: FrequencyResponse | None,
    left_out: Sequence[str],
    model_std: FloatArray | None,
) -> Mapping[str, Any]:
    curves = {
        "measured": _packed(style.in_db(measured.G), DB_STEP),
        "measured_phase": _packed(np.degrees(np.angle(measured.G)), DEGREE_STEP),
    }
    if modelled is not None:
        curves |= {
            "fitted": _packed(style.in_db(modelled.G), DB_STEP),
            "residual": _packed(style.in_db(measured.G - modelled.G), DB_STEP),
            "fitted_phase": _packed(np.degrees(np.angle(modelled.G)), DEGREE_STEP),
        }
    for name, covariance in (("noise", measured.noise), ("total", measured.total)):
        if covariance is not None:
            curves[name] = _packed(style.in_db(smoothed_std(measured, covariance)[0]), DB_STEP)
    if model_std is not None:
        curves["model"] = _packed(style.in_db(model_std), DB_STEP)
    return {
        "title": configuration_title(measured, measured.configuration.name in left_out),
        "inputs": list(measured.inputs),
        "outputs": list(measured.outputs),
        "freq": [float(f"{f:.6g}") for f in measured.freq_hz],
        "curves": curves,
    }


def _packed(values: FloatArray, step: float) -> str:
    """(F, n_y, n_u) as 16-bit whole steps, element by element, little end first, in base64."""
    with np.errstate(invalid="ignore"):
        steps = np.clip(np.round(values / step), -32767, 32767)
    whole = np.where(np.isfinite(values), steps, _NOT_FINITE).astype("<i2")
    return base64.b64encode(np.ascontiguousarray(whole.transpose(1, 2, 0)).tobytes()).decode("ascii")
