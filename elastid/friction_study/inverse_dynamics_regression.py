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

Axes that move together are regressed jointly with the rigid body that they carry,

.. math:: u = Y(q, \dot q, \ddot q)\, \pi + J_m \ddot q + o + f \dot q + F_c\, \mathrm{sgn}\, \dot q

Y is the regressor of the robot's geometry; masses, inertias, rotors and offsets pi are taken out without having to be
known (Khalil & Dombre, Modeling, Identification and Control of Robots, 2002, chapter 12). Torques that the rigid
body lacks (springs, counterbalances, couplings of gears) stay in the residuals: friction is known only as well as they
are small. The base parameters, with the columns that they belong to, give the rigid body's torque along other logs.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeAlias

import casadi as ca
import numpy as np
from numpy.polynomial.legendre import legval
from scipy.linalg import qr

from elastid.base.arrays import FloatArray, IntArray, frozen_value, named
from elastid.base.errors import DataError, Note
from elastid.friction_study.constant_velocity import NEGATIVE
from elastid.friction_study.least_squares import (
    FALSE_ALARM,
    RANK_TOLERANCE,
    Equations,
    Regression,
    Solution,
    shift_between,
    solve,
)
from elastid.friction_study.motion_signals import (
    PIECE,
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
    regressed,
    select_terms,
)
from elastid.friction_study.static_model_fit import (
    ABSENT,
    LOWEST_SPEED,
    MIN_SPEEDS,
    STRIBECK_NUMBERS,
    TEMPERATURE_STEP_K,
    UnidentifiedTerm,
    above_stribeck,
    extrapolates,
    friction_of,
)
from elastid.model.rigid_body import inverse_dynamics, regressor
from elastid.robot import Friction, MeasuredRange, Robot

# The filter of both sides; three times as much passes before a position is differentiated.
PASSBAND_HZ = 20.0
LOWEST_PASSBAND_HZ = 5.0  # to which it is halved where noise of the position biases the numbers
# Share of the time of sliding at lower speeds, which is short.
_LOWEST_SPEED_QUANTILE = 0.02
# Numbers that are compared between both bands.
COMPARED_PARAMETERS = ("inertia", "viscous", "coulomb")


# Limits of the judgement of a motion (scripts/studies/results.csv).
NOISE_ERROR = 0.1  # of the expected shift between both bands by noise of the position, whose spectrum is assumed white
MAX_BIAS = 0.5  # of a number by noise of the position, over its std, with which the band is wide enough
NARROW_BAND = 0.25  # of the passband, in which a true model has the same numbers
MAX_SHIFT = 2.8  # of a number between both bands, over its std, that counts as an error of the model
SPRING_SHIFT = 0.5  # of a number with a spring between motor and link, over its std, that is a misfit
MAX_ERROR = 0.05  # std of a number over it, widened by errors of the model: above, it is a misfit
SPRING_STD = 0.1  # relative, of the effect of the robot model's spring on the numbers


@frozen_value
class RigidBody:
    r"""Base parameters of joints that moved together: numbers (n_b,) of the columns Y_b of a robot's rigid body.

    .. math:: \tau = Y_b(q, \dot q, \ddot q)\, \pi_b, \qquad Y = Y_b\, regrouped

    Y: the regressor of all frames (10 n_l), rotors and offsets of the joints, n_c columns; base_columns: indices of
    Y_b. A base parameter is its number and regrouped (n_b, n_c) times those which the motions could not separate from
    it (Gautier, J. Robotic Systems 8(4), 1991).  columns: names of all n_c; units: of the base parameters. values: by
    least squares, with std; predicting: by ridge regression, for other logs.
    """

    joints: tuple[str, ...]
    units: tuple[str, ...]
    values: FloatArray
    std: FloatArray
    predicting: FloatArray
    base_columns: IntArray
    regrouped: FloatArray
    columns: tuple[str, ...]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the base parameters, taken from their columns."""
        return tuple(self.columns[i] for i in self.base_columns)


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
        """Friction of a motion without its judgement; DataError where friction supplies power at every speed."""
        first = signals[0]
        if chosen["coulomb"] < 0 and chosen["viscous"] <= 0:
            raise DataError(
                "friction/motion",
                NEGATIVE.format(chosen["coulomb"]),
                f"motion of {first.motion.place}",
            )
        plateaus = tuple(plateau for signal in signals for plateau in signal.plateaus)
        seconds = {name: sum(signal.seconds[name] for signal in signals) for name in first.seconds}
        fit = cls(first.motion, chosen, terms, plateaus, first.passband_hz, seconds)
        return replace(fit, unidentified=tuple(_unidentified(fit, signals)), notes=tuple(_notes(fit, signals)))

    @property
    def time_summary(self) -> str:
        """Words on each second of the logs: in the regression or why not."""
        rest = [f"{seconds:.3g} s {name}" for name, seconds in self.seconds.items() if name != "used" and seconds > 0]
        total, used = sum(self.seconds.values()), self.seconds.get("used", 0.0)
        return f"{used:.3g} of {total:.3g} s in the regression{', not ' if rest else ''}{', '.join(rest)}"

    @property
    def identified_names(self) -> tuple[str, ...]:
        """The numbers that are no extrapolations."""
        unseen = STRIBECK_NUMBERS if any(part.term == "stribeck" for part in self.unidentified) else ()
        return tuple(name for name in self.regression.names if not name.endswith(unseen))

    @property
    def viscous(self) -> float:
        """The viscous friction that a robot's file has next to the law."""
        return max(0.0, self.regression["viscous"])

    def to_friction(self) -> Friction:
        """The law as a robot's file has it; its presliding is another's."""
        fit, terms, speeds = self.regression, self.terms, [abs(plateau.velocity) for plateau in self.plateaus]
        measured = MeasuredRange((min(speeds), max(speeds)), None, terms.measured) if speeds else None
        numbers = {"exponent": terms.exponent, "temperature.decay": terms.decay}
        numbers |= named(fit.names, fit.values)
        return friction_of(numbers, terms.reference, measured)


def regress_motion(*motions: Motion, passband_hz: float = PASSBAND_HZ) -> MotionFriction:
    """Inertia and friction of an axis from its logs; DataError for short or one-sided ones, or friction that drives.

    A link behind a spring of the robot model has the inertia that the logs identify, less that of its motor; logs that
    agree better with a rigid joint have no such spring.
    """
    for _ in range(3):
        fit = _regressed(motions, passband_hz, passband_hz)
        spring = fit.motion.spring
        if spring is None or 2 * abs(fit.regression["inertia"] - spring.inertia) < SPRING_STD * spring.inertia:
            return fit
        link = max(fit.regression["inertia"] - spring.motor_inertia, SPRING_STD * spring.inertia)
        motions = tuple(replace(motion, spring=replace(spring, link_inertia=link)) for motion in motions)
    return fit


def _regressed(motions: Sequence[Motion], passband_hz: float, widest_hz: float) -> MotionFriction:
    """Friction in the passband, or in a half or quarter of it if noise of the position requires this."""
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
    chosen = add_curve_uncertainty(signals, terms, regressed(signals, terms))
    if terms.by_direction and chosen.chance("directions.viscous", 0) >= FALSE_ALARM:
        terms = replace(terms, by_direction=False)
        chosen = add_curve_uncertainty(signals, terms, regressed(signals, terms))
    bias = noise_bias(signals, terms.at(chosen), chosen)
    if _is_noisy(chosen, bias) and (half_hz := passband_hz / 2) >= LOWEST_PASSBAND_HZ:
        try:
            slow = [MotionSignals.of(motion, half_hz) for motion in motions]
        except DataError:
            slow = signals
        if not any(signal.used.all() for signal in slow):
            del signals, slow  # before others are made
            return _regressed(motions, half_hz, widest_hz)
    chosen = chosen.widened(bias)
    if motions[0].spring is not None:
        stiff = [replace(motion, spring=None) for motion in motions]
        rigid = regressed([MotionSignals.of(motion, passband_hz) for motion in stiff], terms.at(chosen), steps=0)
        if rigid.sum_of_squares < chosen.sum_of_squares:
            return _regressed(stiff, passband_hz, widest_hz)
        chosen = chosen.widened(SPRING_STD * change_of(chosen, rigid))
    fit = MotionFriction.of(signals, chosen, terms.at(chosen))
    return fit if fit.motion.is_run_down else _with_model_errors(fit, motions, widest_hz)


def _with_model_errors(fit: MotionFriction, motions: Sequence[Motion], widest_hz: float) -> MotionFriction:
    """Friction with errors of the model in its intervals and a misfit's reason.

    A spring is visible in some band from the regression's to the widest; the numbers are compared in the widest.
    """
    bands, texts = tuple[list[MotionLog], ...](), list[str]()
    halvings = round(math.log2(widest_hz / fit.passband_hz))
    for band_hz in (widest_hz / 2**k for k in range(halvings, -1, -1)):
        logs = [MotionLog({"": MotionSignals.of(motion, band_hz)}) for motion in motions]
        if bands := both_bands(logs, NARROW_BAND):
            fit, text = _by_spring(fit, [log.first for log in bands[1]])
            texts.append(text)
    fit = assess_motion(fit, "", _noise_free_differences(bands, fit), widest_hz)
    return replace(fit, misfit="; ".join(filter(None, (next(filter(None, texts), ""), fit.misfit))))


def _noise_free_differences(bands: Sequence[Sequence[MotionLog]], fit: MotionFriction) -> "Moved":
    """Shift of the numbers of one axis between both bands, without the expected shift by noise of the position."""
    moved = band_differences(bands, lambda log: axis_equations(log.first, fit.terms))
    if not moved:
        return moved
    wide, slow = (noise_bias([log.first for log in band], fit.terms, fit.regression) for band in bands)
    expected = dict(zip(fit.regression.names, (slow - wide).tolist(), strict=True))
    return {
        (joint, name): (change - expected[name], math.hypot(std, NOISE_ERROR * expected[name]))
        for (joint, name), (change, std) in moved.items()
    }


def _is_noisy(fit: Regression, bias: FloatArray) -> bool:
    """True if the bias (n_x,) by noise of the position counts beside the std of a number."""
    return any(
        abs(bias[i]) > MAX_BIAS * fit.std(name) for i, name in enumerate(fit.names) if name in COMPARED_PARAMETERS
    )


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
        v, s = (
            np.concatenate([s.filtered(getattr(s, name))[s.used] for s in signals])
            for name in ("velocity", "direction")
        )
        friction = float(np.linalg.norm(fit.regression["viscous"] * v + fit.regression["coulomb"] * s))
        share = float(np.sqrt(fit.regression.sum_of_squares)) / max(friction, 1e-300)
        dominates = share > 0.1  # of the torque of friction, above which residuals dominate the error of its numbers
        text = (
            f"rigid body and friction do not explain {fit.regression.relative_error:.1%} of its torque, {share:.0%} of "
        )
        text += "the friction torque" + dominates * (
            ": the error of the rigid-body model (counterbalance, springs, couplings of gears) is larger than noise, "
            "and the numbers of friction hold only together with it; passes of this joint alone do not depend on it"
        )
        yield Note("friction/rigid-body", text, place, "warning" if dominates else "information")


def _unidentified(fit: MotionFriction, signals: Sequence[MotionSignals]) -> Iterator[UnidentifiedTerm]:
    """Parts of the law without numbers, and a Stribeck effect that only speeds well above its velocity show."""
    if fit.motion.is_run_down:
        return
    terms, low, high = fit.terms, *(fit.terms.measured or (0.0, 0.0))
    speed = np.concatenate([np.abs(s.filtered(s.velocity))[s.used] for s in signals])
    lowest = float(np.quantile(speed, _LOWEST_SPEED_QUANTILE))
    speeds = len(distinct_speeds(plateau.velocity for plateau in fit.plateaus))
    if not terms.stribeck_velocity and speeds < MIN_SPEEDS:
        text = (
            f"the motion dwells at {speeds} speeds, and {MIN_SPEEDS} are needed, the lowest below a third of the "
            f"Stribeck velocity; measure passes at more speeds; {extrapolates(lowest)}"
        )
        yield UnidentifiedTerm("stribeck", text)
    if terms.stribeck_velocity and lowest > LOWEST_SPEED * terms.stribeck_velocity:
        yield UnidentifiedTerm("stribeck", above_stribeck(lowest, terms.stribeck_velocity))
    if terms.friction_only:
        text = "joints that move together are regressed without; record this joint alone, cold and warm"
        yield UnidentifiedTerm("temperature", text)
    elif not terms.heat and high - low < TEMPERATURE_STEP_K:
        yield UnidentifiedTerm(
            "temperature", "no temperature that varies was logged; log it, and record motions cold and warm"
        )
    elif not terms.heat:
        yield UnidentifiedTerm(
            "temperature", f"{ABSENT.replace('levels', 'motions')} from {low:.3g} to {high:.3g} degC"
        )
    if not terms.load:
        yield UnidentifiedTerm("load", "one load shows none; record motions with other payloads, or in other postures")
    if terms.friction_only:
        text = "Coulomb friction by direction cannot be distinguished from offset and gravity"
        yield UnidentifiedTerm("directions.coulomb", text)


def _by_spring(fit: MotionFriction, slow: Sequence[MotionSignals]) -> tuple[MotionFriction, str]:
    """Friction with the change by a spring between motor and link in its intervals, and a misfit's reason.

    The change is zero if the spring is within chance.
    """
    numbers, terms = fit.regression, fit.terms
    rigid, elastic = (regressed(slow, replace(terms, spring=shows), steps=0) for shows in (False, True))
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


Moved: TypeAlias = Mapping[tuple[str, str], tuple[float, float]]


def band_differences(bands: Sequence[Sequence[MotionLog]], equations: Callable[[MotionLog], Equations]) -> Moved:
    """Shift between both bands, and its std, of numbers by joint and name; empty without bands."""
    if not bands:
        return {}
    rate_hz = bands[0][0].first.decimated_hz
    wide, slow = (solve([equations(log) for log in band], rate_hz) for band in bands)
    return shift_between(wide, slow, rate_hz)


def assess_motion(fit: MotionFriction, joint: str, moved: Moved, passband_hz: float) -> MotionFriction:
    """Friction with the change between bands in its intervals where it is beyond chance, and a misfit's reason."""
    numbers = fit.regression
    changes = {name: change for (of, name), change in moved.items() if of == joint and name in COMPARED_PARAMETERS}
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
    known = [name for name in COMPARED_PARAMETERS if name in numbers.names]
    error, name = max((numbers.std(name) / max(abs(numbers[name]), 1e-300), name) for name in known)
    text = (
        f"{' and '.join(texts)}, so that {name} is known to {error:.0%} only: law or rigid body lack a part; measure "
        "passes of this joint alone, which show it"
    )
    return replace(fit, regression=numbers, misfit=text if texts and error > MAX_ERROR else "")


TORQUE_COMPONENTS = ("inertia", "gravity", "viscous", "coulomb")


def torque_components(numbers: Regression, columns: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """Torque (n,) of PARTS from the columns of a regression; for joints that moved together, the friction torque.

    Offset, ripple and delay are in that of gravity, without an offset in that of Coulomb friction.
    """
    parts = dict[str, FloatArray]()
    of_gravity = ["gravity", "gain", "offset", *(("ripple", "delay") if "offset" in columns else ())]
    part_of = {"inertia": "inertia"} | dict.fromkeys(of_gravity, "gravity")
    for name in (name for name in columns if name in numbers.names):
        part = "viscous" if name.endswith("viscous") else part_of.get(name.partition(".")[0], "coulomb")
        parts[part] = parts.get(part, 0.0) + numbers[name] * columns[name]
    return parts


# Below the first resonance of a robot, so that it is rigid, and above the frequencies of its motions.
ROBOT_PASSBAND_HZ = 10.0
# Numbers of a joint's frame in the order of the regressor's columns, with their units.
_OF_FRAME = {"m": "kg"} | dict.fromkeys(("mcx", "mcy", "mcz"), "kg*m")
_OF_FRAME |= dict.fromkeys(("Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz"), "kg*m^2")
# Part of a column that is no combination of the base columns, above which other motions have not identified it.
MAX_UNIDENTIFIED = 1e-3
# Of columns of unit length: numbers that logs barely excite are large, of either sign, and predict no other motion
# (Hoerl and Kennard, Technometrics 12, 1970).
RIDGES = (0.0, 0.03, 0.1, 0.3, 1.0)


def regress_robot_motion(
    robot: Robot, logs: Sequence[MotionLog]
) -> tuple[dict[str, MotionFriction], list[dict[str, MotionSignals]]]:
    """Friction of the joints that all logs move, and of each log their signals without the torque of the rigid body.

    DataError for friction that drives.
    """
    joints = tuple(logs[0].of_joints)
    chosen, regrouped = _base_columns(robot, joints, logs)
    of_chosen = RigidColumns(robot, joints, joints, chosen)
    rigid = [of_chosen.filtered(log) for log in logs]

    def equations(terms: Mapping[str, MotionTerms], sliding: bool = True) -> list[Equations]:
        return [equations_of(log, terms, block, sliding) for log, block in zip(logs, rigid, strict=True)]

    terms, rate_hz = dict.fromkeys(joints, MotionTerms(friction_only=True)), logs[0].first.decimated_hz
    every = solve(equations(terms), rate_hz)
    terms = {
        joint: replace(rule, by_direction=every.at(joint).chance("directions.viscous", 0) < FALSE_ALARM)
        for joint, rule in terms.items()
    }
    least = solve(equations(terms), rate_hz)
    moved = band_differences(
        both_bands(logs, NARROW_BAND),
        lambda log: equations_of(log, terms, of_chosen.filtered(log)),
    )
    names, units = zip(*_numbers(robot, joints), strict=True)
    # Near reversals friction is not as the regression has it, but a rigid body that they contradict predicts none.
    shrunk, least_shrunk = (_rigid_numbers(equations(terms, False), least, ridges) for ridges in (RIDGES, RIDGES[:1]))
    of_base = tuple(units[i] for i in chosen)
    body = RigidBody(joints, of_base, least.pi, least.pi_std, shrunk, chosen, regrouped, names)
    alone = [
        {
            joint: replace(signal, motion=replace(signal.motion, torque=signal.motion.torque - torque))
            for (joint, signal), torque in zip(log.of_joints.items(), of_chosen.torques(log, least_shrunk), strict=True)
        }
        for log in logs
    ]
    friction = {
        joint: MotionFriction.of([fits[joint] for fits in alone], least.at(joint), law) for joint, law in terms.items()
    }
    return {
        joint: replace(assess_motion(fit, joint, moved, fit.passband_hz), rigid_body=body)
        for joint, fit in friction.items()
    }, alone


def _states(robot: Robot, log: MotionLog, samples: slice = slice(None)) -> FloatArray:
    """q, v, a (3, n_l, n) of all joints of the robot."""
    names = [joint.name for joint in robot.joints]
    state = np.zeros((3, len(names), len(log.first.position[samples])))
    for joint, angle in log.resting.items():
        state[0, names.index(joint)] = angle
    for joint, signal in log.of_joints.items():
        moved = (signal.position, signal.velocity, signal.acceleration)
        state[:, names.index(joint)] = [part[samples] for part in moved]
    return state


def torques_in_file(robot: Robot, log: MotionLog) -> dict[str, FloatArray]:
    """The torque (n,) of rigid body and rotor by joint, with the masses of the robot's file; DataError with loops."""
    if robot.loops:
        text = "it has loops, and the rigid body along a log is known of open chains; record one joint there and back"
        raise DataError("friction/rigid-body", text, f"robot {robot.name}")
    names, dynamics = [joint.name for joint in robot.joints], inverse_dynamics(robot)
    theta = np.array([[value] for value, _ in robot.parameters().values()])
    states = (_states(robot, log, slice(i, i + PIECE)) for i in range(0, len(log.first.position), PIECE))
    tau = np.hstack([dynamics(*state, np.tile(theta, state.shape[2])).full() for state in states])
    rotors = {j.name: j.motor.inertia * j.motor.ratio**2 for j in robot.driven if j.motor is not None}
    return {joint: tau[names.index(joint)] + rotors[joint] * axis.acceleration for joint, axis in log.of_joints.items()}


def rigid_body_torques(robot: Robot, body: RigidBody, log: MotionLog) -> dict[str, FloatArray]:
    """Torque (n,) of the identified rigid body along a log, for each joint; empty without a rigid body.

    DataError where its motion takes numbers that the motions behind `body` have not identified.
    """
    rows = tuple(joint for joint in log.of_joints if joint in body.joints)
    if not rows:
        return {}
    sample = RigidColumns(robot, body.joints, rows).sampled(log).reshape(-1, len(body.columns))
    left = np.linalg.norm(sample - sample[:, body.base_columns] @ body.regrouped, axis=0)
    lacking = left / _sizes(sample) > MAX_UNIDENTIFIED
    if lacking.any():
        first = ", ".join(body.columns[i] for i in np.flatnonzero(lacking)[:3])
        raise DataError(
            "friction/rigid-body",
            f"the motion needs rigid-body parameters that are not identified ({first}"
            f"{', ...' if lacking.sum() > 3 else ''}). Use a friction study of a log in which these joints move",
        )
    torques = RigidColumns(robot, body.joints, rows, body.base_columns).torques(log, body.predicting)
    return dict(zip(rows, torques, strict=True))


def _numbers(robot: Robot, joints: Sequence[str]) -> list[tuple[str, str]]:
    of_frames = [(f"{name}_{joint.name}", unit) for joint in robot.joints for name, unit in _OF_FRAME.items()]
    slides = {joint.name: joint.slides for joint in robot.joints}
    rotors = [(f"Jm_{joint}", "kg" if slides[joint] else "kg*m^2") for joint in joints]
    return [*of_frames, *rotors, *((f"o_{joint}", "N" if slides[joint] else "N*m") for joint in joints)]


def _base_columns(robot: Robot, joints: tuple[str, ...], logs: Sequence[MotionLog]) -> tuple[IntArray, FloatArray]:
    """Indices (n_b,) of columns that span the remainder of friction, and all columns as combinations of them (n_b,
    n_c).

    All columns: rigid body (10 n_l), rotors (m) and offsets (m).
    """
    every = RigidColumns(robot, joints, joints)
    sample = np.vstack([columns for log in logs for columns in every.sampled(log)])
    size = _sizes(sample)
    _, R, order = qr(sample / size, mode="economic", pivoting=True)
    diagonal = np.abs(np.diag(R))
    chosen = np.sort(order[: int(np.sum(diagonal > RANK_TOLERANCE * diagonal[0]))]).astype(np.int64)
    regrouped = np.linalg.lstsq(sample[:, chosen] / size[chosen], sample, rcond=None)[0] / size[chosen, None]
    return chosen, np.asarray(regrouped)


def _sizes(sample: FloatArray) -> FloatArray:
    """Norms (n_c,) of columns; infinite of one that is zero but for rounding, whose number no motion shows."""
    size = np.linalg.norm(sample, axis=0)
    return np.where(size > 1e-9 * size.max(), size, np.inf)


@dataclass(frozen=True)
class RigidColumns:
    """Columns of all but friction in the torques of the joints of `rows`, of joints that moved together.

    chosen: indices of the columns in `_numbers`; None for all.
    """

    robot: Robot
    joints: tuple[str, ...]
    rows: tuple[str, ...]
    chosen: IntArray | None = None

    @cached_property
    def _function(self) -> tuple[ca.Function, IntArray, list[int]]:
        """Rigid body's columns from q, v, a; indices of rotors and offsets among `chosen`; places of the rows."""
        n_l, names = len(self.robot.joints), [joint.name for joint in self.robot.joints]
        chosen = np.arange(10 * n_l + 2 * len(self.joints)) if self.chosen is None else self.chosen
        places = [names.index(joint) for joint in self.rows]
        q, v, a = (ca.SX.sym(name, n_l) for name in "qva")
        columns = regressor(self.robot)(q, v, a)[places, chosen[chosen < 10 * n_l].tolist()]
        return ca.Function("part", [q, v, a], [columns]), chosen[chosen >= 10 * n_l] - 10 * n_l, places

    def at(self, log: MotionLog, samples: slice) -> FloatArray:
        """Columns (n, len(rows), n_b) at some samples."""
        (function, further, places), state = self._function, _states(self.robot, log, samples)
        n, m = state.shape[2], len(self.joints)
        rotors = np.zeros((n, len(places), 2 * m))
        for i, (joint, place) in enumerate(zip(self.rows, places, strict=True)):
            k = self.joints.index(joint)
            rotors[:, i, k], rotors[:, i, m + k] = state[2, place], 1.0
        of_rigid_body = np.asarray(ca.DM(function(*state))).reshape(len(places), n, -1).swapaxes(0, 1)
        return np.concatenate([of_rigid_body, rotors[:, :, further]], axis=2)

    def sampled(self, log: MotionLog) -> FloatArray:
        """Columns (n, len(rows), n_b) at some 500 samples."""
        return self.at(log, slice(0, None, max(1, len(log.first.position) // 500)))

    def torques(self, log: MotionLog, numbers: FloatArray) -> FloatArray:
        """Torque (len(rows), n) of numbers (n_b,)."""
        starts = range(0, len(log.first.position), PIECE)
        return np.concatenate([self.at(log, slice(i, i + PIECE)) @ numbers for i in starts]).T

    def filtered(self, log: MotionLog) -> FloatArray:
        """Columns behind the filter of both sides, at the samples that are kept."""
        return np.concatenate([part.filtered(self.at(log, here)) for part, here in log.first.pieces()])


def _rigid_numbers(logs: Sequence[Equations], solution: Solution, ridges: Sequence[float]) -> FloatArray:
    """The numbers (n_b,) of the rigid body by ridge regression on the torque of these logs without friction.

    By that of the ridges with which fifths of the record are predicted best by the rest of it.
    """
    weight = 1 / np.maximum(np.sqrt(solution.sum_of_squares), 1e-300)
    R = np.concatenate([weight[:, None] * log.R for log in logs])
    target = np.concatenate([weight * (log.y - log.X @ solution.beta) for log in logs])
    size, n_b, every = np.maximum(np.linalg.norm(R, axis=(0, 1)), 1e-300), R.shape[2], np.arange(len(R))

    def numbers(rows: IntArray, ridge: float) -> FloatArray:
        flat = np.concatenate([(R[rows] / size).reshape(-1, n_b), ridge * np.eye(n_b)])
        y = np.append(target[rows], np.zeros(n_b))
        return np.asarray(np.linalg.lstsq(flat, y, rcond=RANK_TOLERANCE)[0] / size)

    def error(ridge: float) -> float:
        folds = np.array_split(every, 5)
        return float(sum(np.sum((target[f] - R[f] @ numbers(np.setdiff1d(every, f), ridge)) ** 2) for f in folds))

    return numbers(every, ridges[0] if len(ridges) == 1 else min(ridges, key=error))
