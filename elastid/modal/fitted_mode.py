"""Frequency, damping and residue of a fitted pole with standard deviations; its judgement as a mode, and notes."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.base.errors import Note
from elastid.modal.influences import Influences
from elastid.modal.poles import LIMITS as POLES
from elastid.response import Response


@dataclass(frozen=True)
class ModeLimits:
    """Limits of a significant pole that is a mode, and of the lines that modes are estimated from.

    In 144 random structures under hammers, multisines, noise and sweeps, 2 of 958 modes were missed and none was false
    (`scripts/studies/modes.py`).
    """

    damping_significance: float = 2.5  # least damping over its standard deviation
    freq_std: float = 0.05  # most, over the frequency: a slow pole at the edge of the band is no mode
    min_input_singular_value: float = 0.01  # least singular value of the inputs over its largest: -40 dB,
    sufficient_coherence: float = 0.9  # unless the coherence is above this value
    coherence: float = 0.2  # least multiple coherence of the best output, a median over `coherence_lines`
    coherence_lines: int = 21
    lines: int = 16  # least number of usable lines
    second_shape: float = 0.1  # least second singular value of a repeated root's residue, over the first
    second_shape_std: float = 6.0  # and over its standard deviation
    twin_distance: float = 1.5  # most, in half widths, of two poles with one shape: the weaker corrects the stronger
    twin_mac: float = 0.9  # least
    max_twin_residue: float = 0.1  # over the residue of the stronger pole
    broad: float = 0.03  # least damping of a pole that may be background of stronger modes
    min_peak_ratio: float = 0.1  # of a broad mode's peak over the rms of G within its half-power band
    residue_std: float = 0.5  # most of a broad mode, over its residue
    undamped_std: float = 4.0  # standard deviations by which a damping is below 0
    lines_in_width: float = 1.5  # least within the half-power band for a reliable damping
    unexplained: float = 0.1  # least power fraction with which the conjugate response is tried
    phase_gain: float = 0.2  # most of this fraction that the conjugate leaves
    max_pole_distance: float = 0.05  # of a mode from the frequency that selects it, relative


LIMITS = ModeLimits()


@dataclass(frozen=True)
class FittedMode:
    """Natural frequency and damping ratio with standard deviations; residue (n_y, n_u) and its standard deviation.

    index: number of the pole in the fit.  slopes (2, 2): d (f, zeta) / d (Re lambda, Im lambda), SI units.
    """

    freq_hz: float
    freq_std: float
    zeta: float
    zeta_std: float
    residue: ComplexArray
    residue_std: FloatArray
    index: int = 0
    slopes: FloatArray = field(default_factory=lambda: np.eye(2))

    @classmethod
    def of(cls, response: Response, influences: Influences, r: int, pole: complex) -> "FittedMode":
        """Compute the mode of pole r of a fit.  pole: its value in 1/s without the damping of an exponential window."""
        fit, size, scale = influences.fit, abs(pole), influences.fit.data.basis.scale
        C = influences.pole_covariances[r] * scale**2
        # zeta = -Re lambda / |lambda|
        freq_slope = np.array([pole.real, pole.imag]) / size / (2 * np.pi)
        zeta_slope = np.array([-(pole.imag**2), pole.real * pole.imag]) / size**3
        freq_std, zeta_std = (float(np.sqrt(max(float(g @ C @ g), 0.0))) for g in (freq_slope, zeta_slope))
        residue = (fit.residues[r] * scale).reshape(response.G.shape[1:])
        std = (influences.residue_std(r) * fit.data.scale * scale).reshape(residue.shape)
        slopes = np.stack([freq_slope, zeta_slope])
        return cls(size / (2 * np.pi), freq_std, -pole.real / size, zeta_std, residue, std, r, slopes)

    def is_within(self, response: Response, shift: float = 0.0) -> bool:
        """Return whether the mode is in the band and its frequency and damping are accurate.

        The damping of a resonance narrower than a line may be inaccurate.
        """
        in_band = response.freq_hz[0] <= self.freq_hz <= response.freq_hz[-1]
        is_damped = LIMITS.damping_significance * self.zeta_std < self.zeta or self.lines_in_width(response, shift) < 1
        is_accurate = self.freq_std <= LIMITS.freq_std * self.freq_hz
        return bool(in_band and is_accurate and is_damped and self.zeta < POLES.max_damping)

    def lines_in_width(self, response: Response, shift: float = 0.0) -> float:
        """Return the number of lines in the width 2 zeta f + shift / pi, with the shift by exponential windows, 1/s."""
        return (2 * self.zeta * self.freq_hz + shift / np.pi) / float(np.median(np.diff(response.freq_hz)))

    def is_background(self, response: Response) -> bool:
        """Return whether a broad pole has a low peak in its half-power band, or an inaccurate residue."""
        if self.zeta < LIMITS.broad:
            return False
        size, half_width = float(np.linalg.norm(self.residue)), self.freq_hz * self.zeta
        G = response.G[np.abs(response.freq_hz - self.freq_hz) <= half_width]
        rms = float(np.linalg.norm(G)) / np.sqrt(max(len(G), 1))
        is_inaccurate = float(np.linalg.norm(self.residue_std)) > LIMITS.residue_std * size
        return bool(is_inaccurate or size / (2 * np.pi * half_width) < LIMITS.min_peak_ratio * rms)

    def is_near(self, poles_hz: Sequence[float]) -> bool:
        """Return whether one of these frequencies is within 5 %, or the half width: a fit may move poles so far."""
        return any(abs(self.freq_hz / f - 1) < max(LIMITS.max_pole_distance, self.zeta) for f in poles_hz)

    def is_twin_of(self, other: "FittedMode") -> bool:
        """Return whether this is a weak pole within a resonance of the same shape: it models an error of `other`."""
        size, size_of_other = float(np.linalg.norm(self.residue)), float(np.linalg.norm(other.residue))
        width = LIMITS.twin_distance * max(self.freq_hz * self.zeta, other.freq_hz * other.zeta)
        overlap = abs(np.vdot(self.residue, other.residue)) / (size * size_of_other)
        is_weak = size < LIMITS.max_twin_residue * size_of_other
        return bool(is_weak and abs(self.freq_hz - other.freq_hz) < width and overlap**2 > LIMITS.twin_mac)


def without_twins(modes: Sequence[FittedMode]) -> list[FittedMode]:
    """Return the modes without weak poles within the resonance of a stronger one of the same shape."""
    return [mode for mode in modes if not any(mode.is_twin_of(other) for other in modes if other is not mode)]


def lost_notes(modes: Sequence[FittedMode], response: Response, poles_hz: Sequence[float] | None) -> tuple[Note, ...]:
    """Return a note on selected frequencies without a pole."""
    missing = [f"{f:g}" for f in poles_hz or () if not any(mode.is_near([f]) for mode in modes)]
    if not missing:
        return ()
    unit = "Hz" if response.has_rate else "of the sampling rate"
    text = (
        f"poles_hz names {', '.join(missing)} {unit}, but no pole stays there: the fit moves it to another resonance. "
        "Select stable poles in the stabilisation diagram, and name the neighbouring poles too"
    )
    return (Note("modal/poles", text, response.configuration.name),)


def window_notes(modes: Sequence[FittedMode], shift: float, response: Response) -> tuple[Note, ...]:
    """Return a note on poles with significantly less damping than the removed exponential window."""
    count = sum(mode.zeta < -LIMITS.undamped_std * mode.zeta_std for mode in modes) if shift else 0
    if not count:
        return ()
    text = (
        f"an exponential window of {1 / shift:g} s has more damping than {count} of {len(modes)} poles, so the data "
        "were not windowed with it. Give the time constant that the analyser states, or none"
    )
    return (Note("modal/damping", text, response.configuration.name),)


def line_notes(modes: Sequence[FittedMode], response: Response) -> tuple[Note, ...]:
    """Return a note on modes with too few lines within the half-power width 2 zeta f, because of short records."""
    lines = np.array([mode.lines_in_width(response) for mode in modes])
    if not np.any(lines < LIMITS.lines_in_width):
        return ()
    worst, count = int(np.argmin(lines)), int(np.sum(lines < LIMITS.lines_in_width))
    mode = modes[worst]
    unit, per_line = ("Hz", " s") if response.has_rate else ("of the sampling rate", " samples")
    text = (
        f"{count} of {len(modes)} resonances have too few lines for their "
        f"damping. At {mode.freq_hz:.4g} {unit}, measure periods of {2 / (mode.zeta * mode.freq_hz):.3g}{per_line}, or "
        "lower resolution_hz for a long record"
    )
    return (Note("modal/damping", text, response.configuration.name),)
