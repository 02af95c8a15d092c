"""Loops of a study: today's controller, as stated, and the designed one.

A controller on the identified robot: peaks, with 95 % of the draws, and bandwidths in every posture.

Each peak within half a dB of the largest is traced to the axis that has most of it and to the nearest mode of the
robot, its motors free, that moves the motor of this axis; one that is farther than a third from every mode is left to
the phase of the loop: to its gains at low frequencies, to delay, sampling and filters at high ones.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from elastid.base.arrays import FloatArray, frozen_value, labelled
from elastid.base.display import number
from elastid.experiment.specs.simulated import ControllerSpec
from elastid.fit.result import Result
from elastid.linear.equilibrium import equilibrium
from elastid.simulation.controller import Filters, Gains, filters_of, gains_of
from elastid.use.loops.design import Cascade, robust
from elastid.use.loops.plants import PlantMode, Plants, PostureFamily
from elastid.use.loops.sensitivity import Closed, Scene

_NEAR, _MOVED = 1 / 3, 5e-3  # of a frequency within which, and of the motor's motion by which, a mode makes a peak


@frozen_value
class LoopState:
    """A controller in Q postures of n_u axes, with the ends of 95 % of the draws (NaN without draws).

    peak_db (Q,): M_S, infinite where a loop is unstable.  limited_by (Q,): what makes it.  bandwidth_hz (Q, n_u).
    drawn_peaks_db (D,): of each draw over all postures.  freq_hz (K,), sensitivity_db (Q, K): of a figure.
    """

    name: str
    postures: tuple[str, ...]
    axes: tuple[str, ...]
    peak_db: FloatArray = labelled("sensitivity peak", "dB", "postures")
    peak_low: FloatArray = labelled("lower end of 95 % of draws", "dB", "postures")
    peak_high: FloatArray = labelled("upper end of 95 % of draws", "dB", "postures")
    limited_by: tuple[str, ...] = labelled("cause of the peak", axes="postures")
    bandwidth_hz: FloatArray = labelled("bandwidth of each axis", "Hz", "postures axes")
    drawn_peaks_db: FloatArray = labelled("sensitivity peak of each draw over all postures", "dB", "draw")
    freq_hz: FloatArray = labelled("frequency", "Hz")
    sensitivity_db: FloatArray = labelled("largest sensitivity", "dB", "postures freq_hz")
    sensitivity_low: FloatArray = labelled("lower end of 95 % of draws", "dB", "postures freq_hz")
    sensitivity_high: FloatArray = labelled("upper end of 95 % of draws", "dB", "postures freq_hz")


def assess(name: str, family: PostureFamily, drawn: Plants | None, gains: Gains, filters: Filters | None) -> LoopState:
    """A controller of gains (n_u,) or (Q, n_u) in the Q postures of a family; drawn: D times as many plants."""
    plants, axes = family.estimate, family.axes
    own = Scene.of(plants, 600, 41).closed(gains, filters)
    ends = own.scene.freq_hz[:, 0].max(), own.scene.freq_hz[:, -1].min()
    freq_hz = np.geomspace(*ends, 240)  # lines of the curves that are kept
    causes = tuple("; ".join(_causes(own, q, modes, axes)) for q, modes in enumerate(family.modes))
    peaks, S_db, bandwidth = own.peaks_db, _shown(own, freq_hz), own.bandwidth_hz
    peak_ends, drawn_peaks, S_ends = np.full((2, *peaks.shape), np.nan), np.zeros(0), np.full((2, *S_db.shape), np.nan)
    if drawn is not None:
        D = len(drawn) // len(plants)
        tiled = (np.tile(np.broadcast_to(part, bandwidth.shape), (D, 1)) for part in (gains.kp, gains.kd, gains.ki))
        robots = Scene.of(drawn, 120, 9).closed(Gains(*tiled), filters)
        of_draws = robots.peaks_db
        peak_ends, drawn_peaks = _ends(of_draws, D), of_draws.reshape(D, -1).max(axis=1)
        S_ends = _ends(_shown(robots, freq_hz), D)
    return LoopState(
        name, family.names, axes, peaks, peak_ends[0], peak_ends[1], causes, bandwidth, drawn_peaks,
        freq_hz, S_db, S_ends[0], S_ends[1],
    )  # fmt: skip


def _shown(loops: Closed, freq_hz: FloatArray) -> FloatArray:
    """Largest sensitivity (N, K) in dB at lines freq_hz (K,)."""
    pairs = zip(loops.scene.freq_hz, 20 * np.log10(loops.size), strict=True)
    return np.array([np.interp(np.log(freq_hz), np.log(f), size) for f, size in pairs])


def _ends(values: FloatArray, D: int) -> FloatArray:
    """Quantiles (2, Q, ...) of values (D Q, ...) over the draws, which are there with infinities."""
    sorted_ = np.sort(values.reshape(D, -1, *values.shape[1:]), axis=0)
    return sorted_[[int(0.025 * (D - 1)), int(np.ceil(0.975 * (D - 1)))]]


def _causes(own: Closed, q: int, modes: tuple[PlantMode, ...], axes: tuple[str, ...]) -> Iterator[str]:
    """Axis and mode of each peak that limits, by rising frequency."""
    size, root = np.pad(own.size[q], 1, constant_values=0.0), np.sqrt(own.scene.plants.inertia[q])
    peaks = np.flatnonzero((size[1:-1] >= size[:-2]) & (size[1:-1] > size[2:]))
    # A peak within 0.5 dB of the largest one limits the gains as well.
    binding = peaks[own.size[q, peaks] >= own.size[q].max() * 10 ** (-0.5 / 20)]
    for line in binding if own.stable[q] else [int(own.size[q].argmax())]:
        freq_hz = float(own.scene.freq_hz[q, line])
        left, _, right = np.linalg.svd(own.S[q, line] / root[:, None] * root)
        i = int(np.abs(left[:, 0] * right[0]).argmax())
        own_modes = [mode for mode in modes if mode.parts[i] >= _MOVED]
        near = min(own_modes, key=lambda each: abs(np.log(each.freq_hz / freq_hz)), default=None)
        if not own.stable[q]:
            yield f"unstable, at {freq_hz:.3g} Hz in axis {axes[i]}"
        elif near is not None and abs(near.freq_hz / freq_hz - 1) <= _NEAR:
            yield f"axis {axes[i]} at {freq_hz:.3g} Hz: mode at {near.freq_hz:.3g} Hz, {near.spring}"
        else:
            is_slow = near is not None and freq_hz < near.freq_hz
            words = "gains and notches below its modes" if is_slow else "delay and filters above its modes"
            yield f"axis {axes[i]} at {freq_hz:.3g} Hz: {words}"


TODAY, DESIGNED = "today's controller", "designed controller"


@frozen_value
class Loops:
    """today: None where the study does not state it.  designed, with its gains.  count: of draws."""

    name: str
    joints: tuple[str, ...]
    rate_hz: float = labelled("rate of the controller", "Hz")
    count: int
    today: LoopState | None
    designed: LoopState
    gains: Cascade

    @property
    def controller(self) -> ControllerSpec:
        """The designed one, as a study has it."""
        return self.gains.to_spec(self.joints)

    @property
    def states(self) -> tuple[LoopState, ...]:
        """Today's controller where it is known, and the designed one."""
        return tuple(state for state in (self.today, self.designed) if state is not None)

    @property
    def peak_cells(self) -> list[list[str]]:
        """Controller, posture, peak in dB, 95 % and cause of each posture of each controller."""
        rows = []
        for own in self.states:
            columns = zip(own.postures, own.peak_db, own.peak_low, own.peak_high, own.limited_by, strict=True)
            for posture, peak, low, high, cause in columns:
                rows.append([own.name, posture, _cell(peak), _range(low, high), cause])
        return rows


@dataclass(frozen=True)
class Today:
    """The controller that a study states, and its rate, which may be another than that of the loops designed."""

    rate_hz: float
    spec: ControllerSpec

    def state(self, family: PostureFamily, drawn: Plants | None) -> LoopState:
        """The controller in all postures; its gains may follow from a bandwidth, which is another in each."""
        model, theta = family.family.model, family.family.theta
        each = [gains_of(model, equilibrium(model, theta, own.configuration).q, self.spec) for own in family.linear]
        gains = Gains(*(np.array([getattr(own, name) for own in each]) for name in ("kp", "kd", "ki")))
        return assess(TODAY, family, drawn, gains, filters_of(family.axes, self.spec, self.rate_hz))


def design_loops(
    name: str, result: Result, family: PostureFamily, delay_samples: int, draws: int, seed: int, today: Today | None
) -> Loops:
    """Loops at the rate of a family of the fit; FitError where no gains keep the limit in all its postures.

    delay_samples: of the loops that are designed.  draws: of the fit, with their seed.
    """

    def drawn_of(family: PostureFamily) -> Plants | None:
        return family.draws(result, draws, seed) if draws else None

    drawn, state = drawn_of(family), None
    if today is not None:
        is_other = today.rate_hz != family.rate_hz
        own = replace(family, rate_hz=today.rate_hz) if is_other else family
        state = today.state(own, drawn_of(own) if is_other else drawn)
    plants, first_hz = family.estimate, min(mode.freq_hz for own in family.modes for mode in own)
    found, _ = robust(plants, drawn, first_hz, delay_samples)
    spec, model = found.to_spec(family.axes), family.family.model
    gains, filters = gains_of(model, np.zeros(model.n_q), spec), filters_of(family.axes, spec, family.rate_hz)
    designed = assess(DESIGNED, family, drawn, gains, filters)
    return Loops(name, family.axes, family.rate_hz, draws, state, designed, found)


def _cell(peak: float) -> str:
    return number(float(peak), 3) if np.isfinite(peak) else "unstable"


def _range(low: float, high: float) -> str:
    return f"{number(float(low), 3)} to {number(float(high), 3)}" if np.isfinite(low + high) else ""
