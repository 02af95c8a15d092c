"""DFT lines to analyse: planned lines, lines of a grid, or excited lines detected in recorded inputs."""

from collections.abc import Iterator, Sequence
from typing import Literal

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, IntArray, mean_of_neighbours
from elastid.base.errors import DataError, StudyError
from elastid.excitation.grids import grid_lines
from elastid.frf.experiment_blocks import FullSum, add_periods
from elastid.frf.spec import EstimatorSpec
from elastid.frf.spectra import PeriodSpectra, RecordSpectra, Role
from elastid.record import REFERENCE, Record

# Least power of an excited line relative to the noise of the mean (6 dB), and to the lines around it (-14 dB).
MIN_SNR, _MIN_NEIGHBOUR_RATIO = 4.0, 0.04
# Longest cycle of references in samples, and number of searched samples.
_MAX_CYCLE, _MAX_SEARCHED = 64, 20_000
# Limit of a difference relative to the mean difference. Least fraction of the differences at one sample of a cycle.
# Least fraction of cycles with a step above a fraction of the largest step.
_LARGEST_STEP, _STEP_FRACTION, _MIN_MOVING_FRACTION, _MIN_STEP = 10.0, 0.95, 0.2, 1e-3


def analysed_lines(spectra: Sequence[RecordSpectra], spec: EstimatorSpec, planned_lines: IntArray | None) -> IntArray:
    """Return the DFT lines (F,) of the spec for the records of one configuration.

    Raises StudyError if a grid has no line in band_hz, DataError if no line is excited.
    """
    first = spectra[0].record
    rate_hz, N = first.rate_hz, first.period_samples
    band_hz = spec.band_hz or (0.0, rate_hz / 2)
    if spec.lines in ("full", "odd"):
        if first.half_wave and spec.lines == "full":
            raise StudyError(
                "study/invalid",
                ("estimator.lines full contradicts half_wave, whose records have odd lines only. Set odd"),
                "estimator.lines",
            )
        return grid_lines(spec.lines, band_hz, rate_hz, N)
    if first.inputs[0].startswith(REFERENCE):  # aliases of the reference steps are above
        band_hz = band_hz[0], min(band_hz[1], rate_hz / 2 / reference_steps(first)[0])
    candidates = grid_lines("odd" if first.half_wave else "full", band_hz, rate_hz, N)
    if spec.lines == "auto" and planned_lines is not None:
        lines = np.intersect1d(planned_lines, candidates)
    else:
        lines = candidates[find_excited(candidates, *_driver_power(spectra, candidates))]
    if lines.size == 0:
        raise DataError(
            "frf/lines",
            f"no excited line between {band_hz[0]:g} and {band_hz[1]:g} Hz. Check period, band_hz and the channels "
            "with role u, or set the grid by estimator.lines",
            f"configuration {first.configuration.name}",
        )
    return lines


def find_excited(lines: IntArray, power: FloatArray, noise: FloatArray) -> BoolArray:
    """Flag the excited lines (F,) among the candidates, from their power (F,) and its noise (F,).

    The power changes steeply at the edges of a band and between the lines of a grid, but gradually along a shaped
    spectrum (1/f^2 in power) and in a notch.  The envelope is followed up and down from the strongest half octave.
    Lines near the envelope are excited, and their neighbours on the grid as long as the power changes gradually.
    """
    clear = np.where(power > 10.0 * noise, power, 0.0)  # 10 dB
    if not clear.any():
        return np.zeros(len(lines), np.bool_)
    flags = clear > _MIN_NEIGHBOUR_RATIO * _envelope(lines, clear)
    gaps = np.diff(lines[flags])
    return _follow_sweep(
        lines, np.where(power > MIN_SNR * noise, power, 0.0), flags, int(gaps.min()) if gaps.size else 1
    )


def reference_steps(record: Record) -> tuple[int, Literal["hold", "linear"]]:
    """Return the samples between steps of the inputs (hold) or of their velocities (linear); 1 without steps.

    With steps, the first or second differences are concentrated at one sample of each cycle.
    """
    u = np.asarray(record.u[:_MAX_SEARCHED])
    kinds: tuple[Literal["hold", "linear"], ...] = ("hold", "linear")
    for order, interpolation in enumerate(kinds, start=1):
        steps = np.abs(np.diff(u, order, axis=0))
        total = np.minimum(steps / np.maximum(steps.mean(axis=0), 1e-300), _LARGEST_STEP).sum(axis=1)
        for n in range(min(_MAX_CYCLE, len(total) // 8), 1, -1):
            sums = np.pad(total, (0, -len(total) % n)).reshape(-1, n)
            phase = int(np.argmax(sums.sum(axis=0)))
            is_moving = sums[:, phase] > _MIN_STEP * sums.max()
            if sums[:, phase].sum() > _STEP_FRACTION * total.sum() and is_moving.mean() > _MIN_MOVING_FRACTION:
                return n, interpolation
    return 1, "hold"


def smoothed_noise(noise: FloatArray, dof: int) -> FloatArray:
    """Return the noise power (F, ...) averaged over neighbouring lines, over more lines for few degrees of freedom."""
    return mean_of_neighbours(noise, 1 + 2 * round(2 / dof))


def _envelope(lines: IntArray, amplitude: FloatArray) -> FloatArray:
    """Return the largest power in the half octave of each line (F,), constant beyond a steep fall."""
    octave = np.floor(2 * np.log2(lines / lines[0])).astype(int)
    peaks = np.zeros(octave[-1] + 1)
    np.maximum.at(peaks, octave, amplitude)
    strongest = int(np.argmax(peaks))
    envelope = np.full(len(peaks), peaks[strongest])
    for indices in (range(strongest - 1, -1, -1), range(strongest + 1, len(peaks))):
        last = peaks[strongest]
        for i in indices:
            if i not in octave:
                continue
            if peaks[i] <= _MIN_NEIGHBOUR_RATIO * last:
                break
            envelope[i] = last = peaks[i]
    return np.asarray(envelope[octave])


def _follow_sweep(lines: IntArray, amplitude: FloatArray, is_excited: BoolArray, step: int) -> BoolArray:
    """Return the flags with lines that are reached from flagged lines in steps of `step` lines without a steep fall."""
    by_line = np.zeros(lines[-1] + 2 * step + 1)
    flags = np.zeros(len(by_line), np.bool_)
    by_line[lines + step], flags[lines + step] = amplitude, is_excited
    while True:
        limit = _MIN_NEIGHBOUR_RATIO * by_line * flags
        threshold = np.maximum(np.roll(limit, step), np.roll(limit, -step))
        new_flags = flags | ((by_line > threshold) & (threshold > 0))
        if np.array_equal(new_flags, flags):
            return flags[lines + step]
        flags = new_flags


def _driver_power(spectra: Sequence[RecordSpectra], lines: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return power (F,) of the mean drivers, each relative to its total, and the noise (F,) in it."""
    power, noise, dof = [], [], 0
    for record_spectra in spectra:
        # The first of more than two periods contains the transient.
        P = record_spectra.record.n_repeats
        discarded_periods = 1 if P > 2 else 0
        mean, noise_of_mean = _mean_driver(record_spectra, lines, discarded_periods)
        power.append(np.abs(mean) ** 2)
        noise.append(noise_of_mean)
        dof += P - discarded_periods - 1
    total = np.sum(power, axis=(0, 1))
    total[total == 0] = 1.0
    return np.sum(power, axis=0) @ (1 / total), smoothed_noise(np.sum(noise, axis=0) @ (1 / total), max(dof, 1))


def _mean_driver(spectra: RecordSpectra, lines: IntArray, discarded_periods: int) -> tuple[ComplexArray, FloatArray]:
    """Return the mean (F, c) of the driver's amplitudes over periods, and its variance (F, c).

    References are taken as accelerations, which are similar at all lines and small for a superimposed slow motion.
    """
    record = spectra.record
    driver: Role = "u" if record.r is None or record.r_is_reference else "r"  # references contain the slow motion
    size = (lines / lines[0]) ** (2 if record.inputs[0].startswith(REFERENCE) else 0)
    sums = FullSum(np.outer(size, np.full(len(record.inputs), 2 / record.repeat_samples)).astype(np.complex128))

    def groups() -> Iterator[PeriodSpectra]:
        first = 0
        for X in spectra.dft_at((driver,), lines):
            rows = np.arange(max(discarded_periods - first, 0), len(X))
            yield PeriodSpectra(record, first + np.arange(len(X)), X, sums.scale).only(rows)
            first += len(X)

    return add_periods(sums, groups()), sums.power() / max(sums.dof, 1) / (sums.dof + 1)
