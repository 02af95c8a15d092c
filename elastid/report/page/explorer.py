"""Interactive parts of a page, response explorer and mode viewer: data as JSON, scripts, and their content policy."""

import base64
import hashlib
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from importlib.resources import files
from typing import Any

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.base.display import number, percent
from elastid.base.escape import embedded_json
from elastid.report.figures import style
from elastid.report.figures.fit import configuration_title
from elastid.report.modes import ModeRow
from elastid.response import Covariance, Response
from elastid.validation.residual_tests import sigma_of


def asset(*path: str) -> str:
    """Read a file of this package without indentation and comment lines; CSS also without spaces."""
    text = (files("elastid.report") / "page").joinpath(*path).read_text(encoding="utf-8")
    if path[-1].endswith(".css"):
        return re.sub(r"\s*([{};,])\s*|(?<=:) ", r"\1", text).strip()
    lines = (line.strip() for line in text.splitlines())
    return "\n".join(line for line in lines if line and not line.startswith("//"))


def script_policy(scripts: Iterable[str]) -> str:
    """Return the hashes of the scripts for script-src of a content security policy."""
    digests = (base64.b64encode(hashlib.sha256(script.encode()).digest()).decode() for script in scripts)
    return " ".join(f"'sha256-{digest}'" for digest in digests)


def explorer(
    pairs: Sequence[tuple[Response, Response | None]],
    left_out: Sequence[str] = (),
    models: Sequence[tuple[Response, FloatArray | None]] = (),
) -> str:
    """Return measured and, if there is a model, modelled responses of every configuration as JSON.

    models: for each configuration, the model on a denser grid that contains the measured lines, with its standard
    deviation (L, n_y, n_u); by default the models on the measured lines.
    """
    first = pairs[0][0]
    content = {
        "frequency_unit": "Hz" if first.has_rate else "of the sampling rate",
        "quantities": _quantities(first),
        "responses": [
            _response(measured, (modelled, None) if dense is None else dense, left_out)
            for (measured, modelled), dense in zip(pairs, models or (None,) * len(pairs), strict=True)
        ],
    }
    return embedded_json(content)


def curve_scripts() -> tuple[str, ...]:
    """Return scripts of a page with curves, the plotting library first."""
    return asset("uplot", "uPlot.iife.min.js"), *map(asset, ("curves.js", "explorer.js", "first_screen.js"))


def _quantities(response: Response) -> Mapping[str, Any]:
    """Return titles, units and curves of the plots: magnitude, phase, coherence, residual ratio."""
    measured = _curve("measured", "measured", style.MEASURED, ["G"], points=True, ranged=True)
    fitted = _curve("fitted", "model", style.FITTED, ["model"], width=1.5, ranged=True)
    magnitude = [
        measured,
        fitted,
        *(
            _curve(end, "95 % band of the model", f"{style.FITTED}55", ["model", "std"], width=0.6, unread=True)
            | {"fill": f"{style.FITTED}33"}
            for end in ("low", "high")
        ),
        _curve("residual", "|measured − model|", style.RESIDUAL, ["G", "model"], width=0.7),
        _curve("noise", "std of noise", style.NOISE, ["noise"], width=1, dash=[6, 4]),
        _curve("total", "std of noise and nonlinear distortion", style.TOTAL, ["total"], width=1, dash=[2, 3]),
        _curve("model", "std of the model", style.START, ["std"], width=1, dash=[8, 3, 2, 3]),
    ]
    phase = [curve | {"key": f"{curve['key']}_phase"} for curve in (measured, fitted)]
    ratio = _curve("ratio", "residual / std", style.MEASURED, ["G", "model", "noise"], points=True, ranged=True)
    coherence = _curve("coherence", "coherence", style.NOISE, ["coherence"], points=True, ranged=True)
    decibel = f"magnitude, dB re 1 {style.pretty_unit(response.unit)}"
    return {
        "magnitude": {"title": decibel, "unit": "dB", "digits": 2, "curves": magnitude},
        "phase": {"title": "phase, degrees", "unit": "degrees", "digits": 1, "range": [-190, 190], "curves": phase},
        "coherence": {"title": "coherence", "unit": "", "digits": 4, "range": [0, 1.05], "curves": [coherence]},
        "ratio": {"title": "residual / std of noise", "unit": "std", "digits": 2, "curves": [ratio]},
    }


def _curve(key: str, label: str, color: str, needs: Sequence[str], **look: Any) -> dict[str, Any]:
    return {"key": key, "label": label, "color": color, "needs": list(needs), "points": False} | look


def _response(
    measured: Response, model: tuple[Response | None, FloatArray | None], left_out: Sequence[str]
) -> Mapping[str, Any]:
    """Return titles, frequencies and arrays (element by element) of a configuration for the explorer."""
    modelled, std = model
    freq = measured.freq_hz if modelled is None else modelled.freq_hz
    quality = measured.quality
    arrays = {"G": measured.G, "model": None if modelled is None else modelled.G, "std": std}
    for name, covariance in (("noise", measured.noise), ("total", measured.total)):
        if covariance is not None:  # smoothed over lines if it has few degrees of freedom
            without_noise = replace(measured, noise=None, total=Covariance(covariance.variance, covariance.dof))
            arrays[name] = sigma_of(without_noise)
    arrays["coherence"] = None if quality is None else quality.coherence
    return {
        "title": configuration_title(measured, measured.configuration.name in left_out),
        "name": measured.configuration.name,
        "inputs": list(measured.inputs),
        "outputs": list(measured.outputs),
        "freq": [float(f"{f:.6g}") for f in freq],
        "at": np.searchsorted(freq, measured.freq_hz).tolist(),
        # (F, n_y, n_u), stored element by element.
        "arrays": {name: pack(values.transpose(1, 2, 0)) for name, values in arrays.items() if values is not None},
    }


def pack(values: FloatArray | ComplexArray) -> str:
    """Pack values as base64 of little-endian float32, real before imaginary part."""
    single = "<c8" if np.iscomplexobj(values) else "<f4"
    return base64.b64encode(np.ascontiguousarray(values, single).tobytes()).decode("ascii")


def mode_viewer(rows: Sequence[ModeRow], has_rate: bool) -> str:
    """Return all modes of the page as JSON; empty if no row has a drawing."""
    if all(row.drawing is None for row in rows):
        return ""
    colors = {"rest": style.WEAK, "ahead": style.MEASURED, "back": style.FITTED}
    mode_rows = [_mode_row(row, "Hz" if has_rate else "of the sampling rate") for row in rows]
    return embedded_json({"colors": colors, "rows": mode_rows})


def _mode_row(row: ModeRow, unit: str) -> Mapping[str, Any] | None:
    drawing = row.drawing
    if drawing is None:
        return None
    step = float(f"{np.ptp(drawing.points, axis=0).max() / 5000:.4g}")
    modes: list[Mapping[str, Any]] = []
    for mode, (freq, zeta) in enumerate(zip(row.frequency_hz, row.damping_ratio, strict=True)):
        title = f"{row.configuration}, mode {mode + 1}: {number(freq)} {unit}, " + f"{percent(zeta)} damping"
        motion = drawing.moved[:, :, mode]
        shape = {"re": _whole_numbers(motion.real, step), "im": _whole_numbers(motion.imag, step)}
        modes.append({"title": title, "energy": row.energy_text[mode], "views": drawing.views(mode), **shape})
    sticks = {"points": _whole_numbers(drawing.points, step), "links": drawing.links, "joints": drawing.joints}
    return {"step": step, **sticks, "down": drawing.up if drawing.hanging else -1, "modes": modes}


def _whole_numbers(values: FloatArray, step: float) -> list[int]:
    """Return values (n, 3) in whole steps, point by point."""
    return np.round(values / step).astype(int).ravel().tolist()
