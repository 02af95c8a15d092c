r"""The columns of a regression of motions: one table for the axis that moves alone and those that move together.

Parts are Stribeck effect, ripple, load, heat, delay. A spring between motor and link, behind which J_l of the inertia
moves, has a column far below its frequency omega:

.. math:: J \ddot q + J_l (H - 1) \ddot q \approx J \ddot q - \frac{J_l}{\omega^2} \ddddot q, \qquad
          H(s) = \frac{\omega^2}{s^2 + \omega^2}
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.polynomial.legendre import legval, legvander

from elastid.base.arrays import FloatArray
from elastid.base.statistics import f_test
from elastid.friction.static import Conditions, slopes
from elastid.friction.static import columns as table
from elastid.friction_study.constant_velocity import N_WAVES, harmonic_peaks, turn_waves, wave_names
from elastid.friction_study.least_squares import FALSE_ALARM, Equations, Regression, solve
from elastid.friction_study.motion_signals import MIN_CHANGE, MotionLog, MotionSignals
from elastid.friction_study.static_model_fit import (
    DECAY_RANGE_K,
    EXPONENTS,
    MAX_COST,
    START_DECAY_K,
    TEMPERATURE_STEP_K,
)

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
    about `reference` in degC, between ends `measured`; decay: T_V in K, searched for if is_decay_free.  angles: ends of
    those over which dry friction changes, empty where it does not.  spring: between motor and link.  friction_only: the
    rigid body is taken out of the torque, or has columns of its own.
    """

    by_direction: bool = True
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
    angles: tuple[float, ...] = ()
    spring: bool = False
    friction_only: bool = False

    @property
    def law(self) -> tuple[str, ...]:
        """Linear numbers of friction, as `static.columns` has them."""
        shows = {"stiction": self.stribeck_velocity > 0, "load.coulomb": self.load}
        names = [name for name, is_shown in shows.items() if is_shown]
        return ("coulomb", "viscous", *names, *self.heat, *(("directions.viscous",) if self.by_direction else ()))

    @property
    def searched(self) -> dict[str, float]:
        """Nonlinear numbers by name, which are searched for."""
        stribeck = {"stribeck_velocity": self.stribeck_velocity} if self.stribeck_velocity else {}
        return stribeck | ({"temperature.decay": self.decay} if self.is_decay_free else {})

    def at(self, numbers: Regression) -> "MotionTerms":
        """Return terms with the nonlinear numbers of a regression with these parts, which has searched for its own."""
        return self.with_nonlinear({name: numbers[name] for name in self.searched if name in numbers.names})

    def with_nonlinear(self, ends: Mapping[str, float]) -> "MotionTerms":
        """Return terms with other nonlinear numbers."""
        velocity = ends.get("stribeck_velocity", self.stribeck_velocity)
        return replace(self, stribeck_velocity=velocity, decay=ends.get("temperature.decay", self.decay))


def select_terms(signals: Sequence[MotionSignals]) -> MotionTerms:
    """Return the parts that the data show beyond chance, one after the other."""
    if signals[0].motion.is_run_down:
        return _curve(signals, MotionTerms(by_direction=False, friction_only=True))
    terms = MotionTerms(load=len({signal.motion.load for signal in signals}) > 1)
    if terms.load:
        terms = replace(terms, load=regress(signals, terms).chance("load.coulomb", 1) < FALSE_ALARM)
    # Within less than a turn of the motor its waves are near to each other, and to what else depends on the angle.
    if 0 < signals[0].motion.turn <= max(float(np.ptp(axis.position)) for axis in signals):
        terms = replace(terms, waves=_waves(signals, terms))
    with_delay = replace(terms, delay=True)
    fit = regress(signals, with_delay)
    # Of more than a sample it is an error of the model, to which the motion has reacted in closed loop.
    if fit.chance("delay", 0) < FALSE_ALARM and abs(fit["delay"]) * signals[0].motion.rate_hz < 1:
        terms = with_delay
    return _curve(signals, _by_angle(signals, _heat(signals, terms)))


def _by_angle(signals: Sequence[MotionSignals], terms: MotionTerms) -> MotionTerms:
    """Return terms with dry friction over the angle, if a Legendre polynomial shows, and all change it enough."""
    ends = min(float(axis.position.min()) for axis in signals), max(float(axis.position.max()) for axis in signals)
    wider = replace(terms, angles=ends)
    fit = regress(signals, wider)
    chance = min(fit.chance(name, 0) for name in ANGLE)
    change = np.ptp(legval(np.linspace(-1, 1, 101), [0.0, *(fit[name] for name in ANGLE)]))
    return wider if change > MIN_CHANGE * abs(fit["coulomb"]) and chance * len(ANGLE) < FALSE_ALARM else terms


def _curve(signals: Sequence[MotionSignals], terms: MotionTerms) -> MotionTerms:
    """Return terms with a Stribeck effect, if one shows, of another exponent than 2 where that is excluded."""
    velocity = _stribeck_velocity(signals, terms)
    if not velocity:
        return terms
    falling = [replace(terms, stribeck_velocity=velocity, exponent=exponent) for exponent in EXPONENTS]
    fits = {speed: regress(signals, speed) for speed in falling}
    best, slowest = min(falling, key=lambda speed: fits[speed].sum_of_squares), falling[-1]
    is_other = fits[slowest].sum_of_squares > fits[best].sum_of_squares * (1 + MAX_COST / fits[slowest].independent)
    curve = best if is_other else slowest
    return curve.at(fits[curve])


def add_curve_uncertainty(signals: Sequence[MotionSignals], terms: MotionTerms, fit: Regression) -> Regression:
    """Return regression with the change to other curves over speed that are not excluded in its covariance.

    They are of other exponents of a Stribeck effect, and of one that shows, but not beyond chance.
    """
    fixed_terms, index, changes = terms.at(fit), fit.names.index("coulomb"), [np.zeros(len(fit.names))]
    limit = 1 + MAX_COST / fit.independent
    if terms.stribeck_velocity:
        others = [regress(signals, replace(fixed_terms, exponent=exponent)) for exponent in EXPONENTS]
        changes += [change_of(fit, trial) for trial in others if trial.sum_of_squares < limit * fit.sum_of_squares]
    else:
        velocity = _best_velocity(signals, fixed_terms)
        unseen = regress(signals, replace(fixed_terms, stribeck_velocity=velocity), steps=0)
        if unseen["stiction"] > unseen["coulomb"] and unseen.sum_of_squares * limit < fit.sum_of_squares:
            changes.append(change_of(fit, unseen))
    return fit.widened(max(changes, key=lambda shift: float(abs(shift[index]))))


def change_of(fit: Regression, alternative: Regression) -> FloatArray:
    """Return the change of the coefficients (n_x,) from `fit` to `alternative`; 0 for names that it does not have."""
    return np.array([alternative[name] - fit[name] if name in alternative.names else 0.0 for name in fit.names])


def noise_bias(signals: Sequence[MotionSignals], terms: MotionTerms, fit: Regression) -> FloatArray:
    r"""Return the change of the coefficients (n_x,) by position noise in the columns of velocity and acceleration.

    .. math:: \Delta\beta = -(X^T X)^{-1} N \beta, \quad N = E[\tilde X^T \tilde X]

    (Fuller, Measurement Error Models, 1987, section 1.1.)
    """
    equations = [axis_equations(axis, terms, fit if terms.searched else None).X[:, 0] for axis in signals]
    X, noise_products = np.concatenate(equations), np.zeros(len(fit.names))
    powers = sum(axis.used.sum() * axis.noise_powers for axis in signals)
    for name, power in zip(("viscous", "inertia"), powers, strict=True):
        noise_products[[of == name for of in fit.names]] = power
    size = np.maximum(np.linalg.norm(X, axis=0), 1e-300)
    return np.asarray(-np.linalg.pinv((X / size).T @ (X / size)) @ (noise_products * fit.values / size) / size)


def _heat(signals: Sequence[MotionSignals], terms: MotionTerms) -> MotionTerms:
    """Return terms with the numbers of heat if one shows: without the other it would take that one's part."""
    degc = [axis.motion.temperature for axis in signals if axis.motion.temperature is not None]
    if len(degc) < len(signals):
        return terms
    temperatures = np.concatenate(degc)
    low, high = float(temperatures.min()), float(temperatures.max())
    terms = replace(terms, reference=float(temperatures.mean()), measured=(low, high))
    if np.ptp(temperatures) < TEMPERATURE_STEP_K:
        return terms
    alone = [regress(signals, replace(terms, heat=(name,))).chance(name, 0) for name in HEAT]
    if min(alone) * len(HEAT) > FALSE_ALARM:
        return terms
    # Two temperatures identify no decay; held at one that was not measured, it makes f at the mean temperature wrong.
    between = np.mean(np.abs(temperatures - (low + high) / 2) < (high - low) / 6)
    # Three temperatures at least have 5 % of the time in the middle third of all.
    terms = replace(terms, heat=HEAT, is_decay_free=bool(between > 0.05))
    return terms.at(regress(signals, terms))


def _stribeck_velocity(signals: Sequence[MotionSignals], terms: MotionTerms) -> float:
    """Return the best Stribeck velocity; 0 if it is insignificant by Wald's test or by the F test."""
    best = replace(terms, stribeck_velocity=_best_velocity(signals, terms))
    without, fit = regress(signals, terms), regress(signals, best, steps=0)
    drop = without.sum_of_squares - fit.sum_of_squares
    chance = f_test(drop, 2, fit.sum_of_squares, max(1.0, without.independent - len(fit.names)))
    value, std = fit.combination({"stiction": 1.0, "coulomb": -1.0})
    # Few moments at low speed have few degrees of freedom; that they are no chance is the other test's to show.
    values, variance = np.array([value]), np.array([[std**2]])
    excess = replace(fit, names=("excess",), values=values, covariance=variance, dof=fit.dof.max(keepdims=True))
    if max(chance, excess.chance("excess", 1)) * len(_VELOCITIES) > FALSE_ALARM:
        return 0.0
    return regress(signals, best)["stribeck_velocity"]


def _best_velocity(signals: Sequence[MotionSignals], terms: MotionTerms) -> float:
    """Return the Stribeck velocity (of m candidates) that best explains the residual of a regression without one."""
    velocities = _VELOCITIES * max(float(np.abs(axis.velocity).max()) for axis in signals)
    logs = [axis_equations(log, terms) for log in signals]
    X, y = (np.concatenate([getattr(log, name)[:, 0] for log in logs]) for name in ("X", "y"))
    stribeck = [
        [axis.filtered(axis.direction * np.exp(-((axis.velocity / v) ** 2))) * axis.used for v in velocities]
        for axis in signals
    ]
    Q = np.linalg.qr(X / np.maximum(np.linalg.norm(X, axis=0), 1e-300))[0]
    residual, new = (side - Q @ (Q.T @ side) for side in (y, np.concatenate(stribeck, axis=1).T))
    return float(velocities[np.argmax((residual @ new) ** 2 / np.maximum(np.sum(new**2, axis=0), 1e-300))])


def _waves(signals: Sequence[MotionSignals], terms: MotionTerms) -> tuple[int, ...]:
    """Return waves of the motor's turns that stand out of the residuals, and significantly of neighbours in time."""
    fit, errors, waves = regress(signals, terms), [], []
    for log in signals:
        columns = columns_of(log, terms)
        errors.append((log.filtered(log.motion.torque) - sum(fit[name] * columns[name] for name in columns))[log.used])
        turning = turn_waves(log.position, log.direction, log.motion.turn)
        waves.append((log.filtered(turning.real) + 1j * log.filtered(turning.imag))[log.used])
    peaks = tuple(np.flatnonzero(harmonic_peaks(np.concatenate(errors), np.concatenate(waves))).tolist())
    if not peaks:
        return ()
    fit = regress(signals, replace(terms, waves=peaks))
    chances = {wave: min(fit.chance(name, 0) for name in wave_names(wave)) for wave in peaks}
    return tuple(wave for wave, chance in chances.items() if chance * 2 * N_WAVES < FALSE_ALARM)


def regress(signals: Sequence[MotionSignals], terms: MotionTerms, steps: int = 12) -> Regression:
    """Regress the signals; steps: most Gauss-Newton steps of the search for the nonlinear numbers."""

    def solved(about: Regression | None) -> Regression:
        return solve([axis_equations(axis, terms, about) for axis in signals], signals[0].decimated_hz).at("")

    fit = solved(None)
    for _ in range(steps if terms.searched else 0):
        fit = solved(fit)
        start = terms.searched
        ends = {name: float(np.clip(x + fit[name], x / 2, 2 * x)) for name, x in start.items()}
        if "temperature.decay" in ends:
            ends["temperature.decay"] = float(np.clip(ends["temperature.decay"], *DECAY_RANGE_K))
        values = np.array([ends.get(name, fit[name]) for name in fit.names])
        fit, terms = replace(fit, values=values), terms.with_nonlinear(ends)
        if all(abs(ends[name] - x) < 1e-3 * x for name, x in start.items()):
            break
    return fit


def axis_equations(signals: MotionSignals, terms: MotionTerms, about: Regression | None = None) -> Equations:
    """Return equations of an axis that moves alone."""
    return equations_of(MotionLog({"": signals}), {"": terms}, about=about)


def equations_of(
    log: MotionLog, terms: Mapping[str, MotionTerms], rigid: FloatArray | None = None, sliding: bool = True,
    about: Regression | None = None,
) -> Equations:  # fmt: skip
    """Return equations of joints with the columns of their terms; rigid: columns (n, m, n_r) of all behind the filter.

    sliding: of samples that are clear of reversals alone.
    """
    columns = {joint: columns_of(axis, terms[joint], about) for joint, axis in log.signals.items()}
    names = tuple((joint, name) for joint in columns for name in columns[joint])
    is_used = np.stack([axis.used | (not sliding) for axis in log.signals.values()], axis=1)
    X = np.zeros((*is_used.shape, len(names)))
    for k, (joint, name) in enumerate(names):
        X[:, [*columns].index(joint), k] = columns[joint][name]
    R = np.zeros((*is_used.shape, 0)) if rigid is None else rigid
    y = np.stack([axis.filtered(axis.motion.torque) for axis in log.signals.values()], axis=1)
    states = [axis.filtered(state) for axis in log.signals.values() for state in (axis.position, axis.velocity)]
    return Equations(X * is_used[:, :, None], R * is_used[:, :, None], y * is_used, np.stack(states, axis=1), names)


def columns_of(signals: MotionSignals, terms: MotionTerms, about: Regression | None = None) -> dict[str, FloatArray]:
    """Return columns (n,) by name, behind the filter; derivatives of the logged position, whose filter is as long.

    The column of a delay is the rate of the torque as the other columns have it: that of the torque itself has the
    errors of the model in it, and makes all numbers wrong.  The inertia has the spring of the robot model in it.
    """
    inertial = signals.inertial_acceleration

    def raw(part: MotionSignals, span: slice) -> dict[str, FloatArray]:
        columns, velocity = full_rate_columns(part, terms, about), part.derivatives[0]
        motion_columns = {"inertia": inertial[span], "viscous": velocity}
        motion_columns["directions.viscous"] = np.sign(part.velocity) * velocity
        return columns | {name: column for name, column in motion_columns.items() if name in columns}

    pieces = [{name: part.filtered(x) for name, x in raw(part, span).items()} for part, span in signals.pieces()]
    columns = {name: np.concatenate([piece[name] for piece in pieces]) for name in pieces[0]}
    if terms.delay:
        X, y = np.stack(list(columns.values()), axis=1), signals.filtered(signals.motion.torque)
        size = np.maximum(np.linalg.norm(X[signals.used], axis=0), 1e-300)
        numbers = np.linalg.lstsq(X[signals.used] / size, y[signals.used], rcond=None)[0] / size
        rates = [
            part.filtered(np.gradient(np.stack(list(raw(part, span).values()), axis=1) @ numbers))
            for part, span in signals.pieces()
        ]
        columns["delay"] = np.concatenate(rates) * signals.motion.rate_hz
    return columns


def full_rate_columns(
    signals: MotionSignals, terms: MotionTerms, about: Regression | None = None
) -> dict[str, FloatArray]:
    """Return columns (n,) by parameter name. about: values at which columns of nonlinear parameters are derivatives."""
    v, s, q, motion = signals.velocity, signals.direction, signals.position, signals.motion
    # A log without temperature is at T_0; a speed above 0 has a logarithm.
    degc = np.full_like(v, np.nan) if motion.temperature is None else motion.temperature
    sliding = Conditions(np.maximum(np.abs(v), 1e-30), np.sign(v), np.full_like(v, motion.load), degc)
    eta, T_0 = {"exponent": terms.exponent, "temperature.decay": terms.decay} | terms.searched, terms.reference
    columns = dict(zip(terms.law, (s[:, None] * table(sliding, terms.law, eta, T_0)).T, strict=True))
    if about is not None and (names := tuple(terms.searched)):
        linear = {name: about[name] for name in about.names}
        columns |= dict(zip(names, (s[:, None] * slopes(sliding, linear, names, eta, T_0)).T, strict=True))
    if terms.friction_only:
        return columns
    columns = {"inertia": signals.acceleration} | columns
    if motion.payload_torque is not None:
        columns["gain"] = motion.payload_torque
    if terms.spring:
        columns["spring"] = -np.gradient(np.gradient(signals.derivatives[1])) * motion.rate_hz**2
    if terms.angles:
        low, high = terms.angles
        waves = legvander(np.clip(2 * (q - low) / (high - low) - 1, -1, 1), len(ANGLE))
        columns |= {name: s * waves[:, k] for k, name in enumerate(ANGLE, start=1)}
    columns["directions.coulomb" if terms.by_direction else "offset"] = np.ones_like(v)
    if motion.turns_against_gravity:
        columns |= {"gravity.cos": np.cos(q), "gravity.sin": np.sin(q)}
    for wave, column in zip(terms.waves, turn_waves(q, s, motion.turn, terms.waves).T, strict=True):
        columns |= dict(zip(wave_names(wave), (column.real, column.imag), strict=True))
    return columns
