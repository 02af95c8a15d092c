r"""Quality of a measured response: coherences, singular values, noise; notes on weak channels and resolution.

Modes are the peaks of the response; their bandwidth is the width 2 zeta f_0 at half power,

.. math:: ||G(f_0 \pm \zeta f_0)||^2 \approx ||G(f_0)||^2 / 2

A local polynomial describes G if its windows are narrower than this width, and otherwise flattens the peak. A local
rational function of degree d describes d modes in a window, for any width.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, IntArray, quotient
from elastid.base.errors import Note
from elastid.base.matrices import added_products, inverse, power, singular_values, squared_magnitude
from elastid.excitation.grids import line_frequencies
from elastid.frf.experiment_blocks import MeanSpectra
from elastid.frf.lines import MIN_SNR
from elastid.record import Motion, Record
from elastid.response import LineAmplitudes, Quality, Response

# Thresholds of a weak channel.
INPUT_SNR = 100.0  # power of an input over the noise of its mean (20 dB), below which it is weak
WEAK_FRACTION = 0.5  # fraction of lines at which a channel is weak, above which it is reported
MAX_CONDITION = 10.0  # of the inputs, whose weakest combination then has a hundredth of the largest power
LINES_OF_MODE = 4.0  # least number of lines of a segment in the width of a mode


def measured_response(
    first: Record, quantity: Motion, freq_hz: FloatArray, G: ComplexArray, **estimated: Any
) -> Response:
    """Return the response G (F, n_y, n_u) at freq_hz (F,) with the channels of `first`; outputs in `quantity`."""
    return Response(
        freq_hz=freq_hz, G=G, inputs=first.inputs, outputs=first.outputs, quantity=quantity,
        configuration=first.configuration, has_rate=first.has_rate, sliding=first.sliding,
        input_units=first.input_units, hold=first.images, **estimated,
    )  # fmt: skip


def measured_quality(freq_hz: FloatArray, data: MeanSpectra, G: ComplexArray) -> Quality:
    """Return the quality of G (F, n_y, n_u) without distortion amplitudes."""
    S_Z, n_y = data.S_Z, G.shape[1]
    spread = np.einsum("fii->fi", S_Z).real
    noise = spread / data.dof
    coherence = coherences(
        power(data.weighted_sum(data.Y, data.Y)) + spread[:, :n_y],
        data.weighted_sum(data.Y, data.U) + S_Z[:, :n_y, n_y:],
        data.weighted_sum(data.U, data.U) + S_Z[:, n_y:, n_y:],
    )
    amplitude, noise_of_mean = np.sqrt(power(data.YY) / len(data.periods)), noise[:, :n_y] * np.mean(1 / data.periods)
    excited = LineAmplitudes(freq_hz, amplitude, np.sqrt(noise_of_mean))
    return quality_of(G, data.UU / len(data.periods), coherence, (noise[:, n_y:], noise[:, :n_y]), excited)


def quality_of(
    G: ComplexArray, S_uu: ComplexArray, coherence: tuple[FloatArray, FloatArray],
    noise: tuple[FloatArray, FloatArray], excited: LineAmplitudes,
) -> Quality:  # fmt: skip
    """Return the quality of G (F, n_y, n_u), measured with input spectra S_uu (F, n_u, n_u).

    coherence: ordinary and multiple.  noise: variance of inputs (F, n_u) and outputs (F, n_y) in one period.
    """
    return Quality(*coherence, singular_values(G), relative_singular_values(S_uu), *noise, excited)


def relative_singular_values(S_U: ComplexArray) -> FloatArray:
    """Return roots (F, n_u) of the eigenvalues of input spectra S_U (F, n_u, n_u) over their RMS, largest first."""
    rms = np.sqrt(np.einsum("fii->fi", S_U).real.mean(axis=0))
    rms[rms == 0] = 1.0
    return np.sqrt(singular_values(S_U / np.outer(rms, rms)))


def coherences(yy: FloatArray, yu: ComplexArray, uu: ComplexArray) -> tuple[FloatArray, FloatArray]:
    """Return ordinary (F, n_y, n_u) and multiple coherence (F, n_y) by power yy (F, n_y) and spectra S_yu and S_uu."""
    coherent_power = np.vecdot(yu, added_products([yu], [inverse(uu)])).real
    return coherences_of_powers(squared_magnitude(yu), coherent_power, yy, power(uu))


def coherences_of_powers(
    cross: FloatArray, explained: FloatArray, yy: FloatArray, uu: FloatArray
) -> tuple[FloatArray, FloatArray]:
    r"""Return coherences of |S_yu|^2 (F, n_y, n_u), S_yu S_uu^-1 S_uy (F, n_y), powers yy (F, n_y), uu (F, n_u).

    .. math:: \gamma_{ij}^2 = \frac{|S_{y_i u_j}|^2}{S_{y_i y_i} S_{u_j u_j}}, \quad
              \gamma_i^2 = \frac{S_{y_i u} S_{uu}^{-1} S_{u y_i}}{S_{y_i y_i}}
    """
    ordinary = quotient(cross, yy[:, :, None] * uu[:, None, :])
    return np.clip(ordinary, 0.0, 1.0), np.clip(quotient(explained, yy), 0.0, 1.0)


def described_lines(lines: IntArray, record: Record) -> str:
    """Return the number and range in Hz of lines (k,), DFT bins, for a message."""
    freq_hz = line_frequencies(lines, record.rate_hz, record.period_samples)
    unit = "Hz" if record.has_rate else "of the sampling rate"
    end = f" to {freq_hz[-1]:.5g}" if len(lines) > 1 else ""
    return f"{len(lines)} DFT line{'s' * (len(lines) > 1)} ({freq_hz[0]:.5g}{end} {unit})"


def discarded_lines_note(lines: IntArray, first: Record, why: str) -> Note:
    """Return a note on lines (k,), DFT bins of records like the first, at which G is not estimated."""
    return Note("frf/lines-discarded", f"{described_lines(lines, first)} discarded, because {why}")


def output_notes(outputs: Sequence[str], quality: Quality) -> list[Note]:
    """Return a note on each output that is noise at most lines."""
    excited = quality.excited
    text = (
        "output {} is noise at most lines: less than 6 dB above its noise at {} of {} lines. Check its channel, or "
        "raise the torque"
    )
    return _weak_notes(outputs, excited.amplitude**2 <= MIN_SNR * excited.noise**2, text)


def input_notes(inputs: Sequence[str], data: MeanSpectra, quality: Quality) -> list[Note]:
    """Return a note on each weakly excited input, and on nearly dependent inputs."""
    weak = power(data.UU) / len(data.periods) < INPUT_SNR * (quality.input_noise * np.mean(1 / data.periods))
    text = (
        "input {} is barely excited: less than 20 dB above its noise at {} of {} lines, so that its column of G is "
        "uncertain. Raise its torque"
    )
    return _weak_notes(inputs, weak, text) + dependent_input_notes(quality, "take orthogonal experiments")


def _weak_notes(names: Sequence[str], weak: BoolArray, text: str) -> list[Note]:
    """Return a note on each channel that is weak (F, n) at most lines; text: for its name and two line counts."""
    counts, n = zip(names, weak.sum(axis=0).tolist(), strict=True), len(weak)
    notes = [text.format(name, count, n) for name, count in counts if count > WEAK_FRACTION * n]
    return [Note("frf/low-signal-to-noise", note) for note in notes]


def dependent_input_notes(quality: Quality, advice: str) -> list[Note]:
    """Return a note on nearly dependent inputs; advice: next action."""
    condition = np.median(quality.condition)
    if condition <= MAX_CONDITION:
        return []
    text = (
        f"the inputs are nearly dependent: the condition number of the normalised input matrix is {condition:.3g} at "
        f"the median line (1 is best); {advice}"
    )
    return [Note("frf/inputs-not-separable", text)]


def local_modes(freq_hz: FloatArray, G: ComplexArray, variance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return peaks of the Frobenius norm of G (F, n_y, n_u): frequencies (n,) and widths at half power (n,), Hz.

    Only peaks that fall to half power on both sides before they rise again, and exceed the variance of G by 16 dB.
    """
    power = np.sum(np.abs(G) ** 2, axis=(1, 2))
    peaks = 1 + np.flatnonzero((power[1:-1] > power[:-2]) & (power[1:-1] >= power[2:]))
    modes = []
    # Above 16 dB noise alone does not halve a peak on both sides.
    for peak in peaks[power[peaks] > 40.0 * variance.sum(axis=(1, 2))[peaks]]:
        below = _half_power(freq_hz[peak::-1], power[peak::-1])
        above = _half_power(freq_hz[peak:], power[peak:])
        if below is not None and above is not None:
            modes.append((freq_hz[peak], above - below))
    f_0, width = np.array(modes).reshape(-1, 2).T
    return f_0, width


def wide_window_notes(
    modes: tuple[FloatArray, FloatArray], freq_hz: FloatArray, span_hz: FloatArray, poles: int
) -> list[Note]:
    """Return a note on modes narrower than windows of span_hz (F,) at freq_hz; poles: degree, 0 for polynomials."""
    f_0, width = modes
    span = np.interp(f_0, freq_hz, span_hz)
    inside = np.array([np.sum(np.abs(f_0 - f) <= s / 2) for f, s in zip(f_0, span, strict=True)])
    load, is_beyond = (inside, inside > poles) if poles else (span / width, span > width)
    indices = np.flatnonzero(is_beyond)
    if indices.size == 0:
        return []
    worst = indices[np.argmax(load[indices])]
    text = (
        f"windows are too wide for {indices.size} of {len(span)} modes: {span[worst]:.3g} Hz at {f_0[worst]:.4g} Hz, "
        f"for a mode width of {width[worst]:.3g} Hz. Use a longer period or record, more experiments, or method "
        "local_rational with a higher local_order"
    )
    return [Note("frf/window", text)]


def segment_notes(modes: tuple[FloatArray, FloatArray], freq_hz: FloatArray, first: Record) -> list[Note]:
    """Return a note on modes that segments with lines at freq_hz (F,) do not resolve."""
    f_0, width = modes
    if not len(f_0):
        return []
    spacing = float(np.min(np.diff(freq_hz)))
    narrow = np.flatnonzero(width < LINES_OF_MODE * spacing)
    if not narrow.size:
        return []
    worst = narrow[np.argmin(width[narrow])]
    unit = "Hz" if first.has_rate else "of the sampling rate"
    text = (
        f"segments of {1 / spacing:.3g} s are too short for {narrow.size} of {len(f_0)} resonances, above all at "
        f"{f_0[worst]:.4g} {unit}: the peak is too low and the damping too large. Set "
        f"estimator.segment to at least {2 * LINES_OF_MODE / width[worst]:.3g}, or estimator.method "
        "local_rational"
    )
    return [Note("frf/segment", text)]


def _half_power(freq_hz: FloatArray, power: FloatArray) -> float | None:
    """Return the frequency at which the power (F,) is half of its first entry; None if it exceeds the first before."""
    half = np.flatnonzero(power < power[0] / 2)
    if half.size == 0 or np.any(power[: half[0]] > power[0]):
        return None
    i = int(half[0])
    fraction = (power[i - 1] - power[0] / 2) / (power[i - 1] - power[i])
    return float(freq_hz[i - 1] + fraction * (freq_hz[i] - freq_hz[i - 1]))
