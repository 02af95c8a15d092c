r"""Input shapers for the modes of a region: impulses that a reference is convolved with, ranked by what they cost.

.. math:: V(\omega, \zeta) = e^{-\zeta \omega t_n} \left| \sum_i A_i e^{\omega t_i (\zeta + j \sqrt{1 - \zeta^2})}
          \right|, \qquad \sum_i A_i = 1, \quad A_i \ge 0

V: residual vibration of a mode over that of the reference alone. ZV and ZVD are 0 at one frequency, ZVD with its slope;
EI stays within 5 % about it (Singer and Seering, J. Dyn. Sys. Meas. Control 112 (1990), 76; Singhose, Seering and
Singer, J. Mech. Des. 116 (1994), 654), each at the frequency that suits the region best. Robust: the shortest one whose
V stays below 4 % in every mode of the region, by linear programming with the circle |V| <= 0.04 as a polygon.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from elastid.base.arrays import FloatArray, frozen_value, labelled
from elastid.base.errors import FitError, StudyError
from elastid.base.statistics import QUANTILE_95
from elastid.fit.posture import Asked
from elastid.fit.result import FitResult
from elastid.linear.equilibrium import rigid_posture
from elastid.linear.posture_model import PostureModel
from elastid.record import Configuration, JointLoop
from elastid.robot import Payload
from elastid.simulation.controller import tune
from elastid.use.command.replay import DAMPING_RATIO

TOLERATED = 0.05  # residual vibration
DESIGNED = 0.04  # of the robust shaper: what is left of several modes adds up at the tool
MIN_SHARE = 0.02  # of the strongest mode, below which a mode of a posture does not count
MAX_ZETA = 0.7  # beyond, a mode does not vibrate
_SIDES = 16  # of the polygon, whose corners lie 2 % outside of the circle that it is in
_LONGEST = 2.5  # periods of the slowest mode that a shaper may take
_MOST = 200  # instants in a period of the slowest one


@frozen_value
class RegionModes:
    """Modes of the tool over a region: freq_hz, its std, zeta, share (n,) of the strongest; payload in kg of each."""

    freq_hz: FloatArray = labelled("natural frequency", "Hz", "mode")
    freq_std: FloatArray = labelled("its standard deviation", "Hz", "mode")
    zeta: FloatArray = labelled("damping ratio", "", "mode")
    share: FloatArray = labelled("excitation relative to the strongest of its posture", "", "mode")
    payload: FloatArray = labelled("payload", "kg", "mode")

    @property
    def corners(self) -> tuple[FloatArray, FloatArray]:
        """Frequencies and damping ratios (3 n,): of each mode, and at the ends of its 95 % interval."""
        away = QUANTILE_95 * np.array([-1.0, 0.0, 1.0])[:, None] * self.freq_std
        freq_hz = np.maximum(self.freq_hz + away, 0.05 * self.freq_hz)
        return freq_hz.ravel(), np.tile(self.zeta, 3)


@frozen_value
class Shaper:
    """Impulses of size A (n,) at times t (n,) in s, and their worst residual vibration over a region.

    robustness: half width of the band by which all frequencies may be wrong together with V below 5 %, as a part.
    """

    name: str
    amplitude: FloatArray = labelled("size of each impulse", "", "time_s")
    time_s: FloatArray = labelled("time of each impulse", "s")
    worst: float = labelled("largest residual vibration over the region")
    mean: float = labelled("mean residual vibration over the region")
    robustness: float = labelled("common error of the frequencies that it bears")

    @property
    def delay_s(self) -> float:
        """Time by which a move takes longer."""
        return float(self.time_s[-1])

    @property
    def suffices(self) -> bool:
        """True if every mode of the region stays below 5 %, to rounding."""
        return self.worst <= TOLERATED * (1 + 1e-6)

    def shaped(self, signal: FloatArray, rate_hz: float) -> FloatArray:
        """A signal (N, n) at even times, at rest at its ends, convolved with the impulses: (N + delay, n)."""
        extra = int(np.ceil(self.delay_s * rate_hz))
        t = np.arange(len(signal) + extra) / rate_hz
        own = np.arange(len(signal)) / rate_hz
        columns = [
            sum(A * np.interp(t - at, own, column) for A, at in zip(self.amplitude, self.time_s, strict=True))
            for column in signal.T
        ]
        return np.column_stack(columns)


def residual(amplitude: FloatArray, time_s: FloatArray, freq_hz: FloatArray, zeta: FloatArray) -> FloatArray:
    """V (n,) of modes (n,)."""
    omega = 2 * np.pi * freq_hz[:, None]
    pole = omega * (zeta[:, None] + 1j * np.sqrt(1 - zeta[:, None] ** 2))
    # Times before the last impulse: e^(pole t) alone would overflow.
    return np.asarray(np.abs(np.exp(pole * (time_s - time_s[-1])) @ amplitude))


def region_modes(
    result: FitResult,
    angles: FloatArray,
    bandwidth_hz: float | None,
    payloads: Sequence[float] = (),
    frame: str | None = None,
) -> RegionModes:
    """Modes of the tool at angles (Q, n_u) with each payload in kg at the frame, none by default.

    bandwidth_hz: of the position loops of the drives, which are closed, and excite the modes; None for motors that are
    held, and modes by their part in the tool's compliance.  StudyError where nothing vibrates.
    """
    rows: list[tuple[float, float, float, float, float]] = []
    for mass in payloads or (0.0,):
        asked = Asked(frame=frame)
        if mass:
            asked = replace(asked, payload=Payload(mass=mass, at=result.family(asked).frame))
        if bandwidth_hz is not None:
            motors = result.family(asked).robot.motor_locations
            asked = replace(asked, inputs=motors, motors="controlled", controller=_NO_LOOP)
        family = result.family(asked)
        for posture in (Configuration("region", each) for each in angles):
            own = family
            if bandwidth_hz is not None:
                gains = tune(family.model, rigid_posture(family.model, posture), bandwidth_hz, DAMPING_RATIO)
                own = replace(family, asked=replace(asked, controller=gains))
            rows += [(*row, mass) for row in _modes(own.at(posture))]
    if not rows:
        raise StudyError(
            "use/move", f"no mode of the region vibrates: all have a damping ratio above {MAX_ZETA}; nothing to shape"
        )
    return RegionModes(*np.array(rows).T)


_NO_LOOP = JointLoop(np.zeros(1), np.zeros(1), np.zeros(1))  # until the posture is known, which gains depend on


def _modes(posture: PostureModel) -> Iterator[tuple[float, float, float, float]]:
    """freq_hz, std, zeta, share of each mode that has a part in the tool's motion."""
    known, system = posture.modes(), posture.state_space()
    poles, right = np.linalg.eig(system.A)
    left = np.linalg.inv(right)
    size = np.linalg.norm(system.C @ right, axis=0) * np.linalg.norm(left @ system.B, axis=1) / np.abs(poles)
    swings = np.flatnonzero((poles.imag > 0) & (-poles.real < MAX_ZETA * np.abs(poles)))
    for k in swings[size[swings] >= MIN_SHARE * size[swings].max(initial=0.0)]:
        freq_hz = float(np.abs(poles[k]) / (2 * np.pi))
        std = float(known.freq_std[int(np.argmin(np.abs(known.freq_hz - freq_hz)))])
        yield freq_hz, std, float(-poles[k].real / np.abs(poles[k])), float(size[k] / size[swings].max())


def _zv(freq_hz: float, zeta: float) -> tuple[FloatArray, FloatArray]:
    half, K = _half_period(freq_hz, zeta)
    return np.array([1, K]) / (1 + K), half * np.arange(2.0)


def _zvd(freq_hz: float, zeta: float) -> tuple[FloatArray, FloatArray]:
    half, K = _half_period(freq_hz, zeta)
    return np.array([1, 2 * K, K**2]) / (1 + K) ** 2, half * np.arange(3.0)


def _ei(freq_hz: float, zeta: float) -> tuple[FloatArray, FloatArray]:
    """Of an undamped mode, each impulse reduced as the vibration of the first has decayed."""
    half, K = _half_period(freq_hz, zeta)
    A = np.array([(1 + TOLERATED) / 4, (1 - TOLERATED) / 2 * K, (1 + TOLERATED) / 4 * K**2])
    return A / A.sum(), half * np.arange(3.0)


def _half_period(freq_hz: float, zeta: float) -> tuple[float, float]:
    root = math.sqrt(1 - zeta**2)
    return 0.5 / (freq_hz * root), float(np.exp(-zeta * np.pi / root))


KINDS = {"ZV": _zv, "ZVD": _zvd, "EI": _ei}


def ranked_shapers(modes: RegionModes) -> tuple[Shaper, ...]:
    """All kinds for a region: those below 5 % by their delay, then the others by their residual vibration."""
    freq_hz, zeta = modes.corners
    shapers = []
    for name, make in KINDS.items():
        tried = np.geomspace(freq_hz.min(), freq_hz.max(), 60)
        worst = [residual(*make(f, float(np.median(zeta))), freq_hz, zeta).max() for f in tried]
        shapers.append(_shaper(name, *make(float(tried[int(np.argmin(worst))]), float(np.median(zeta))), modes))
    shapers.append(_shaper("robust", *robust_shaper(freq_hz, zeta), modes))
    return tuple(sorted(shapers, key=lambda each: (False, each.delay_s) if each.suffices else (True, each.worst)))


def _shaper(name: str, amplitude: FloatArray, time_s: FloatArray, modes: RegionModes) -> Shaper:
    freq_hz, zeta = modes.corners
    V = residual(amplitude, time_s, freq_hz, zeta)
    wrong = np.linspace(0, 0.5, 101)
    bears = [
        max(residual(amplitude, time_s, freq_hz * (1 + sign * e), zeta).max() for sign in (-1, 1)) <= TOLERATED + 1e-6
        for e in wrong
    ]
    robustness = float(wrong[int(np.argmin(bears)) - 1]) if bears[0] and not all(bears) else 0.5 * float(all(bears))
    return Shaper(name, amplitude, time_s, float(V.max()), float(V.mean()), robustness)


def robust_shaper(freq_hz: FloatArray, zeta: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Impulses of the shortest shaper with V below 4 % in all modes (n,); FitError where none was found."""
    freq_hz, zeta = _distinct(freq_hz, zeta)
    slowest = 1 / freq_hz.min()
    # The linear programme has six instants in half a period of the fastest mode.
    step = max(0.5 / freq_hz.max() / 6, slowest / _MOST)
    low, high, best = 1, int(np.ceil(_LONGEST * slowest / step)), None
    while low < high:
        middle = (low + high) // 2
        found = _programme(step * np.arange(middle + 1), freq_hz, zeta)
        if found is None:
            low = middle + 1
        else:
            high, best = middle, (found, step * np.arange(middle + 1))
    if best is None:
        raise FitError(
            "use/move",
            f"no shaper of {_LONGEST * slowest:.3g} s keeps the modes from {freq_hz.min():.3g} to "
            f"{freq_hz.max():.3g} Hz below 5 %; take a smaller region",
        )
    amplitude, time_s = best
    kept = amplitude > 1e-6
    kept[-1] = True
    return amplitude[kept] / amplitude[kept].sum(), time_s[kept]


def _distinct(freq_hz: FloatArray, zeta: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Of modes (n,) within half a per cent of frequency those with least and most damping, and at both ends."""
    bins = np.round(np.log(freq_hz) / 5e-3)
    kept = {int(np.argmin(freq_hz)), int(np.argmax(freq_hz))}
    for own in (np.flatnonzero(bins == each) for each in np.unique(bins)):
        kept |= {int(own[np.argmin(zeta[own])]), int(own[np.argmax(zeta[own])])}
    rows = sorted(kept)
    return freq_hz[rows], zeta[rows]


def _programme(time_s: FloatArray, freq_hz: FloatArray, zeta: FloatArray) -> FloatArray | None:
    """Amplitudes >= 0 with sum 1 whose V is within the polygon for all modes, the least worst one; None without."""
    from scipy.optimize import linprog

    omega = 2 * np.pi * freq_hz[:, None]
    pole = omega * (zeta[:, None] + 1j * np.sqrt(1 - zeta[:, None] ** 2))
    V = np.exp(pole * (time_s - time_s[-1]))
    turn = np.exp(2j * np.pi * np.arange(_SIDES) / _SIDES)
    rows = np.concatenate([(V * each).real for each in turn])
    radius = DESIGNED * np.cos(np.pi / _SIDES)  # of the circle within the polygon with corners at DESIGNED
    n = len(time_s)
    solved = linprog(
        np.append(np.zeros(n), 1.0), np.column_stack([rows, -np.ones(len(rows))]), np.zeros(len(rows)),
        np.append(np.ones(n), 0.0)[None], [1.0], [(0, 1)] * n + [(0, radius)],
    )  # fmt: skip
    return np.asarray(solved.x[:n]) if solved.status == 0 else None
