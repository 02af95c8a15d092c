"""Loops of a study: today's controller, as stated and as measured, and the designed one.

A controller on the identified robot: peaks, with 95 % of the draws, bandwidths and margins in every posture.

Each peak within half a dB of the largest is traced to the axis that has most of it and to the nearest mode of the
robot, its motors free, that moves the motor of this axis; one that is farther than a third from every mode is left to
the phase of the loop: to its gains at low frequencies, to delay, sampling and filters at high ones.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, frozen_value, labelled
from elastid.base.display import number
from elastid.base.errors import StudyError
from elastid.base.statistics import QUANTILE_95
from elastid.experiment.specs.simulated import ControllerSpec
from elastid.fit.result import Result
from elastid.linear.equilibrium import equilibrium
from elastid.record import Configuration
from elastid.simulation.controller import Filters, Gains, filters_of, gains_of
from elastid.use.loops.cascade import Cascade
from elastid.use.loops.design import robust
from elastid.use.loops.plants import PlantMode, Plants, PostureFamily
from elastid.use.loops.sensitivity import (
    STABLE,
    Margins,
    MeasuredLoops,
    bandwidths,
    closed_loop_poles,
    controller_response,
    grid,
    largest_gain,
    margins,
    peaks_db,
    scaled,
    sensitivity,
    tracking_error,
)

_NEAR, _MOVED = 1 / 3, 5e-3  # of a frequency within which, and of the motor's motion by which, a mode makes a peak


@dataclass(frozen=True, eq=False)
class Sampled:
    """Loops of N plants at freq_hz (N, F): S (N, F, n_u, n_u), E (N, F, n_u), and which are stable (N,)."""

    freq_hz: FloatArray
    S: ComplexArray
    size: FloatArray
    E: ComplexArray
    stable: BoolArray

    @classmethod
    def of(cls, plants: Plants, gains: Gains, filters: Filters | None, lines: int, per_mode: int) -> Sampled:
        """gains: (n_u,) or (N, n_u)."""
        freq_hz = grid(plants, lines, per_mode)
        P = plants.response(freq_hz)
        each = Gains(*(np.atleast_2d(part)[:, None] for part in (gains.kp, gains.kd, gains.ki)))
        F, F_r = controller_response(each, filters, freq_hz, plants.rate_hz)
        S = sensitivity(P, F)
        poles = np.abs(closed_loop_poles(plants, gains, filters)).max(axis=1)
        return cls(
            freq_hz, S, largest_gain(scaled(S, plants.inertia)), tracking_error(P, S, F_r), poles < STABLE
        )  # fmt: skip

    @property
    def loops(self) -> ComplexArray:
        """L_i (N, n_u, F)."""
        return np.asarray(1 / np.einsum("nfii->nif", self.S) - 1)

    @property
    def margins(self) -> Margins:
        """Margins of every loop while all others are closed."""
        return margins(self.loops, self.freq_hz[:, None])

    @property
    def peaks_db(self) -> FloatArray:
        """M_S (N,) in dB, by a parabola through the largest line and its neighbours."""
        return peaks_db(self.size, self.freq_hz)

    def shown(self, values: FloatArray, freq_hz: FloatArray) -> FloatArray:
        """Values (N, F) at lines freq_hz (K,) of their own."""
        return np.array([np.interp(np.log(freq_hz), np.log(f), v) for f, v in zip(self.freq_hz, values, strict=True)])


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
    margins: Margins
    drawn_peaks_db: FloatArray = labelled("sensitivity peak of each draw over all postures", "dB", "draw")
    freq_hz: FloatArray = labelled("frequency", "Hz")
    sensitivity_db: FloatArray = labelled("largest sensitivity", "dB", "postures freq_hz")
    sensitivity_low: FloatArray = labelled("lower end of 95 % of draws", "dB", "postures freq_hz")
    sensitivity_high: FloatArray = labelled("upper end of 95 % of draws", "dB", "postures freq_hz")


def assess(
    name: str, plants: Plants, drawn: Plants | None, gains: Gains, filters: Filters | None, postures: tuple[str, ...],
    axes: tuple[str, ...], modes: tuple[tuple[PlantMode, ...], ...],
) -> LoopState:  # fmt: skip
    """plants: of Q postures; drawn: D times as many; gains (n_u,) or (Q, n_u); modes: of each posture."""
    Q = len(plants)
    own = Sampled.of(plants, gains, filters, 600, 41)
    freq_hz = np.geomspace(own.freq_hz[:, 0].max(), own.freq_hz[:, -1].min(), 240)  # lines of the curves that are kept
    peak = np.where(own.stable, own.peaks_db, np.inf)
    causes = tuple("; ".join(_causes(own, plants, q, modes[q], axes)) for q in range(Q))
    S_db, bandwidth = own.shown(20 * np.log10(own.size), freq_hz), bandwidths(own.E, own.freq_hz)
    none = np.full(Q, np.nan), np.full(S_db.shape, np.nan)
    peak_ends, drawn_peaks, S_ends = (none[0], none[0]), np.zeros(0), (none[1], none[1])
    if drawn is not None:
        D, shape = len(drawn) // Q, bandwidth.shape
        tiled = (np.tile(np.broadcast_to(part, shape), (D, 1)) for part in (gains.kp, gains.kd, gains.ki))
        robots = Sampled.of(drawn, Gains(*tiled), filters, 120, 9)
        peaks = np.where(robots.stable, robots.peaks_db, np.inf)
        peak_ends, drawn_peaks = _ends(peaks, D), peaks.reshape(D, Q).max(axis=1)
        S_ends = _ends(robots.shown(20 * np.log10(robots.size), freq_hz), D)
    return LoopState(
        name, postures, axes, peak, *peak_ends, causes, bandwidth, own.margins, drawn_peaks, freq_hz, S_db, *S_ends
    )


def _ends(values: FloatArray, D: int) -> tuple[FloatArray, FloatArray]:
    """Quantiles of values (D Q, ...) over the draws, which are there with infinities."""
    sorted_ = np.sort(values.reshape(D, -1, *values.shape[1:]), axis=0)
    return sorted_[int(0.025 * (D - 1))], sorted_[int(np.ceil(0.975 * (D - 1)))]


def _causes(own: Sampled, plants: Plants, q: int, modes: tuple[PlantMode, ...], axes: tuple[str, ...]) -> Iterator[str]:
    """Axis and mode of each peak that limits, by rising frequency."""
    size = np.pad(own.size[q], 1, constant_values=0.0)
    peaks = np.flatnonzero((size[1:-1] >= size[:-2]) & (size[1:-1] > size[2:]))
    # A peak within 0.5 dB of the largest one limits the gains as well.
    binding = peaks[own.size[q, peaks] >= own.size[q].max() * 10 ** (-0.5 / 20)]
    for line in binding if own.stable[q] else [int(own.size[q].argmax())]:
        yield _cause(own, plants, q, int(line), modes, axes)


def _cause(own: Sampled, plants: Plants, q: int, line: int, modes: tuple[PlantMode, ...], axes: tuple[str, ...]) -> str:
    root, freq_hz = np.sqrt(plants.inertia[q]), float(own.freq_hz[q, line])
    left, _, right = np.linalg.svd(own.S[q, line] / root[:, None] * root)
    i = int(np.abs(left[:, 0] * right[0]).argmax())
    axis, modes = axes[i], tuple(mode for mode in modes if mode.parts[i] >= _MOVED)
    if not own.stable[q]:
        return f"unstable, at {freq_hz:.3g} Hz in axis {axis}"
    near = min(modes, key=lambda each: abs(np.log(each.freq_hz / freq_hz)), default=None)
    if near is None or abs(near.freq_hz / freq_hz - 1) > _NEAR:
        is_slow = near is not None and freq_hz < near.freq_hz
        words = "gains and notches below its modes" if is_slow else "delay and filters above its modes"
        return f"axis {axis} at {freq_hz:.3g} Hz: {words}"
    return f"axis {axis} at {freq_hz:.3g} Hz: mode at {near.freq_hz:.3g} Hz, {near.spring}"


TODAY, DESIGNED = "today's controller", "designed controller"


@frozen_value
class Loops:
    """today: None where the study does not state it.  designed, with its gains.  count: of draws."""

    name: str
    joints: tuple[str, ...]
    rate_hz: float = labelled("rate of the controller", "Hz")
    count: int
    today: LoopState | None
    measured: tuple[MeasuredLoops, ...]
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
        """Controller, posture, peak in dB, 95 % and cause of each posture of each controller, then as measured."""
        rows = []
        for own in self.states:
            columns = zip(own.postures, own.peak_db, own.peak_low, own.peak_high, own.limited_by, strict=True)
            for posture, peak, low, high, cause in columns:
                rows.append([own.name, posture, _cell(peak), _range(low, high), cause])
        for each in self.measured:
            ends = (each.peak_db + side * QUANTILE_95 * each.peak_std for side in (-1, 1))
            edge = "at an end of the band: the peak may lie beyond" if each.at_edge else "no model in it"
            rows.append(["measured", each.configuration, _cell(each.peak_db), _range(*ends), edge])
        return rows


@dataclass(frozen=True, eq=False)
class Today:
    """The controller that a study states: gains (n_u,), or a `ControllerSpec`.

    rate_hz: its own, which may be another than that of the loops that are designed.
    """

    rate_hz: float
    gains: Gains | None = None
    spec: ControllerSpec | None = None

    def in_postures(self, family: PostureFamily) -> Gains:
        """(Q, n_u)."""
        if self.spec is None:
            assert self.gains is not None
            return self.gains
        model, theta = family.family.model, family.family.theta
        each = [
            gains_of(model, equilibrium(model, theta, own.configuration).q, self.spec) for own in family.linear
        ]  # fmt: skip
        n_u = model.n_u
        return Gains(*(np.array([np.broadcast_to(getattr(g, k), n_u) for g in each]) for k in ("kp", "kd", "ki")))


@dataclass(frozen=True, eq=False)
class Asked:
    """Rate and delay of the loops that are designed; draws of the fit, with their seed."""

    rate_hz: float
    delay_samples: int
    draws: int
    seed: int


def design_loops(
    name: str, result: Result, asked: Asked, today: Today | None, measured: Sequence[MeasuredLoops],
    say: Callable[[str], None] = lambda _: None,
) -> Loops:  # fmt: skip
    """FitError where no gains keep the limit in all postures of the fit, StudyError for one without rest."""
    family = PostureFamily.of(result, [linear.configuration for linear in result.linear], asked.rate_hz)
    plants = family.estimate()

    def drawn_of(family: PostureFamily) -> Plants | None:
        return family.draws(result, asked.draws, asked.seed) if asked.draws else None

    drawn = drawn_of(family)
    modes = tuple(_sprung(family.modes(q), family.names[q]) for q in range(len(family.names)))
    joints = tuple(joint.name for joint in family.family.robot.driven)
    state = None
    if today is not None:
        filters = None if today.spec is None else filters_of(joints, today.spec, today.rate_hz)
        gains, own = today.in_postures(family), (plants, drawn)
        if today.rate_hz != asked.rate_hz:
            at_its_rate = replace(family, rate_hz=today.rate_hz)
            own = at_its_rate.estimate(), drawn_of(at_its_rate)
        state = assess(TODAY, *own, gains, filters, family.names, joints, modes)
    first = min(mode.freq_hz for own in modes for mode in own)
    none = plants[:0]
    found, _ = robust(plants, drawn if drawn is not None else none, first, asked.delay_samples, say)
    spec = found.to_spec(joints)
    model = family.family.model
    gains, filters = gains_of(model, np.zeros(model.n_q), spec), filters_of(joints, spec, asked.rate_hz)
    designed = assess(DESIGNED, plants, drawn, gains, filters, family.names, joints, modes)
    return Loops(name, joints, asked.rate_hz, asked.draws, state, tuple(measured), designed, found)


def _cell(peak: float) -> str:
    return number(float(peak), 3) if np.isfinite(peak) else "unstable"


def _range(low: float, high: float) -> str:
    return f"{number(float(low), 3)} to {number(float(high), 3)}" if np.isfinite(low + high) else ""


def _sprung(modes: tuple[PlantMode, ...], posture: str) -> tuple[PlantMode, ...]:
    # A pendulum under gravity has less than half of its strain energy in springs.
    kept = tuple(mode for mode in modes if mode.share >= 0.5)
    if not kept:
        raise StudyError(
            "use/gains",
            "no spring of the robot swings behind its motors, so that none limits them",
            f"posture {posture}",
        )
    return kept


def inertias(result: Result, configuration: Configuration, rate_hz: float) -> FloatArray:
    """J (n_u,) of a configuration, by which M_S compares torques."""
    return np.asarray(PostureFamily.of(result, [configuration], rate_hz).inertia[0])
