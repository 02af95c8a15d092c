r"""Gains of P position, PI velocity, notches and low pass with the largest position gains at a limited sensitivity.

.. math:: \max_{K_v, K_p, \ldots} \; \frac{1}{n_u} \sum_i \ln K_{p,i} \quad \text{so that} \quad
          M_{S,q} \le 6\, \mathrm{dB}

in all postures q, since the bandwidth of an axis is nearly K_p / 2 pi, and for 95 % of the robots drawn from a fit in
all of them. From the fastest of a few rules (velocity loops at a part of the first mode, position loops slower by a
factor of 4 to 32) that keeps the limit, by sequential quadratic programming over the logarithms, with exact slopes of
M_S in parts of the band of each posture; a notch is added where the sensitivity of an axis is at its limit and the
bandwidth gains by it. Each result is slowed down, the position loops or all loops together, until these are stable and
keep the limit; of several the one with the largest bandwidths is kept. Slower is not always safer: gravity makes a
posture fall over that slow loops do not hold.

The controller is, axis by axis, with filters N and L and a delay of d samples,

.. math:: F = K_v \Bigl(K_p + \frac{1 - z^{-1}}{T_s}\Bigr) \Bigl(1 + \frac{T_s}{T_i} \frac{z^{-1}}{1 - z^{-1}}\Bigr)
          \prod N \, L \, z^{-d}, \qquad T_i = 1 / K_p

so that the loop has a double zero at K_p: a disturbance dies out as fast as a reference is followed.

Loops of a study: today's controller, as stated, and the designed one.

A controller on the identified robot: peaks, with 95 % of the draws, and bandwidths in every posture.

Each peak within half a dB of the largest is traced to the axis that has most of it and to the nearest mode of the
robot, its motors free, that moves the motor of this axis; one that is farther than a third from every mode is left to
the phase of the loop: to its gains at low frequencies, to delay, sampling and filters at high ones.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np
from scipy.optimize import minimize

from elastid.base.arrays import ComplexArray, FloatArray, IntArray, frozen_value, labelled
from elastid.base.errors import FitError
from elastid.fit.result import Result
from elastid.linear.equilibrium import equilibrium
from elastid.record import JointLoop
from elastid.simulation.controller import Filters, filters_of, gains_of, low_pass, notch
from elastid.simulation.spec import ControllerSpec, GainsSpec, NotchSpec
from elastid.use.closed_loops import LIMIT_DB, Closed, PlantMode, Plants, PostureFamily, Scene, scaled

WIDTHS, DEPTHS = (0.15, 3.0), (0.05, 1.0)  # of notches
LOWEST, HIGHEST = 2e-3, 0.45  # of a notch over the rate
CORNER = 0.4  # largest of a low pass over the rate
MAX_NOTCHES = 2  # of an axis
_BANDS = 10  # parts of the grid whose peaks are limited each by itself
_ROUNDS, _STEPS, _REACH = 8, 12, 0.5  # of the search: each within e^0.5 of where it starts
_NEAR, _MOVED = 1 / 3, 5e-3  # of a frequency within which, and of the motor's motion by which, a mode makes a peak
_SLOWER, _SLOWEST = 0.98, 200  # factor and most steps of slowing down


@frozen_value(eq=False)
class Cascade:
    """K_p, K_v and corner of the low pass (n_u,), all positive, and notches (n, 3) of the motors `axes` (n,).

    delay: in samples.
    """

    position_gain: FloatArray = labelled("gain of the position loop", "1/s", "joints")
    velocity_gain: FloatArray = labelled("gain of the velocity loop, link side", "SI", "joints")
    low_pass_hz: FloatArray = labelled("corner of the low pass", "Hz", "joints")
    delay: int
    notches: FloatArray = labelled("frequency in Hz, width, depth", "", "axes quantity")
    axes: tuple[int, ...] = ()

    @property
    def vector(self) -> FloatArray:
        """x (n_x,): logarithms of all numbers."""
        parts = self.position_gain, self.velocity_gain, self.low_pass_hz, self.notches.ravel()
        return np.log(np.concatenate(parts))

    @property
    def owners(self) -> IntArray:
        """Axis of each of x."""
        return np.concatenate([*[np.arange(len(self.velocity_gain))] * 3, np.repeat(np.array(self.axes, int), 3)])

    def at(self, x: FloatArray) -> "Cascade":
        """Cascade with other numbers."""
        p, v, corner, rest = np.split(np.exp(x), np.cumsum([len(self.velocity_gain)] * 3))
        return replace(self, position_gain=p, velocity_gain=v, low_pass_hz=corner, notches=rest.reshape(-1, 3))

    def bounds(self, reach: float, rate_hz: float) -> tuple[FloatArray, FloatArray]:
        """Bounds of x, within `reach` of its own and with filters that can be."""
        x, n = self.vector, len(self.velocity_gain)
        low, high = x - reach, x + reach
        high[2 * n : 3 * n] = np.minimum(high[2 * n : 3 * n], np.log(CORNER * rate_hz))
        ends = np.log([[LOWEST * rate_hz, HIGHEST * rate_hz], WIDTHS, DEPTHS]).T
        low[3 * n :] = np.maximum(low[3 * n :].reshape(-1, 3), ends[0]).ravel()
        high[3 * n :] = np.minimum(high[3 * n :].reshape(-1, 3), ends[1]).ravel()
        return np.minimum(low, x), np.maximum(high, x)

    def slower(self, position: float, velocity: float) -> "Cascade":
        """Cascade with position and velocity gains of all axes times factors; filters stay."""
        return replace(self, position_gain=position * self.position_gain, velocity_gain=velocity * self.velocity_gain)

    @property
    def gains(self) -> JointLoop:
        """Gains as a simulation takes them."""
        return JointLoop(self.position_gain * self.velocity_gain, self.velocity_gain, self.position_gain)

    def filters(self, rate_hz: float) -> Filters:
        """Notches, low pass and delay."""
        sections = [[low_pass(corner, rate_hz)] for corner in self.low_pass_hz]
        for axis, row in zip(self.axes, self.notches, strict=True):
            sections[axis].insert(-1, notch(row[0], row[1], row[2], rate_hz))
        return Filters(tuple(sections), self.delay)

    def response(self, freq_hz: FloatArray, rate_hz: float) -> ComplexArray:
        """F (..., n_u) at freq_hz (...)."""
        return self.gains.response(freq_hz, rate_hz) * self.filters(rate_hz).response(freq_hz, rate_hz)

    def log_slopes(self, freq_hz: FloatArray, rate_hz: float) -> ComplexArray:
        r"""d ln F_i / dx (..., n_x), i the axis of each of x; axes answer independently.

        .. math:: L = \frac{1}{s^2 + \sqrt 2 s + 1}, \quad N = \frac{s^2 + d w s + 1}{s^2 + w s + 1}, \quad
                  s = \frac{1 - z^{-1}}{1 + z^{-1}} \Big/ \tan\frac{\omega}{2 f_s}
        """
        backward = 1 - np.exp(-2j * np.pi * freq_hz[..., None] / rate_hz)
        centre, width, depth = self.notches.T

        def scaled_s(of_filter_hz: FloatArray) -> tuple[ComplexArray, FloatArray]:
            """s (..., n), and d ln s / d ln omega (n,)."""
            omega = 2 * np.pi * of_filter_hz / rate_hz
            return backward / (2 - backward) / np.tan(omega / 2), -omega / np.sin(omega)

        def slope(s: ComplexArray, w: FloatArray | float) -> ComplexArray:
            """d ln (s^2 + w s + 1) / d ln s."""
            return np.asarray((2 * s**2 + w * s) / (s**2 + w * s + 1))

        integral = self.position_gain / rate_hz * (1 - backward) / backward
        of_position = self.position_gain / (self.position_gain + rate_hz * backward) + integral / (1 + integral)
        (low, low_rate), (s, rate) = scaled_s(self.low_pass_hz), scaled_s(centre)
        above, below = (w * s / (s**2 + w * s + 1) for w in (depth * width, width))
        of_centre = (slope(s, depth * width) - slope(s, width)) * rate
        of_notches = np.stack([of_centre, above - below, above], axis=-1).reshape(*freq_hz.shape, -1)
        of_corner = -slope(low, math.sqrt(2)) * low_rate
        return np.concatenate([of_position, np.ones_like(of_position), of_corner, of_notches], axis=-1)

    def on(self, scene: Scene) -> Closed:
        """The loops that it closes."""
        return scene.closed(self.gains, self.filters(scene.plants.rate_hz))

    def reached(self, scene: Scene) -> float:
        """Mean over the axes of the logarithm of the bandwidth, the smallest of all plants."""
        return float(np.log(self.on(scene).bandwidth_hz.min(axis=0)).mean())

    def to_spec(self, joints: Sequence[str]) -> ControllerSpec:
        """Controller as a study has it, to six digits."""

        def rounded(values: FloatArray) -> tuple[float, ...]:
            return tuple(float(f"{value:.6g}") for value in values)

        pairs = zip(self.axes, self.notches, strict=True)
        notches = tuple(NotchSpec(joints[axis], *rounded(row)) for axis, row in pairs)
        parts = self.position_gain, self.velocity_gain, 1 / self.position_gain, self.low_pass_hz
        position, velocity, integral, corner = map(rounded, parts)
        gains = GainsSpec(position, velocity, integral, notches, corner)
        return ControllerSpec(kind="cascade", gains=gains, delay_samples=self.delay)


def _keeps(scene: Scene, cascade: Cascade, limit_db: float) -> bool:
    loops = cascade.on(scene)
    return bool(20 * np.log10(loops.size.max()) <= limit_db and loops.stable.all())


def slowed(cascade: Cascade, is_accepted: Callable[[Cascade], bool], slowest: int = _SLOWEST) -> Cascade | None:
    """First slower copy of a controller that satisfies its limit, within a quarter of a step; None if no copy does."""
    for step in range(slowest):
        for factor in (0.0, 1.0):  # of the slowing that the velocity loops take part in

            def at(steps: float, factor: float = factor) -> Cascade:
                return cascade.slower(_SLOWER**steps, _SLOWER ** (factor * steps))

            if is_accepted(at(step)):
                finer = (at(step - part) for part in (0.75, 0.5, 0.25) if step)
                return next(filter(is_accepted, finer), at(step))
    return None


def rules(plants: Plants, first_mode_hz: float, delay: int) -> Iterator[Cascade]:
    """Velocity bandwidths from 2 to 1/30 of the first mode, or of the limit by delay and sampling; gains by inertia."""
    top = 2 * np.pi * min(first_mode_hz, plants.rate_hz / (8 * (1 + delay)))
    inertia = np.exp(np.log(plants.inertia).mean(axis=0))
    corner = np.full(len(inertia), 0.3 * plants.rate_hz)
    for omega in top * np.geomspace(2.0, 1 / 30, 13):
        for ratio in (4.0, 8.0, 16.0, 32.0):
            gain = np.full(len(inertia), omega / ratio)
            yield Cascade(gain, inertia * omega, corner, delay, np.zeros((0, 3)))


def design(scene: Scene, first_mode_hz: float, delay: int, limit_db: float = LIMIT_DB) -> Iterator[Cascade]:
    """Better and better controllers that keep the limit on all plants; FitError where no gain does."""
    feasible = [cascade for cascade in rules(scene.plants, first_mode_hz, delay) if _keeps(scene, cascade, limit_db)]
    best = max(feasible, key=lambda cascade: cascade.reached(scene), default=None)
    if best is None:
        raise FitError(
            "use/gains",
            f"no gains keep the sensitivity below {limit_db:.3g} dB in all postures with a delay of {delay} samples at "
            f"{scene.plants.rate_hz:g} Hz: raise the rate, or leave out the posture that falls over fastest",
        )
    yield best
    best = searched(scene, best, limit_db) or best
    yield best
    for _ in range(MAX_NOTCHES * len(best.velocity_gain)):
        candidates = [searched(scene, cascade, limit_db, rounds=2) for cascade in _with_notch(scene, best)]
        start = max(filter(None, candidates), key=lambda cascade: cascade.reached(scene), default=best)
        gained = searched(scene, start, limit_db) or best
        if gained.reached(scene) < best.reached(scene) + 0.02:  # a notch is kept for 2 % of bandwidth
            return
        best = gained
        yield best


def _with_notch(scene: Scene, best: Cascade) -> Iterator[Cascade]:
    """Cascades with a shallow notch more for one axis, below and above the peak that it has most part in."""
    left, size, right = np.linalg.svd(scaled(best.on(scene).S, scene.plants.inertia))
    parts = np.abs(left[..., 0] * right[..., 0, :]) * size[..., :1]
    for axis in range(len(best.velocity_gain)):
        if best.axes.count(axis) >= MAX_NOTCHES:
            continue
        freq_hz = scene.freq_hz[np.unravel_index(int(parts[..., axis].argmax()), parts.shape[:2])]
        for ratio in (0.8, 1.25):
            row = np.array([[min(freq_hz * ratio, HIGHEST * scene.plants.rate_hz), 0.7, 0.7]])
            yield replace(best, notches=np.vstack([best.notches, row]), axes=(*best.axes, axis))


def searched(scene: Scene, start: Cascade, limit_db: float, rounds: int = _ROUNDS) -> Cascade | None:
    """The best that rounds of sequential quadratic programming find; None for a start that no slowing helps."""

    def is_accepted(cascade: Cascade) -> bool:
        return _keeps(scene, cascade, limit_db)

    @lru_cache(maxsize=2)
    def known(x: bytes) -> tuple[FloatArray, FloatArray]:
        return sensitivity_margin(scene, start.at(np.frombuffer(x)), limit_db)

    n = len(start.velocity_gain)
    uphill = np.eye(n, len(start.vector)).sum(axis=0) / n  # the mean of ln K_p over the axes
    best, reach = slowed(start, is_accepted), _REACH
    if best is None:
        return None
    for _ in range(rounds):
        low, high = best.bounds(reach, scene.plants.rate_hz)
        optimum = minimize(
            lambda x: (-uphill @ x, -uphill), best.vector, jac=True, method="SLSQP",
            bounds=list(zip(low, high, strict=True)), options={"maxiter": _STEPS, "ftol": 1e-5},
            constraints={
                "type": "ineq", "fun": lambda x: known(x.tobytes())[0], "jac": lambda x: known(x.tobytes())[1],
            },
        )  # fmt: skip
        trial = (
            slowed(best.at(np.clip(optimum.x, low, high)), is_accepted, 20) if np.isfinite(optimum.x).all() else None
        )
        gained = (trial or best).reached(scene) - best.reached(scene)
        best = trial if trial and gained > 0 else best
        reach /= 3 if gained < 0.005 else 1
        if reach < 0.05:
            break
    return best


def sensitivity_margin(scene: Scene, form: Cascade, limit_db: float) -> tuple[FloatArray, FloatArray]:
    """Limit less M_S in dB, of each part of the band of each plant, and its slopes to the logarithms x."""
    freq_hz, rate_hz, root = scene.freq_hz, scene.plants.rate_hz, np.sqrt(scene.plants.inertia)
    closed = form.on(scene)
    S, sizes = closed.S, closed.size
    parts = np.array_split(np.arange(sizes.shape[1]), _BANDS)
    lines = np.array([part[size[part].argmax()] for size in sizes for part in parts])
    rows = np.repeat(np.arange(len(sizes)), _BANDS)
    left_db = limit_db - 0.02 - 20 * np.log10(sizes[rows, lines])
    # d sigma = -Re u^H S dF P S v in scaled coordinates.
    at, scale, owners = S[rows, lines], root[rows], form.owners
    left, sigma, right = np.linalg.svd(at / scale[:, :, None] * scale[:, None, :])
    before = np.einsum("ki,kij->kj", left[:, :, 0].conj() / scale, at)
    after = np.einsum("kij,kjl,kl->ki", scene.P[rows, lines], at, right[:, 0].conj() * scale)
    through = before * form.response(freq_hz[rows, lines], rate_hz) * after
    slopes = -(through[:, owners] * form.log_slopes(freq_hz[rows, lines], rate_hz)).real / sigma[:, :1]
    if not closed.stable.all():  # a step too far counts as farther than any limit
        left_db = left_db - 60
    return left_db, np.asarray(-20 / np.log(10) * slopes)


def robust(estimate: Plants, draws: Plants | None, first_mode_hz: float, delay: int) -> Cascade:
    """The design that keeps the limit on the estimate and on 95 % of D draws.

    draws: D times as many plants as the estimate has, or none.  FitError where no gains do.
    """
    limit_db, Q, scene = LIMIT_DB, len(estimate), Scene.of(estimate)
    fine = Scene.of(estimate, lines=600, per_mode=41)
    scene_of_draws = None if draws is None else Scene.of(draws, lines=120, per_mode=9)

    def excess(cascade: Cascade) -> float:
        """dB by which the peak of the estimate, or the 95 % quantile of the draws, is above the limit."""
        peaks = [float(cascade.on(fine).peaks_db.max())]
        if scene_of_draws is not None:
            of_draws = cascade.on(scene_of_draws).peaks_db.reshape(-1, Q).max(axis=1)
            peaks.append(float(np.quantile(of_draws, 0.95, method="higher")))
        return max(peaks) - LIMIT_DB

    candidates: list[Cascade] = []
    for turn in range(3):  # designs with limits that are lowered by what the draws exceed
        better = [searched(scene, candidates[-1], limit_db)] if turn else design(scene, first_mode_hz, delay, limit_db)
        candidates += filter(None, better)
        if (above := excess(candidates[-1])) <= 0:
            break
        limit_db -= min(above + 0.01, 1.5)
    # Slowing may cost one of them half its bandwidth, and another nothing.
    safe = [
        result for start in candidates if (result := slowed(start, lambda cascade: excess(cascade) <= 0)) is not None
    ]
    if not safe:
        raise FitError("use/gains", "no gains keep the sensitivity below 6 dB for 95 % of the posterior samples")
    return max(safe, key=lambda cascade: cascade.reached(scene))


@frozen_value
class LoopState:
    """A controller in Q postures of n_u axes, with the ends of 95 % of the draws (NaN without draws).

    peak_db (Q,): M_S, infinite where a loop is unstable.  limited_by (Q,): its cause.  bandwidth_hz (Q, n_u).
    drawn_peaks_db (D,): of each draw over all postures.  freq_hz, sensitivity_db (Q, K): of a figure.
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
    freq_hz: FloatArray = labelled("frequency", "Hz", "postures line")
    sensitivity_db: FloatArray = labelled("largest sensitivity", "dB", "postures line")


def assess(
    name: str, family: PostureFamily, drawn: Plants | None, gains: JointLoop, filters: Filters | None
) -> LoopState:
    """A controller of gains (n_u,) or (Q, n_u) in the Q postures of a family; drawn: D times as many plants."""
    plants, axes = family.estimate, family.axes
    loops = Scene.of(plants, 600, 41).closed(gains, filters)
    causes = tuple("; ".join(_causes(loops, q, modes, axes)) for q, modes in enumerate(family.modes))
    peaks, bandwidth = loops.peaks_db, loops.bandwidth_hz
    ends, drawn_peaks = np.full((2, *peaks.shape), np.nan), np.zeros(0)
    if drawn is not None:
        D = len(drawn) // len(plants)
        tiled = gains.gain_derivatives(lambda part: np.tile(np.broadcast_to(part, bandwidth.shape), (D, 1)))
        of_draws = Scene.of(drawn, 120, 9).closed(tiled, filters).peaks_db.reshape(D, -1)
        # Sorted: quantiles of infinities would be NaN.
        ends = np.sort(of_draws, axis=0)[[int(0.025 * (D - 1)), int(np.ceil(0.975 * (D - 1)))]]
        drawn_peaks = of_draws.max(axis=1)
    size_db, postures = 20 * np.log10(loops.size), tuple(posture.name for posture in family.configurations)
    return LoopState(
        name, postures, axes, peaks, ends[0], ends[1], causes, bandwidth, drawn_peaks, loops.scene.freq_hz, size_db
    )


def _causes(loops: Closed, q: int, modes: tuple[PlantMode, ...], axes: tuple[str, ...]) -> Iterator[str]:
    size, root = np.pad(loops.size[q], 1, constant_values=0.0), np.sqrt(loops.scene.plants.inertia[q])
    peaks = np.flatnonzero((size[1:-1] >= size[:-2]) & (size[1:-1] > size[2:]))
    # A peak within 0.5 dB of the largest one limits the gains as well.
    binding = peaks[loops.size[q, peaks] >= loops.size[q].max() * 10 ** (-0.5 / 20)]
    for line in binding if loops.stable[q] else [int(loops.size[q].argmax())]:
        freq_hz = float(loops.scene.freq_hz[q, line])
        left, _, right = np.linalg.svd(loops.S[q, line] / root[:, None] * root)
        i = int(np.abs(left[:, 0] * right[0]).argmax())
        movers = [mode for mode in modes if mode.motor_amplitudes[i] >= _MOVED]
        near = min(movers, key=lambda mode: abs(np.log(mode.freq_hz / freq_hz)), default=None)
        if not loops.stable[q]:
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
    """Present gains (None if the study lacks them), designed gains, and number of posterior samples (count)."""

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


def todays_loops(family: PostureFamily, drawn: Plants | None, spec: ControllerSpec) -> LoopState:
    """A controller in all postures; its gains may follow from a bandwidth, which is another in each."""
    model, theta = family.family.model, family.family.theta
    first, *others = (gains_of(model, equilibrium(model, theta, posture).q, spec) for posture in family.configurations)
    gains = first.gain_derivatives(lambda *parts: np.array(parts), *others)
    return assess(TODAY, family, drawn, gains, filters_of(family.axes, spec, family.rate_hz))


def design_loops(
    name: str, result: Result, family: PostureFamily, delay_samples: int, draws: int, seed: int,
    today: ControllerSpec | None = None, today_hz: float | None = None,
) -> Loops:  # fmt: skip
    """Loops at the rate of a family of the fit; FitError where no gains keep the limit in all its postures.

    delay_samples: of the loops that are designed.  draws: of the fit, with their seed.  today: the controller that the
    study states; today_hz: its rate, where it is another.
    """

    def drawn_of(family: PostureFamily) -> Plants | None:
        return family.draws(result, draws, seed) if draws else None

    state, drawn = None, drawn_of(family)
    if today is not None:
        variant = replace(family, rate_hz=today_hz) if today_hz else family
        is_same = variant.rate_hz == family.rate_hz
        state = todays_loops(family, drawn, today) if is_same else todays_loops(variant, drawn_of(variant), today)
    first_hz = min((mode.freq_hz for modes in family.modes for mode in modes), default=family.rate_hz)
    cascade = robust(family.estimate, drawn, first_hz, delay_samples)
    designed = assess(DESIGNED, family, drawn, cascade.gains, cascade.filters(family.rate_hz))
    return Loops(name, family.axes, family.rate_hz, draws, state, designed, cascade)
