"""Poles of a fit as modes: their numbers with standard deviations, the judgement of them, and notes on them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.base.display import percent
from elastid.base.note import Note
from elastid.base.statistics import QUANTILE_95
from elastid.modal.uncertainty import Influences
from elastid.response import FrequencyResponse


@dataclass(frozen=True)
class ModeLimits:
    """Judgement of poles that are more than noise.

    In 144 random structures under hammers, multisines, noise and sweeps, of 958 modes, two were missed and none false
    (`scripts/studies/modes.py`).
    """

    max_damping: float = 0.35
    damping_significance: float = 2.5  # damping over its standard deviation
    freq_std: float = 0.05  # of the frequency, at most: a slow pole at the edge of the band is no mode
    input_share: float = 0.01  # least singular value of the inputs over its largest: 40 dB,
    sure_coherence: float = 0.9  # unless the coherence shows that less suffices
    coherence: float = 0.2  # multiple, median over some lines of the best output
    coherence_lines: int = 21
    lines: int = 16  # of a response that has modes
    second_shape: float = 0.1  # singular value of a residue over its first, from which on a root is repeated
    second_shape_std: float = 6.0  # and over its standard deviation
    twin_distance: float = 1.5  # in half widths, of poles with one shape, of which the weaker mends the stronger
    twin_mac: float = 0.9
    wide_damping: float = 0.2  # half of its 95 % interval over the damping, from which on it is reported
    twin_share: float = 0.1  # of the stronger one's residue
    broad: float = 0.03  # damping, from which on a pole may be background that stronger modes leave
    visible_share: float = 0.1  # of the rms of G within its half powers, that a broad mode's peak has at least
    residue_std: float = 0.5  # of a broad mode's residue, relative
    undamped_std: float = 4.0  # standard deviations by which a damping is below 0
    lines_in_width: float = 1.5  # of a resonance between its half powers, below which its damping is doubtful
    chosen_distance: float = 0.05  # of a pole from the frequency that it was chosen by, relative


LIMITS = ModeLimits()


@dataclass(frozen=True)
class FittedMode:
    """Frequency and damping with standard deviations, the residue (n_y, n_u) and its standard deviation."""

    freq_hz: float
    freq_std: float
    zeta: float
    zeta_std: float
    residue: ComplexArray
    residue_std: FloatArray
    orders: int
    chance: float

    @classmethod
    def of(
        cls, response: FrequencyResponse, influences: Influences, r: int, pole: complex, orders: int, chance: float
    ) -> FittedMode:
        """The pole r of a fit; pole: the same in 1/s, without windows."""
        fit, size, scale = influences.fit, abs(pole), influences.fit.data.basis.scale
        C = influences.pole_covariances[r] * scale**2
        # zeta = -Re lambda / |lambda|
        of_freq = np.array([pole.real, pole.imag]) / size / (2 * np.pi)
        of_zeta = np.array([-(pole.imag**2), pole.real * pole.imag]) / size**3
        freq_std, zeta_std = (float(np.sqrt(max(float(g @ C @ g), 0.0))) for g in (of_freq, of_zeta))
        shape = response.G.shape[1:]
        residue = (fit.residues[r] * scale).reshape(shape)
        std = (influences.residue_std(r) * fit.data.scale * scale).reshape(shape)
        return cls(size / (2 * np.pi), freq_std, -pole.real / size, zeta_std, residue, std, orders, chance)

    def is_within(self, response: FrequencyResponse) -> bool:
        """True within the band, with a frequency and a damping that are known."""
        inside = response.freq_hz[0] <= self.freq_hz <= response.freq_hz[-1]
        inside = inside and self.freq_std <= LIMITS.freq_std * self.freq_hz
        return bool(inside and LIMITS.damping_significance * self.zeta_std < self.zeta < LIMITS.max_damping)

    def is_background(self, response: FrequencyResponse) -> bool:
        """True for a broad pole of little height within its half powers, or of a shape that is not known."""
        if self.zeta < LIMITS.broad:
            return False
        size, half_width = float(np.linalg.norm(self.residue)), self.freq_hz * self.zeta
        G = response.G[np.abs(response.freq_hz - self.freq_hz) <= half_width]
        rms = float(np.linalg.norm(G)) / np.sqrt(max(len(G), 1))
        is_unknown = float(np.linalg.norm(self.residue_std)) > LIMITS.residue_std * size
        return bool(is_unknown or size / (2 * np.pi * half_width) < LIMITS.visible_share * rms)

    def is_near(self, poles_hz: Sequence[float]) -> bool:
        """True where one of these frequencies is within 5 %, or within the half width: poles may wander in a fit."""
        return any(abs(self.freq_hz / f - 1) < max(LIMITS.chosen_distance, self.zeta) for f in poles_hz)

    def is_twin_of(self, other: FittedMode) -> bool:
        """True for a weak pole within a resonance of the same shape: it follows an error of that one."""
        size, size_of_other = float(np.linalg.norm(self.residue)), float(np.linalg.norm(other.residue))
        width = LIMITS.twin_distance * max(self.freq_hz * self.zeta, other.freq_hz * other.zeta)
        overlap = abs(np.vdot(self.residue, other.residue)) / (size * size_of_other)
        is_weak = size < LIMITS.twin_share * size_of_other
        return bool(is_weak and abs(self.freq_hz - other.freq_hz) < width and overlap**2 > LIMITS.twin_mac)


def without_twins(modes: Sequence[FittedMode]) -> list[FittedMode]:
    """The modes without weak poles within the resonance of a stronger one of the same shape."""
    return [mode for mode in modes if not any(mode.is_twin_of(other) for other in modes if other is not mode)]


def lost_notes(
    modes: Sequence[FittedMode], response: FrequencyResponse, poles_hz: Sequence[float] | None
) -> tuple[Note, ...]:
    """A note on chosen frequencies without a pole."""
    lost = [f"{f:g}" for f in poles_hz or () if not any(mode.is_near([f]) for mode in modes)]
    if not lost:
        return ()
    unit = "Hz" if response.rate_is_known else "of the sampling rate"
    text = (
        f"no pole is at {', '.join(lost)} {unit}, which poles_hz names: fitted from there it moves to a resonance "
        "elsewhere; choose stable poles in the stabilisation diagram, and name those beside them, too"
    )
    return (Note("no-pole", text, response.configuration.name),)


def background_notes(poles: Sequence[FittedMode], response: FrequencyResponse) -> tuple[Note, ...]:
    """A note on broad poles that are not called modes."""
    if not poles:
        return ()
    unit = "Hz" if response.rate_is_known else "of the sampling rate"
    where = ", ".join(f"{mode.freq_hz:.4g} {unit} (damping {percent(mode.zeta, 2)})" for mode in poles)
    text = (
        f"poles at {where} are background of the modes within their width: less than "
        f"{percent(LIMITS.visible_share, 2)} of the response there, or of uncertain shape; poles_hz can name them"
    )
    return (Note("broad-poles", text, response.configuration.name, severity="information"),)


def window_notes(modes: Sequence[FittedMode], shift: float, response: FrequencyResponse) -> tuple[Note, ...]:
    """A note on poles with clearly less damping than the window that is taken out."""
    count = sum(mode.zeta < -LIMITS.undamped_std * mode.zeta_std for mode in modes) if shift else 0
    if not count:
        return ()
    text = (
        f"an exponential window of {1 / shift:g} s has more damping than {count} of {len(modes)} poles, which "
        "cannot have gone through it; give the time constant that the analyser states, or none"
    )
    return (Note("window-damping", text, response.configuration.name),)


def damping_notes(modes: Sequence[FittedMode], response: FrequencyResponse) -> tuple[Note, ...]:
    """A note on dampings with wide intervals, and how much more to measure."""
    half_widths = np.array([QUANTILE_95 * mode.zeta_std / mode.zeta for mode in modes])
    wide = np.flatnonzero(half_widths > LIMITS.wide_damping)
    if not wide.size:
        return ()
    worst = int(np.argmax(half_widths))
    unit = "Hz" if response.rate_is_known else "of the sampling rate"
    narrower = 2 ** int(np.ceil(np.log2(half_widths[worst] / LIMITS.wide_damping)))
    text = (
        f"the damping of {wide.size} of {len(modes)} modes is uncertain, by {percent(half_widths[worst], 2)} of itself "
        f"at {modes[worst].freq_hz:.4g} {unit}: four times as many hits, periods or seconds of noise halve its "
        f"interval, {narrower**2} times as many bring it below {percent(LIMITS.wide_damping, 2)}"
    )
    return (Note("uncertain-damping", text, response.configuration.name, severity="information"),)


def line_notes(modes: Sequence[FittedMode], response: FrequencyResponse) -> tuple[Note, ...]:
    """A note on modes whose half-power width 2 zeta f holds too few lines: records too short for their damping."""
    spacing = float(np.median(np.diff(response.freq_hz)))
    lines = np.array([2 * mode.zeta * mode.freq_hz / spacing for mode in modes])
    if not np.any(lines < LIMITS.lines_in_width):
        return ()
    worst, count = int(np.argmin(lines)), int(np.sum(lines < LIMITS.lines_in_width))
    mode = modes[worst]
    unit, per_line = ("Hz", " s") if response.rate_is_known else ("of the sampling rate", " samples")
    text = (
        f"the resonances of {count} of {len(modes)} modes are narrower than {LIMITS.lines_in_width:g} lines, that at "
        f"{mode.freq_hz:.4g} {unit} has {lines[worst]:.2g}: too few for its damping of {percent(mode.zeta, 2)}; lines "
        f"{mode.zeta * mode.freq_hz / 2:.2g} {unit} apart, of {2 / (mode.zeta * mode.freq_hz):.3g}{per_line} and more "
        "of record or period, hold four; of a long record resolution_hz brings them closer"
    )
    return (Note("narrow-resonances", text, response.configuration.name),)
