r"""Automatic choice of an estimator: the candidate with the smallest stated error.

A wide window averages more noise than a narrow one, without a better response.  Errors are therefore compared at one
resolution B, the widest of the candidates.  The resolution b of a candidate is the spacing of its lines times the
number of correlated lines.  At each line with input power, relative to |G|,

.. math:: \epsilon^2 = \min\left(1, \frac{\sigma^2}{|G|^2} \min(1, b / B) + \beta^2\right), \quad
          \beta^2 = \max\left(0, \left\langle \min\left(1, \frac{|\Delta|^2}{|G|^2}\right)
          - \min\left(1, \frac{\sigma^2 + \sigma_l^2}{|G|^2}\right) \right\rangle\right)

and the error of the candidate is (mean sqrt(epsilon))^2. A mean square would be dominated by lines beyond the excited
band; a geometric mean would neglect a lost antiresonance.

beta applies to segments only: their noise variance sigma^2 lacks the bias by leakage, initial transients and feedback
of noise. Delta: difference to the local rational method, which models the transient and whose variance sigma_l^2
includes the model error. Common noise makes Delta smaller, so that noise alone is no bias. <>: mean over neighbouring
lines. The scatter of a mean over periods includes a transient.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from elastid.base.arrays import BoolArray, FloatArray, interpolate
from elastid.base.errors import DataError, Note
from elastid.frf.local.fitted_response import local_mean
from elastid.frf.period_selection import TRANSIENT_DISCARDED
from elastid.frf.spec import Method
from elastid.frf.spectra import RecordSpectra
from elastid.record import Record
from elastid.response import Response


@dataclass(frozen=True)
class AutomaticLimits:
    """Limits of the choice.

    With them the error of the automatic choice is at most 1.5 times the error of the best method, for ten kinds of
    records with 10 to 50 dB (`scripts/studies/results.csv`).
    """

    lines: int = 128  # largest number of lines in the preview of a local method
    min_power_fraction: float = 1e-4  # input power of a line relative to the strongest line, below which it is ignored
    margin: float = 1.5  # least ratio of the errors for a local method that competes with a mean or takes long
    long_lines: int = 50_000  # number of lines for which a local method takes half a minute per input
    long_values: int = 200_000  # number of values of G above which no local method is tried for `long_lines`
    periods: int = 6  # number of periods below which their scatter may not show a transient
    elements: int = 9  # number of elements of G above which a large scatter alone does not suggest a transient
    scatter: float = 0.03  # relative error of a mean below which a transient is negligible


LIMITS = AutomaticLimits()


def method_choice(method: Method, reason: str) -> tuple[Method, tuple[Note, ...]]:
    """Return a method, and a note with the reason."""
    text = f"the FRF is estimated by the method {method}, because {reason}"
    return method, (Note("frf/method", text, severity="information"),)


def choose_by_error(
    method: Method, candidate: Callable[[], Response], preview: Callable[[], Response], margin: float = 1.0
) -> tuple[Method, tuple[Note, ...]]:
    """Return `method`, or local_rational if its stated error times `margin` is smaller, and a note with both errors.

    candidate: response by `method`.  preview: response by local_rational on a subset of lines.  If one method rejects
    the records, the other method is chosen; raises the DataError of `method` if both do.
    """
    try:
        local = preview()
    except DataError as refusal:
        candidate()
        return method_choice(method, f"local_rational rejects the records ({refusal})")
    try:
        response = candidate()
    except DataError as refusal:
        return method_choice("local_rational", f"{method} rejects the records ({refusal})")
    if min(response.n_lines, local.n_lines) < 2:
        return method_choice("local_rational", f"{method} has only {response.n_lines} lines")
    error, error_l, resolution = relative_errors(response, local, has_bias=method == "h1")
    unit = "Hz" if local.has_rate else "of the sampling rate"
    scale = f"(of |G|, averaged over {resolution:.2g} {unit})"
    if error_l * margin < error:
        errors = f"{100 * error_l:.2g} % {scale} instead of {100 * error:.2g} % with {method}"
        return method_choice("local_rational", f"its relative std is {errors}")
    remark = f", which is not {margin:g} times less" if error_l < error else ""
    errors = f"{100 * error:.2g} % {scale} instead of {100 * error_l:.2g} % with local_rational"
    return method_choice(method, f"its relative std is {errors}{remark}")


def relative_errors(response: Response, local: Response, has_bias: bool) -> tuple[float, float, float]:
    """Return the relative errors of `response` and `local` (local_rational on a subset of lines), and B in Hz.

    has_bias: True for segments, whose noise variance lacks the bias.
    """
    b, b_l = (float(np.median(np.diff(G.freq_hz))) * G.correlated_lines for G in (response, local))
    inside = (local.freq_hz >= response.freq_hz[0]) & (local.freq_hz <= response.freq_hz[-1])
    common = inside & _has_power(local)
    local = local.lines(common if common.any() else inside)
    G, variance_l = interpolate(local.freq_hz, response.freq_hz, response.G), _variance(local)
    line_variance = response.noise.variance if has_bias and response.noise is not None else _variance(response)
    variance = interpolate(local.freq_hz, response.freq_hz, line_variance)
    # |G|^2: mean of both responses with inverse-variance weights.
    weight, weight_l = (1 / np.maximum(x, 1e-300) for x in (variance, variance_l))
    power = (np.abs(G) ** 2 * weight + np.abs(local.G) ** 2 * weight_l) / (weight + weight_l)

    def relative(squares: FloatArray) -> FloatArray:
        return np.minimum(1.0, squares / np.maximum(power, 1e-300))

    bias = np.maximum(0.0, local_mean(relative(np.abs(G - local.G) ** 2) - relative(variance + variance_l)))
    squares = relative(variance * min(1.0, b / b_l)) + (bias if has_bias else 0.0)
    return _mean_root(squares), _mean_root(relative(variance_l * min(1.0, b_l / b))), max(b, b_l)


def _mean_root(squares: FloatArray) -> float:
    """Return (mean sqrt|e|)^2 of errors e from their squares, each limited to 1."""
    return float(np.mean(np.minimum(1.0, squares) ** 0.25) ** 2)


def may_have_transient(records: Sequence[Record], response: Response) -> bool:
    """Return True if a transient was detected, or if few periods with large scatter may contain one.

    False for large logs, because a local method needs the whole log in memory.
    """
    if any(RecordSpectra(record).is_large for record in records):
        return False
    if any(note.code == TRANSIENT_DISCARDED for note in response.notes):
        return True
    is_short = min(record.n_repeats for record in records) < LIMITS.periods and response.G[0].size <= LIMITS.elements
    return is_short and _mean_root(_variance(response) / np.maximum(np.abs(response.G) ** 2, 1e-300)) > LIMITS.scatter


def _has_power(response: Response) -> BoolArray:
    """Return flags (F,) of the lines where the weakest combination of inputs has power."""
    assert response.quality is not None
    power = response.quality.input_singular_values[:, -1] ** 2
    return np.asarray(power >= LIMITS.min_power_fraction * power.max())


def within_excitation(response: Response) -> Response:
    """Return a response to motors without the lines above the excited band.

    There a motor follows the noise that its controller C feeds back, and G = Y / U is -1 / C.
    """
    lines = np.arange(response.n_lines)
    last = int(lines[_has_power(response)][-1])
    if last == lines[-1] or not all(location.startswith("motor ") for location in response.inputs):
        return response
    text = (
        f"lines above {response.freq_hz[last]:.4g} Hz are discarded: the torques have less than a hundredth of their "
        "largest amplitude there, and the motors follow the noise of their controllers"
    )
    return replace(response.lines(lines <= last), notes=(*response.notes, Note("frf/lines-discarded", text)))


def _variance(response: Response) -> FloatArray:
    assert response.uncertainty is not None
    return response.uncertainty.variance
