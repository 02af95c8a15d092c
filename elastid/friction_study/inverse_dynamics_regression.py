r"""Inertia and friction of axes from any motion: torque regressed on acceleration, velocity and direction.

.. math:: u = J \ddot q + (f \pm \delta_f) \dot q + (F_c \pm \delta_c)\, s + (F_s - F_c)\, s\, e^{-(\dot q / \nu_s)^2}
              + F_{cl} l s + F_{cT} \theta s + f_T (e^{-\theta / T_V} - 1) \dot q
              + s \sum_k p_k P_k(q)
              + G \cos q + H \sin q + o + \sum_h (a_h \cos h N q + b_h \sin h N q) + T \dot u

with s = sgn q', Legendre polynomials P_k of the angle, the load l of a log, its temperature theta about the mean,
ripple of the motor's turns (N a turn of the joint) and a delay T of the torque. All but J, f, F_c, gravity and o are
parts where the data show them beyond chance. The torque of a payload that some logs have, times the drive's gain g, is
one more: u is logged with an unknown torque constant behind it.

Both sides of the equation pass the same low-pass filter of finite length and are thinned to twice its band, so that
filtering is no error of the equation and neither ripple nor the noise of derivatives counts (Gautier, Proc. IEEE ICRA
1997). What a joint does at rest and at reversals, where it sticks, is no sliding: samples as near are left out. The
residuals of a real axis are not white; the covariance of `least_squares.solve` allows for it.

Noise of the position attenuates the numbers of velocity and acceleration (errors in variables). Its variance in the
acceleration grows with the fifth power of the passband, which is halved until the expected bias is small beside the
std of the numbers.

Axes that move together are regressed jointly with the rigid body that they carry (`rigid_body_columns`). Torques that
the rigid body lacks (springs, counterbalances, couplings of gears) stay in the residuals and limit the accuracy of the
friction.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np
from numpy.polynomial.legendre import legval

from elastid.base.arrays import FloatArray, values_by_name
from elastid.base.errors import DataError, Note
from elastid.friction_study.constant_velocity import NEGATIVE
from elastid.friction_study.least_squares import FALSE_ALARM, Equations, Regression, shift_between, solve, with_delays
from elastid.friction_study.motion_signals import (
    NARROW_BAND,
    Motion,
    MotionLog,
    MotionSignals,
    Plateau,
    both_bands,
    distinct_speeds,
)
from elastid.friction_study.regressor import (
    ANGLE,
    MotionTerms,
    add_curve_uncertainty,
    axis_equations,
    change_of,
    equations_of,
    noise_bias,
    regress,
    select_terms,
)
from elastid.friction_study.rigid_body_columns import (
    RIDGES,
    RigidBody,
    RigidColumns,
    base_columns_of,
    column_names,
    ridge_estimate,
)
from elastid.friction_study.static_model_fit import (
    ABSENT,
    LOWEST_SPEED,
    MIN_SPEEDS,
    TEMPERATURE_STEP_K,
    UnidentifiedTerm,
    above_stribeck,
    extrapolates,
    friction_of,
)
from elastid.robot import Friction, MeasuredRange, Robot

# The filter of both sides; three times as much passes before a position is differentiated.
PASSBAND_HZ = 20.0
LOWEST_PASSBAND_HZ = 5.0  # to which it is halved where noise of the position biases the numbers
# Share of the time of sliding at lower speeds, which is short.
_LOWEST_SPEED_QUANTILE = 0.02
# Numbers that are compared between both bands.
COMPARED_PARAMETERS = ("inertia", "viscous", "coulomb")


# Limits of the judgement of a motion (scripts/studies/results.csv).
NOISE_ERROR = 0.1  # relative std of the expected shift between both bands, since position noise may not be white
MAX_BIAS = 0.5  # expected bias by position noise over the std, above which the passband is halved
MAX_SHIFT = 2.8  # shift of a parameter between both bands over its std, above which the model has an error
SPRING_SHIFT = 0.5  # change of a parameter by a spring behind the motor over its std, above which it is a misfit
MAX_ERROR = 0.05  # relative std with model errors, above which they are a misfit
SPRING_STD = 0.1  # relative std of the effect of the robot model's spring on the parameters


@dataclass(frozen=True)
class MotionFriction:
    """The friction of an axis from a motion, `chosen` with the same numbers in both directions or with different ones.

    motion: its first log; of joints that move together, without the torque of the rigid body.  terms: parts of the
    regression.  plateaus: where it slides steadily.  passband_hz: of the regression.  seconds: of all logs, in the
    regression and not, by reason.  unidentified: terms that the motion cannot identify.  notes: on its data. misfit:
    errors of the model that the intervals do not contain, or empty.  rigid_body: of joints that moved together, which
    share it.
    """

    motion: Motion
    regression: Regression
    terms: MotionTerms
    plateaus: tuple[Plateau, ...]
    passband_hz: float
    seconds: Mapping[str, float]
    unidentified: tuple[UnidentifiedTerm, ...] = ()
    notes: tuple[Note, ...] = ()
    misfit: str = ""
    rigid_body: RigidBody | None = None

    @classmethod
    def of(cls, signals: Sequence[MotionSignals], chosen: Regression, terms: MotionTerms) -> "MotionFriction":
        """Return friction of a motion without its judgement; DataError where friction supplies power at every speed."""
        first = signals[0]
        if chosen["coulomb"] < 0 and chosen["viscous"] <= 0:
            raise DataError("friction/motion", NEGATIVE.format(chosen["coulomb"]), f"motion of {first.motion.place}")
        plateaus = tuple(plateau for signal in signals for plateau in signal.plateaus)
        seconds = {name: sum(signal.seconds[name] for signal in signals) for name in first.seconds}
        fit = cls(first.motion, chosen, terms, plateaus, first.passband_hz, seconds)
        return replace(fit, unidentified=tuple(_unidentified_terms(fit, signals)), notes=tuple(_notes(fit, signals)))

    @property
    def time_summary(self) -> str:
        """Words on each second of the logs: in the regression or why not."""
        unused = [f"{value:.3g} s {name}" for name, value in self.seconds.items() if name != "used" and value > 0]
        total, used_s = sum(self.seconds.values()), self.seconds.get("used", 0.0)
        return f"{used_s:.3g} of {total:.3g} s in the regression{'; not used: ' if unused else ''}{', '.join(unused)}"

    def to_friction(self) -> tuple[Friction, float]:
        """Return the law and its viscous friction as in a robot model, without presliding."""
        fit, terms, speeds = self.regression, self.terms, [abs(plateau.velocity) for plateau in self.plateaus]
        measured = MeasuredRange((min(speeds), max(speeds)), None, terms.measured) if speeds else None
        numbers = {"exponent": terms.exponent, "temperature.decay": terms.decay}
        numbers |= values_by_name(fit.names, fit.values)
        return friction_of(numbers, terms.reference, measured)


def regress_motion(*motions: Motion, passband_hz: float = PASSBAND_HZ) -> MotionFriction:
    """Estimate inertia and friction of an axis; DataError for short or one-sided logs, or negative friction.

    A link behind a spring of the robot model has the inertia that the logs identify, less that of its motor; logs that
    agree better with a rigid joint have no such spring.
    """
    for _ in range(3):
        fit = _regress(motions, passband_hz, passband_hz)
        spring = fit.motion.spring
        if spring is None or 2 * abs(fit.regression["inertia"] - spring.inertia) < SPRING_STD * spring.inertia:
            return fit
        link = max(fit.regression["inertia"] - spring.motor_inertia, SPRING_STD * spring.inertia)
        motions = tuple(replace(motion, spring=replace(spring, link_inertia=link)) for motion in motions)
    return fit


def _regress(motions: Sequence[Motion], passband_hz: float, widest_hz: float) -> MotionFriction:
    """Return friction in the passband, or in a half or quarter of it if noise of the position requires this."""
    signals = [MotionSignals.of(motion, passband_hz) for motion in motions]
    for signal in signals:
        for direction, word in ((1, "forwards"), (-1, "backwards")):
            if not signal.moves(direction) and not signal.motion.is_run_down:
                raise DataError(
                    "friction/motion",
                    f"too little motion {word} to separate friction from an offset or gravity. Record motion in both "
                    "directions. If the joint coasts and its inertia is known, set files[].purpose: coast_down",
                    f"motion of {signal.motion.place}",
                )
    terms = select_terms(signals)
    regression = add_curve_uncertainty(signals, terms, regress(signals, terms))
    if terms.by_direction and regression.chance("directions.viscous", 0) >= FALSE_ALARM:
        terms = replace(terms, by_direction=False)
        regression = add_curve_uncertainty(signals, terms, regress(signals, terms))
    bias = noise_bias(signals, terms.at(regression), regression)
    pairs = [(name, abs(x)) for name, x in zip(regression.names, bias, strict=True) if name in COMPARED_PARAMETERS]
    is_biased = any(x > MAX_BIAS * regression.std(name) for name, x in pairs)
    if is_biased and (half_hz := passband_hz / 2) >= LOWEST_PASSBAND_HZ:
        try:
            slow = [MotionSignals.of(motion, half_hz) for motion in motions]
        except DataError:
            slow = signals
        if not any(signal.used.all() for signal in slow):
            del signals, slow  # before others are made
            return _regress(motions, half_hz, widest_hz)
    regression = regression.widened(bias)
    if motions[0].spring is not None:
        stiff = [replace(motion, spring=None) for motion in motions]
        rigid = regress([MotionSignals.of(motion, passband_hz) for motion in stiff], terms.at(regression), steps=0)
        if rigid.sum_of_squares < regression.sum_of_squares:
            return _regress(stiff, passband_hz, widest_hz)
        regression = regression.widened(SPRING_STD * change_of(regression, rigid))
    fit = MotionFriction.of(signals, regression, terms.at(regression))
    if fit.motion.is_run_down:
        return fit
    return _with_model_errors(fit if fit.terms.delay else _with_delay(fit, signals), motions, widest_hz)


def _with_model_errors(fit: MotionFriction, motions: Sequence[Motion], widest_hz: float) -> MotionFriction:
    """Return friction with errors of the model in its intervals and a misfit's reason.

    A spring is visible in some band from the regression's to the widest; the numbers are compared in the widest.
    """
    bands, texts = tuple[list[MotionLog], ...](), list[str]()
    halvings = round(math.log2(widest_hz / fit.passband_hz))
    for band_hz in (widest_hz / 2**k for k in range(halvings, -1, -1)):
        if bands := both_bands([MotionLog({"": MotionSignals.of(motion, band_hz)}) for motion in motions]):
            fit, text = _by_spring(fit, [log.first for log in bands[1]])
            texts.append(text)
    fit = assess_motion(fit, "", _noise_free_differences(bands, fit), widest_hz)
    return replace(fit, misfit="; ".join(filter(None, (next(filter(None, texts), ""), fit.misfit))))


def _noise_free_differences(bands: Sequence[Sequence[MotionLog]], fit: MotionFriction) -> "Shifts":
    """Return the shift of one axis' numbers between both bands, less the expected shift by noise of the position."""
    shifts = band_differences(bands, lambda log: axis_equations(log.first, fit.terms))
    if not shifts:
        return shifts
    wide, slow = (noise_bias([log.first for log in band], fit.terms, fit.regression) for band in bands)
    differences = dict(zip(fit.regression.names, (slow - wide).tolist(), strict=True))
    return {
        (joint, name): (change - differences[name], math.hypot(std, NOISE_ERROR * differences[name]))
        for (joint, name), (change, std) in shifts.items()
    }


def _notes(fit: MotionFriction, signals: Sequence[MotionSignals]) -> Iterator[Note]:
    place, F_c = f"motion of {fit.motion.place}", max(abs(fit.regression["coulomb"]), 1e-300)
    if fit.terms.angles:
        change = legval(np.linspace(-1, 1, 101), [0.0, *(fit.regression[name] for name in ANGLE)]) / F_c
        unit, (low, high) = "m" if fit.motion.slides else "rad", fit.terms.angles
        text = (
            f"dry friction changes by {change.min():+.0%} to {change.max():+.0%} between {low:.3g} and {high:.3g} "
            f"{unit}, with the position or a load that does; F_c is its mean over them, and the law of a robot's file "
            "has no angle"
        )
        yield Note("friction/position-dependent", text, place)
    if fit.terms.friction_only and not fit.motion.is_run_down:
        viscous, coulomb = fit.regression["viscous"], fit.regression["coulomb"]
        v, s = (np.concatenate([s.filtered(getattr(s, x))[s.used] for s in signals]) for x in ("velocity", "direction"))
        friction = float(np.linalg.norm(viscous * v + coulomb * s))
        ratio = math.sqrt(fit.regression.sum_of_squares) / max(friction, 1e-300)
        dominates = ratio > 0.1  # of the torque of friction, above which residuals dominate the error of its numbers
        text = f"rms residual of the regression: {fit.regression.relative_error:.1%} of the torque, {ratio:.0%} of "
        text += "the friction torque" + dominates * (
            ": the error of the rigid-body model (counterbalance, springs, couplings of gears) is larger than noise, "
            "and the friction parameters are valid only with this rigid body. Record constant-velocity runs of this "
            "joint alone"
        )
        yield Note("friction/rigid-body", text, place, "warning" if dominates else "information")


def _with_delay(fit: MotionFriction, signals: Sequence[MotionSignals]) -> MotionFriction:
    """Estimate a torque delay by Gauss-Newton steps, and include its effect in the intervals (`_widen_by_delay`)."""
    terms, lead_s = replace(fit.terms, delay=True), 0.0
    for _ in range(10):
        motions = [replace(s.motion, torque_delay_s=s.motion.torque_delay_s + lead_s) for s in signals]
        step = regress([MotionSignals.of(motion, fit.passband_hz) for motion in motions] if lead_s else signals, terms)
        is_small = abs(step["delay"]) * fit.motion.rate_hz < (0.01 if lead_s else 1)
        if is_small or (not lead_s and step.chance("delay", 0) >= FALSE_ALARM):
            break
        lead_s += step["delay"]
    return _widen_by_delay(fit, step, lead_s) if lead_s else fit


def _with_joint_delay(fit: MotionFriction, delayed: Regression) -> MotionFriction:
    """Include the effect of a torque delay in the intervals of one of several joints (`_widen_by_delay`)."""
    lead_s = delayed["delay"]
    if delayed.chance("delay", 0) >= FALSE_ALARM or abs(lead_s) * fit.motion.rate_hz < 1:
        return fit
    return _widen_by_delay(fit, delayed, lead_s)


def _widen_by_delay(fit: MotionFriction, delayed: Regression, lead_s: float) -> MotionFriction:
    """Widen the intervals by the change of the parameters in a regression with the delay lead_s (s), and add a note.

    Only for a significant delay above one sample, because model errors can also appear as a delay.
    """
    text = (
        f"the torque seems to be logged {1e3 * abs(lead_s):.2g} ms {'late' if lead_s < 0 else 'early'}, more than one "
        "sample, and the intervals include its effect on the parameters. Check the clocks, or add "
        f"{-1e3 * lead_s:.2g} ms to `delay` of the torque channel"
    )
    note, change = Note("friction/delay", text, f"motion of {fit.motion.place}"), change_of(fit.regression, delayed)
    return replace(fit, regression=fit.regression.widened(change), notes=(*fit.notes, note))


def _unidentified_terms(fit: MotionFriction, signals: Sequence[MotionSignals]) -> Iterator[UnidentifiedTerm]:
    """Yield parts of the law without numbers, and a Stribeck effect that only speeds well above its velocity show."""
    if fit.motion.is_run_down:
        return
    terms, (low, high) = fit.terms, fit.terms.measured or (0.0, 0.0)
    speed = np.concatenate([np.abs(s.filtered(s.velocity))[s.used] for s in signals])
    lowest = float(np.quantile(speed, _LOWEST_SPEED_QUANTILE))
    speeds = len(distinct_speeds(plateau.velocity for plateau in fit.plateaus))
    velocity, is_alone = terms.stribeck_velocity, not terms.friction_only
    is_isothermal = is_alone and not terms.heat
    reasons = (
        ("stribeck", not velocity and speeds < MIN_SPEEDS, f"the motion dwells at {speeds} speeds, and {MIN_SPEEDS} "
            "are needed, the lowest below a third of the Stribeck velocity; measure passes at more speeds; "
            f"{extrapolates(lowest)}"),
        ("stribeck", 0 < velocity < lowest / LOWEST_SPEED, above_stribeck(lowest, velocity)),
        ("temperature", not is_alone, "joints that move together are regressed without; record this joint alone, cold "
            "and warm"),
        ("temperature", is_isothermal and high - low < TEMPERATURE_STEP_K, "no change of temperature was "
            "logged; log the temperature, and record motions cold and warm"),
        ("temperature", is_isothermal and high - low >= TEMPERATURE_STEP_K,
            f"{ABSENT.replace('friction torques', 'motions')} from {low:.3g} to {high:.3g} degC"),
        ("load", not terms.load, "one load shows none; record motions with other payloads, or in other postures"),
        ("directions.coulomb", not is_alone, "Coulomb friction by direction cannot be distinguished from offset and "
            "gravity"),
    )  # fmt: skip
    yield from (UnidentifiedTerm(name, reason) for name, is_missing, reason in reasons if is_missing)


def _by_spring(fit: MotionFriction, slow: Sequence[MotionSignals]) -> tuple[MotionFriction, str]:
    """Return friction with the change by a spring between motor and link in its intervals, and a misfit's reason.

    The change is zero if the spring is within chance.
    """
    numbers, terms = fit.regression, fit.terms
    rigid, elastic = (regress(slow, replace(terms, spring=shows), steps=0) for shows in (False, True))
    if elastic.chance("spring", 1) > FALSE_ALARM:
        return fit, ""
    change = change_of(rigid, elastic)
    stds = np.max(np.abs(change) / np.maximum(np.sqrt(np.diag(numbers.covariance)), 1e-300))
    highest_hz = np.sqrt(max(elastic["inertia"], 0.0) / elastic["spring"]) / 2 / np.pi
    text = (
        f"the torque has the part of a spring between motor and link, which swings below {highest_hz:.2g} Hz where the "
        f"motor is held; with it numbers change by {stds:.2g} std; move more slowly, or identify the spring from "
        "frequency responses"
    )
    return replace(fit, regression=numbers.widened(change)), text if stds > SPRING_SHIFT else ""


Shifts: TypeAlias = Mapping[tuple[str, str], tuple[float, float]]


def band_differences(bands: Sequence[Sequence[MotionLog]], equations: Callable[[MotionLog], Equations]) -> Shifts:
    """Return shift between both bands, and its std, of numbers by joint and name; empty without bands."""
    if not bands:
        return {}
    rate_hz = bands[0][0].first.decimated_hz
    wide, slow = (solve([equations(log) for log in band], rate_hz) for band in bands)
    return shift_between(wide, slow, rate_hz)


def assess_motion(fit: MotionFriction, joint: str, shifts: Shifts, passband_hz: float) -> MotionFriction:
    """Add significant changes between bands to the intervals of a joint's friction, with a misfit's reason."""
    numbers = fit.regression
    changes = {name: change for (of, name), change in shifts.items() if of == joint and name in COMPARED_PARAMETERS}
    shift = np.array([changes.get(name, (0.0, 1.0))[0] for name in numbers.names])
    stds, worst = max(((abs(change) / std, name) for name, (change, std) in changes.items()), default=(0.0, ""))
    texts = []
    if stds > MAX_SHIFT:
        numbers = numbers.widened(shift)
        texts.append(
            f"below {NARROW_BAND * passband_hz:g} Hz {worst} is {stds:.2g} std off that below {passband_hz:g} Hz"
        )
    if numbers.widening > 1:
        texts.append(f"the torque that is left repeats with angle or velocity, {numbers.widening:.2g} times chance")
    names = [name for name in COMPARED_PARAMETERS if name in numbers.names]
    error, name = max((numbers.std(name) / max(abs(numbers[name]), 1e-300), name) for name in names)
    text = (
        f"{' and '.join(texts)}, so that {name} is known to {error:.0%} only: law or rigid body lack a part; measure "
        "passes of this joint alone, which show it"
    )
    return replace(fit, regression=numbers, misfit=text if texts and error > MAX_ERROR else "")


TORQUE_COMPONENTS = ("inertia", "gravity", "viscous", "coulomb")


def torque_components(numbers: Regression, columns: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """Return torque (n,) of TORQUE_COMPONENTS by columns of a regression; friction alone for joints moved together.

    Offset, ripple and delay are in that of gravity, without an offset in that of Coulomb friction.
    """
    components = dict[str, FloatArray]()
    gravity_names = ["gravity", "gain", "offset", *(("ripple", "delay") if "offset" in columns else ())]
    component_of = {"inertia": "inertia"} | dict.fromkeys(gravity_names, "gravity")
    for name in (name for name in columns if name in numbers.names):
        component = "viscous" if name.endswith("viscous") else component_of.get(name.partition(".")[0], "coulomb")
        components[component] = components.get(component, 0.0) + numbers[name] * columns[name]
    return components


# Below the first resonance of a robot, so that it is rigid, and above the frequencies of its motions.
ROBOT_PASSBAND_HZ = 10.0


def regress_robot_motion(
    robot: Robot, logs: Sequence[MotionLog]
) -> tuple[dict[str, MotionFriction], list[dict[str, MotionSignals]]]:
    """Estimate friction of the joints that all logs move; return each log's signals without the rigid body, too.

    DataError for friction that drives.
    """
    joints = tuple(logs[0].signals)
    base_columns, regrouped = base_columns_of(robot, joints, logs)
    base = RigidColumns(robot, joints, joints, base_columns)
    rigid = [base.filtered(log) for log in logs]

    def equations(terms: Mapping[str, MotionTerms], sliding: bool = True) -> list[Equations]:
        return [equations_of(log, terms, block, sliding) for log, block in zip(logs, rigid, strict=True)]

    terms, rate_hz = dict.fromkeys(joints, MotionTerms(friction_only=True)), logs[0].first.decimated_hz
    full = solve(equations(terms), rate_hz)
    for joint in joints:
        chance = full.at(joint).chance("directions.viscous", 0)
        terms[joint] = replace(terms[joint], by_direction=chance < FALSE_ALARM)
    sliding, all_samples = equations(terms), equations(terms, False)
    least = solve(sliding, rate_hz)
    with_delay = solve([with_delays(*log, least, rate_hz) for log in zip(sliding, all_samples, strict=True)], rate_hz)
    shifts = band_differences(both_bands(logs), lambda log: equations_of(log, terms, base.filtered(log)))
    names, units = zip(*column_names(robot, joints), strict=True)
    # Samples near reversals violate the friction law, but constrain the rigid body: the ridge regression uses them.
    shrunk, least_shrunk = (ridge_estimate(all_samples, least, ridges) for ridges in (RIDGES, RIDGES[:1]))
    base_units = tuple(units[i] for i in base_columns)
    body = RigidBody(joints, base_units, least.pi, least.pi_std, shrunk, base_columns, regrouped, names)
    alone = [
        {
            joint: replace(signal, motion=replace(signal.motion, torque=signal.motion.torque - torque))
            for (joint, signal), torque in zip(log.signals.items(), base.torques(log, least_shrunk), strict=True)
        }
        for log in logs
    ]
    friction = {
        joint: MotionFriction.of([fits[joint] for fits in alone], least.at(joint), law) for joint, law in terms.items()
    }
    return {
        joint: replace(
            assess_motion(_with_joint_delay(fit, with_delay.at(joint)), joint, shifts, fit.passband_hz), rigid_body=body
        )
        for joint, fit in friction.items()
    }, alone
