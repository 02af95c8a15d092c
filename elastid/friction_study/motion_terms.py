r"""A log of one axis: its signals behind the filter of a regression, and the columns of the parts that its data show.

The filter has a finite length: a sample that a wrong model spoils, as while a joint sticks, spoils only its neighbours,
and the equations of all others hold exactly (modulating functions: Shinbrot, Trans. ASME 79, 1957). Of a sample that is
not used stands the reason.

Parts are Stribeck effect, ripple, load, heat, delay. A spring between motor and link, behind which J_l of the inertia
moves, has a column far below its frequency omega:

.. math:: J \ddot q + J_l (H - 1) \ddot q \approx J \ddot q - \frac{J_l}{\omega^2} \ddddot q, \qquad
          H(s) = \frac{\omega^2}{s^2 + \omega^2}
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.polynomial.legendre import legval, legvander
from scipy.interpolate import BSpline, make_interp_spline
from scipy.ndimage import maximum_filter1d
from scipy.signal import butter, resample_poly, sosfiltfilt, upfirdn

from elastid.base.arrays import BoolArray, FloatArray, frozen_value
from elastid.base.errors import DataError
from elastid.base.statistics import f_test
from elastid.friction_study.laws import DECAY_RANGE_K, EXPONENTS, MAX_COST, START_DECAY_K, TEMPERATURE_STEP_K
from elastid.friction_study.least_squares import FALSE_ALARM, Equations, Regression, solve
from elastid.friction_study.passes import (
    N_WAVES,
    PASSES,
    Plateau,
    find_plateaus,
    harmonic_peaks,
    turn_waves,
    wave_names,
)


@frozen_value
class Motion:
    """A log of one axis on one side: position (n,) in rad or m, torque (n,) in Nm or N, at rate_hz.

    turns_against_gravity: True if the torque of gravity changes with the angle.  turn: of the joint for one of its
    motor, 0 for none.  load: |torque| that the joint carries.  temperature (n,): degC, None where none was logged.
    torque_delay_s: by which the torque acts later than its position was read.
    """

    place: str
    rate_hz: float
    position: FloatArray
    torque: FloatArray
    slides: bool = False
    turns_against_gravity: bool = False
    turn: float = 0.0
    load: float = 0.0
    temperature: FloatArray | None = None
    torque_delay_s: float = 0.0

    @property
    def acting_position(self) -> FloatArray:
        """The position (n,) where the torque acts: a command that is held acts half a sample later."""
        if self.torque_delay_s == 0:
            return self.position
        samples = np.arange(len(self.position))
        lag = self.torque_delay_s * self.rate_hz
        return np.asarray(make_interp_spline(samples, self.position, k=5)(samples + lag))

    def __post_init__(self) -> None:
        if self.position.shape != self.torque.shape or self.position.ndim != 1:
            raise ValueError(f"motion of {self.place}: position {self.position.shape}, torque {self.torque.shape}")


@dataclass(frozen=True)
class MotionSignals:
    """A motion at full rate (n,) behind the filter of derivatives; direction: sgn of the velocity.

    derivatives (2, n): of the position as logged, which the filter of both sides smooths.
    taps: the filter of both sides.  kept: the samples of the filtered equation, thinned, without the ends.
    """

    motion: Motion
    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    derivatives: FloatArray
    direction: FloatArray
    taps: FloatArray
    kept: slice
    passband_hz: float

    @classmethod
    def of(cls, motion: Motion, passband_hz: float) -> MotionSignals:
        """Those of a motion; DataError where it is too short, or sampled too slowly, for the passband."""
        rate = motion.rate_hz
        if not passband_hz < rate / 4:
            raise DataError(
                "friction/motion",
                f"a passband of {passband_hz:g} Hz needs a rate above {4 * passband_hz:g} "
                f"Hz, and it has {rate:g} Hz; lower the passband",
                f"motion of {motion.place}",
            )
        spoilt = round(6.0 / passband_hz * rate)  # samples at either end, six periods of the passband
        if len(motion.position) < 4 * spoilt:
            raise DataError(
                "friction/motion",
                f"{len(motion.position) / rate:.3g} s are too short for a passband of "
                f"{passband_hz:g} Hz, which spoils {spoilt / rate:.3g} s at either end; record longer, or raise it",
                f"motion of {motion.place}",
            )
        smooth = butter(4, min(3.0 * passband_hz, 0.45 * rate), fs=rate, output="sos")
        acting = motion.acting_position
        position = np.asarray(sosfiltfilt(smooth, acting))
        # Central differences would take 43 % of an acceleration at a fifth of the rate.
        samples = np.arange(len(position))
        spline = make_interp_spline(samples / rate, position, k=5)
        logged = make_interp_spline(samples / rate, acting, k=5)
        derivatives = np.stack([logged(samples / rate, nu=order) for order in (1, 2)])
        # A jump between two samples is sampled as its part within the band is.
        # Samples of jumps in a period of the passband.
        finer = max(1, int(np.ceil(100.0 * passband_hz / rate)))
        instants = np.arange(finer * len(position)) / (finer * rate)
        velocity = np.asarray(spline(instants, nu=1))
        direction = resample_poly(np.sign(velocity), 1, finer, padtype="line")
        taps = b_spline_taps(rate, passband_hz)
        kept = slice(spoilt, len(position) - spoilt, max(1, int(rate / (4 * passband_hz))))
        acceleration = np.asarray(spline(samples / rate, nu=2))
        return cls(motion, position, velocity[::finer], acceleration, derivatives, direction, taps, kept, passband_hz)

    def filtered(self, column: FloatArray) -> FloatArray:
        """A side of the equation (n, ...) behind the filter, at the samples that are kept."""
        return filtered(column, self.taps, self.kept)

    @property
    def kept_hz(self) -> float:
        """The rate of the samples that are kept."""
        return self.motion.rate_hz / int(self.kept.step)

    @property
    def rests(self) -> BoolArray:
        """At full rate (n,), true at rest."""
        speed = np.abs(self.velocity)
        return np.asarray(speed < PASSES.rest_share * speed.max())

    @cached_property
    def slides(self) -> BoolArray:
        """At full rate (n,), true where neither rest nor a reversal is within the filter."""
        sign = np.sign(self.velocity)
        turns = np.append(False, sign[1:] != sign[:-1])
        # The derivatives of a spline reach 4 samples.
        return ~within(self.rests | turns, len(self.taps) // 2 + 4)

    @cached_property
    def used(self) -> BoolArray:
        """Of the samples that are kept (k,), those that slide; all, where hardly any does."""
        slides = self.slides[self.kept]
        # All are used where fewer than a fifth slide clear of reversals.
        return slides if slides.mean() > 0.2 else np.ones_like(slides)

    @property
    def seconds(self) -> dict[str, float]:
        """Durations that add up to that of the log: in the regression, and why the others are not."""
        inside = np.zeros(len(self.position), bool)
        inside[self.kept.start : self.kept.stop] = True
        slides = self.slides if not self.used.all() else inside
        parts = {
            "used": inside & slides,
            "at rest": inside & ~slides & self.rests,
            "near a reversal or rest": inside & ~slides & ~self.rests,
            "ends of the log": ~inside,
        }
        return {name: float(part.sum()) / self.motion.rate_hz for name, part in parts.items()}

    @property
    def plateaus(self) -> tuple[Plateau, ...]:
        """Where it slides steadily."""
        return find_plateaus(self.velocity, self.acceleration, self.motion.rate_hz)

    def moves(self, direction: int) -> bool:
        """True if it moves that way (1, -1) faster than 2 % of its highest speed for 2 % of the time."""
        inside = self.velocity[self.kept.start : self.kept.stop]
        return bool(np.mean(direction * inside > 0.02 * np.abs(inside).max()) > 0.02)


# Boxes whose convolution the taps are, and their width over a period of the passband for -3 dB at its end.
_BOXES, _WIDTH = 6, 0.1863


def b_spline_taps(rate_hz: float, passband_hz: float) -> FloatArray:
    r"""Taps (2 h + 1,) of unit sum: |H(f)| = |sinc(w f)|^6 with w = 0.1863 / passband."""
    half = _BOXES / 2 * _WIDTH * rate_hz / passband_hz  # samples
    h = max(1, int(half))
    spline = BSpline.basis_element(np.linspace(-half, half, _BOXES + 1), extrapolate=False)
    taps = np.nan_to_num(spline(np.arange(-h, h + 1)))
    return np.asarray(taps / taps.sum())


def filtered(column: FloatArray, taps: FloatArray, kept: slice) -> FloatArray:
    """The samples of a slice, further than half the filter from the ends, of a column (n, ...) along its first axis."""
    h = len(taps) // 2
    before = h + -2 * h % kept.step  # a whole number of steps before the end of the taps
    sums = upfirdn(taps, column[kept.start - before : kept.stop + h], 1, kept.step, axis=0)
    first = (before + h) // kept.step
    return np.asarray(sums[first : first + len(range(kept.start, kept.stop, kept.step))])


def within(samples: BoolArray, reach: int) -> BoolArray:
    """True for each sample (n,) with one of the given ones at most `reach` samples away."""
    return np.asarray(maximum_filter1d(samples.astype(np.uint8), 2 * reach + 1, mode="constant") > 0)


# Numbers by which friction changes with temperature.
HEAT = ("temperature.coulomb", "temperature.viscous")
# Polynomials of the angle by which dry friction may change.
ANGLE = ("angle.1", "angle.2", "angle.3", "angle.4")
# Stribeck velocities that are tried, as shares of the highest speed.
_VELOCITIES = np.geomspace(0.01, 0.4, 12)


@dataclass(frozen=True)
class MotionTerms:
    """Parts of a regression besides rigid body, Coulomb and viscous friction: those that data show.

    stribeck_velocity: 0 without a Stribeck effect, of an exponent.  waves: of `turn_waves`.  heat: of HEAT,
    about `reference` in degC, between ends `measured`; decay: T_V in K, searched for if is_decay_free.  power: of the
    speed in quadratic friction, 2 but for a test.  angles: ends of those over which dry friction changes, empty where
    it does not.  spring: between motor and link.
    """

    apart: bool = True
    delay: bool = False
    stribeck_velocity: float = 0.0
    waves: tuple[int, ...] = ()
    load: bool = False
    heat: tuple[str, ...] = ()
    reference: float = 0.0
    measured: tuple[float, float] | None = None
    decay: float = START_DECAY_K
    is_decay_free: bool = False
    exponent: float = EXPONENTS[-1]
    quadratic: bool = False
    power: float = 2.0
    angles: tuple[float, ...] = ()
    spring: bool = False

    def at(self, numbers: Regression) -> MotionTerms:
        """Those of a regression with these parts, which has found its own nonlinear numbers."""
        ends = {name: numbers[name] for name in self.searched if name in numbers.names}
        return replace(self.moved(ends), apart="directions.viscous" in numbers.names)

    @property
    def searched(self) -> dict[str, float]:
        """Nonlinear numbers by name, which are searched for."""
        stribeck = {"stribeck_velocity": self.stribeck_velocity} if self.stribeck_velocity else {}
        return stribeck | ({"temperature.decay": self.decay} if self.is_decay_free else {})

    def moved(self, ends: Mapping[str, float]) -> MotionTerms:
        """With other nonlinear numbers."""
        velocity = ends.get("stribeck_velocity", self.stribeck_velocity)
        return replace(self, stribeck_velocity=velocity, decay=ends.get("temperature.decay", self.decay))


def shown_terms(signals: Sequence[MotionSignals]) -> MotionTerms:
    """The parts that the data show beyond chance, one after the other."""
    terms = MotionTerms(load=len({each.motion.load for each in signals}) > 1)
    if terms.load:
        terms = replace(terms, load=regressed(signals, terms).chance("load.coulomb", 1) < FALSE_ALARM)
    if signals[0].motion.turn > 0:
        terms = replace(terms, waves=_waves(signals, terms))
    delayed = replace(terms, delay=True)
    fit = regressed(signals, delayed)
    # Of more than a sample it is an error of the model, to which the motion has reacted in closed loop.
    if fit.chance("delay", 0) < FALSE_ALARM and abs(fit["delay"]) * signals[0].motion.rate_hz < 1:
        terms = delayed
    return _curve(signals, _by_angle(signals, _heat(signals, terms)))


def _by_angle(signals: Sequence[MotionSignals], terms: MotionTerms) -> MotionTerms:
    """With dry friction over the angle, if a Legendre polynomial shows, and all change it enough to matter."""
    ends = min(float(each.position.min()) for each in signals), max(float(each.position.max()) for each in signals)
    wider = replace(terms, angles=ends)
    fit = regressed(signals, wider)
    chance = min(fit.chance(name, 0) for name in ANGLE)
    change = np.ptp(legval(np.linspace(-1, 1, 101), [0.0, *(fit[name] for name in ANGLE)]))
    matters = change > PASSES.min_change * abs(fit["coulomb"])
    return wider if matters and chance * len(ANGLE) < FALSE_ALARM else terms


def _curve(signals: Sequence[MotionSignals], terms: MotionTerms) -> MotionTerms:
    """With quadratic friction, which brakes, a Stribeck effect or both, beginning with the one that explains more."""
    for _ in range(2):
        curves = {}
        if not terms.stribeck_velocity and (velocity := _stribeck_velocity(signals, terms)):
            falling = replace(terms, stribeck_velocity=velocity)
            curves[falling] = regressed(signals, falling)
        bent = replace(terms, quadratic=True)
        fit = regressed(signals, bent)
        if not terms.quadratic and fit.chance("quadratic", 1) < FALSE_ALARM:
            curves[bent] = fit
        terms = min(curves, key=lambda curve: curves[curve].sum_of_squares, default=terms)
    if not terms.stribeck_velocity:
        return terms
    fits = {a: regressed(signals, replace(terms, exponent=a)) for a in EXPONENTS}
    best = min(EXPONENTS, key=lambda a: fits[a].sum_of_squares)
    held = fits[EXPONENTS[-1]]
    is_other = held.sum_of_squares > fits[best].sum_of_squares * (1 + MAX_COST / _independent(signals, held))
    return replace(terms, exponent=best).at(fits[best]) if is_other else terms.at(held)


def with_other_curves(signals: Sequence[MotionSignals], terms: MotionTerms, fit: Regression) -> Regression:
    """With the change to other curves over speed in the covariance, of those that are not excluded.

    They are of other exponents of a Stribeck effect, of a power of 1.5 instead of quadratic friction, and of a Stribeck
    effect that shows, but not beyond chance.
    """
    change, place, own_terms = np.zeros(len(fit.names)), fit.names.index("coulomb"), terms.at(fit)
    others = [replace(own_terms, exponent=exponent) for exponent in EXPONENTS if terms.stribeck_velocity]
    others += [replace(own_terms, power=1.5)] if terms.quadratic else []
    if not terms.stribeck_velocity:
        fastest = max(float(np.abs(each.velocity).max()) for each in signals)
        velocity = _best_velocity(signals, own_terms, _VELOCITIES * fastest)
        unseen = regressed(signals, replace(own_terms, stribeck_velocity=velocity), steps=0)
        shows = unseen.sum_of_squares * (1 + MAX_COST / _independent(signals, fit)) < fit.sum_of_squares
        if unseen["stiction"] > unseen["coulomb"] and shows:
            change = change_of(fit, unseen)
    limit = fit.sum_of_squares * (1 + MAX_COST / _independent(signals, fit))
    for curve in others:
        other = regressed(signals, curve)
        own = change_of(fit, other)
        if other.sum_of_squares < limit and abs(own[place]) > abs(change[place]):
            change = own
    return replace(fit, covariance=fit.covariance + np.outer(change, change))


def change_of(fit: Regression, other: Regression) -> FloatArray:
    """Of the numbers (n_x,) in the other regression; that of another power of the speed is another number."""
    shared = [name in other.names and name != "quadratic" for name in fit.names]
    return np.array([
        other[name] - fit[name] if is_shared else 0.0 for name, is_shared in zip(fit.names, shared, strict=True)
    ])  # fmt: skip


def _independent(signals: Sequence[MotionSignals], fit: Regression) -> float:
    """Independent residuals that their correlation leaves."""
    n = sum(int(each.used.sum()) for each in signals)
    return n * (1 - fit.correlation) / (1 + fit.correlation)


def _heat(signals: Sequence[MotionSignals], terms: MotionTerms) -> MotionTerms:
    """With the numbers of heat if one shows: without the other it would take that one's part."""
    degc = [each.motion.temperature for each in signals if each.motion.temperature is not None]
    if len(degc) < len(signals):
        return terms
    every = np.concatenate(degc)
    low, high = float(every.min()), float(every.max())
    terms = replace(terms, reference=float(every.mean()), measured=(low, high))
    if np.ptp(every) < TEMPERATURE_STEP_K:
        return terms
    alone = [regressed(signals, replace(terms, heat=(name,))).chance(name, 0) for name in HEAT]
    if min(alone) * len(HEAT) > FALSE_ALARM:
        return terms
    # Two temperatures identify no decay; held at one that was not measured, it makes f at the mean temperature wrong.
    between = np.mean(np.abs(every - (low + high) / 2) < (high - low) / 6)
    # Three temperatures at least have 5 % of the time in the middle third of all.
    terms = replace(terms, heat=HEAT, is_decay_free=bool(between > 0.05))
    return terms.at(regressed(signals, terms))


def _stribeck_velocity(signals: Sequence[MotionSignals], terms: MotionTerms) -> float:
    """The best one; 0 where two tests, for correlated residuals and for their sum of squares, find chance alone."""
    fastest = max(float(np.abs(each.velocity).max()) for each in signals)
    best = replace(terms, stribeck_velocity=_best_velocity(signals, terms, _VELOCITIES * fastest))
    without, fit = regressed(signals, terms), regressed(signals, best, steps=0)
    n_independent = _independent(signals, without)
    drop = without.sum_of_squares - fit.sum_of_squares
    chance = f_test(drop, 2, fit.sum_of_squares, max(1.0, n_independent - len(fit.names)))
    change = np.array([float(name == "stiction") - float(name == "coulomb") for name in fit.names])
    values, variance = np.array([change @ fit.values]), np.array([[change @ fit.covariance @ change]])
    # Few moments at low speed have few degrees of freedom; that they are no chance is the other test's to show.
    excess = replace(fit, names=("excess",), values=values, covariance=variance, dof=fit.dof.max(keepdims=True))
    if max(chance, excess.chance("excess", 1)) * len(_VELOCITIES) > FALSE_ALARM:
        return 0.0
    return regressed(signals, best)["stribeck_velocity"]


def _best_velocity(signals: Sequence[MotionSignals], terms: MotionTerms, velocities: FloatArray) -> float:
    """Of velocities (m,), that whose fall of stiction explains most of what a regression without it leaves."""
    _, logs = equations_of(signals, terms)
    X, y = (np.concatenate([getattr(log, name)[:, 0] for log in logs]) for name in ("X", "y"))
    falls = [each.direction[:, None] * np.exp(-((each.velocity[:, None] / velocities) ** 2)) for each in signals]
    filtered = [each.filtered(fall) * each.used[:, None] for each, fall in zip(signals, falls, strict=True)]
    Q = np.linalg.qr(X / np.maximum(np.linalg.norm(X, axis=0), 1e-300))[0]
    left, new = (side - Q @ (Q.T @ side) for side in (y, np.concatenate(filtered)))
    return float(velocities[np.argmax((left @ new) ** 2 / np.maximum(np.sum(new**2, axis=0), 1e-300))])


def _waves(signals: Sequence[MotionSignals], terms: MotionTerms) -> tuple[int, ...]:
    """Waves of the motor's turns that stand out of the residuals, and beyond chance of their neighbours in time."""
    fit, left, waves = regressed(signals, terms), [], []
    for each in signals:
        columns = columns_of(each, terms)
        left.append((each.filtered(each.motion.torque) - sum(fit[name] * columns[name] for name in columns))[each.used])
        of_turn = turn_waves(each.position, each.direction, each.motion.turn)
        waves.append((each.filtered(of_turn.real) + 1j * each.filtered(of_turn.imag))[each.used])
    peaks = tuple(np.flatnonzero(harmonic_peaks(np.concatenate(left), np.concatenate(waves))).tolist())
    if not peaks:
        return ()
    fit = regressed(signals, replace(terms, waves=peaks))
    chances = {wave: min(fit.chance(name, 0) for name in wave_names(wave)) for wave in peaks}
    return tuple(wave for wave, chance in chances.items() if chance * 2 * N_WAVES < FALSE_ALARM)


def regressed(signals: Sequence[MotionSignals], terms: MotionTerms, steps: int = 12) -> Regression:
    """steps: of the search for the Stribeck velocity, by its column in the Jacobian (Gauss and Newton)."""
    fit = _solved(signals, terms)
    for _ in range(steps if terms.searched else 0):
        fit = _solved(signals, terms, fit)
        start = terms.searched
        ends = {name: float(np.clip(x + fit[name], x / 2, 2 * x)) for name, x in start.items()}
        if "temperature.decay" in ends:
            ends["temperature.decay"] = float(np.clip(ends["temperature.decay"], *DECAY_RANGE_K))
        values = np.array([ends.get(name, fit[name]) for name in fit.names])
        fit, terms = replace(fit, values=values), terms.moved(ends)
        if all(abs(ends[name] - x) < 1e-3 * x for name, x in start.items()):
            break
    return fit


def _solved(signals: Sequence[MotionSignals], terms: MotionTerms, about: Regression | None = None) -> Regression:
    """about: the last numbers, where nonlinear ones are searched for, whose steps are then among the numbers."""
    names, logs = equations_of(signals, terms, about)
    return solve(logs, signals[0].kept_hz).of_joint(0, range(len(names)), names)


def equations_of(
    signals: Sequence[MotionSignals], terms: MotionTerms, about: Regression | None = None
) -> tuple[tuple[str, ...], list[Equations]]:
    """The names of the numbers, and the equations of each log."""
    columns, logs = [columns_of(each, terms, about) for each in signals], []
    for own, each in zip(columns, signals, strict=True):
        used = each.used[:, None]
        X = (np.stack(list(own.values()), axis=1) * used)[:, None, :]
        states = each.filtered(np.stack([each.position, each.velocity], axis=1))
        logs.append(Equations(X, np.zeros((len(X), 1, 0)), each.filtered(each.motion.torque)[:, None] * used, states))
    return tuple(columns[0]), logs


def columns_of(signals: MotionSignals, terms: MotionTerms, about: Regression | None = None) -> dict[str, FloatArray]:
    """Behind the filter; derivatives of the position as it was logged, whose filter reaches no further.

    The column of a delay is the rate of the torque as the other columns have it: that of the torque itself has the
    errors of the model in it, and makes all numbers wrong.
    """
    velocity, acceleration = signals.derivatives
    raw = full_rate_columns(signals, terms, about) | {"inertia": acceleration, "viscous": velocity}
    if terms.apart:
        raw["directions.viscous"] = np.sign(signals.velocity) * velocity
    columns = {name: signals.filtered(column) for name, column in raw.items()}
    if terms.delay:
        X, y = (
            np.stack(list(columns.values()), axis=1)[signals.used],
            signals.filtered(signals.motion.torque)[signals.used],
        )
        size = np.maximum(np.linalg.norm(X, axis=0), 1e-300)
        torque = np.stack(list(raw.values()), axis=1) @ (np.linalg.lstsq(X / size, y, rcond=None)[0] / size)
        columns["delay"] = signals.filtered(np.gradient(torque) * signals.motion.rate_hz)
    return columns


def full_rate_columns(
    signals: MotionSignals, terms: MotionTerms, about: Regression | None = None
) -> dict[str, FloatArray]:
    """The columns (n,) by the names of their numbers; about: numbers where those of nonlinear ones are derivatives."""
    v, s, q, motion = signals.velocity, signals.direction, signals.position, signals.motion
    columns = {"inertia": signals.acceleration, "viscous": v, "coulomb": s}
    if nu := terms.stribeck_velocity:
        x = np.abs(v / nu) ** terms.exponent
        fall = np.exp(-x)
        columns |= {"coulomb": s * (1 - fall), "stiction": s * fall}
        if about is not None:
            columns["stribeck_velocity"] = (about["stiction"] - about["coulomb"]) * s * fall * terms.exponent * x / nu
    if terms.load:
        columns["load.coulomb"] = motion.load * s
    if terms.spring:
        columns["spring"] = -np.gradient(np.gradient(signals.derivatives[1])) * signals.motion.rate_hz**2
    if terms.quadratic:
        columns["quadratic"] = v * np.abs(v) ** (terms.power - 1)
    if terms.angles:
        low, high = terms.angles
        waves = legvander(np.clip(2 * (q - low) / (high - low) - 1, -1, 1), len(ANGLE))
        columns |= {name: s * waves[:, k] for k, name in enumerate(ANGLE, start=1)}
    columns |= _columns_of_heat(signals, terms, about)
    ones = np.ones_like(v)
    columns |= {"directions.viscous": np.abs(v), "directions.coulomb": ones} if terms.apart else {"offset": ones}
    if motion.turns_against_gravity:
        columns |= {"gravity.cos": np.cos(q), "gravity.sin": np.sin(q)}
    for wave, column in zip(terms.waves, turn_waves(q, s, motion.turn, terms.waves).T, strict=True):
        columns |= dict(zip(wave_names(wave), (column.real, column.imag), strict=True))
    return columns


def _columns_of_heat(signals: MotionSignals, terms: MotionTerms, about: Regression | None) -> dict[str, FloatArray]:
    """Of a log without temperature at T_0."""
    v, T_V, columns = signals.velocity, terms.decay, dict[str, FloatArray]()
    degc = signals.motion.temperature
    theta = np.zeros_like(v) if degc is None else degc - terms.reference
    if "temperature.coulomb" in terms.heat:
        columns["temperature.coulomb"] = theta * signals.direction
    if "temperature.viscous" in terms.heat:
        columns["temperature.viscous"] = v * np.expm1(-theta / T_V)
        if terms.is_decay_free and about is not None:
            of_decay = v * np.exp(-theta / T_V) * theta / T_V**2
            columns["temperature.decay"] = about["temperature.viscous"] * of_decay
    return columns
