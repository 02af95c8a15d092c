"""FrictionResult: sliding friction and records of a study -> the friction of each joint, and the table of all numbers.

The law of a joint as a whole, as a robot's file has it, has sliding from passes or a motion, and before it Maxwell slip
from loops or LuGre's bristles from responses at rest. A part that fails leaves a note instead: the rest of the
friction does not depend on it.

The friction of a simulated robot stands beside the numbers, at the conditions at which they hold.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal, ParamSpec, TypeAlias, TypeVar

import numpy as np

from elastid.base.display import Display, as_html, as_text, digits, format_interval, number
from elastid.base.errors import DataError, FitError, Note, index_of
from elastid.base.statistics import QUANTILE_95
from elastid.friction.robot_friction import frictions
from elastid.friction_record import FrictionRecord, FrictionRecords
from elastid.friction_study.commanded import DELAY, CommandedJoint
from elastid.friction_study.constant_velocity import FrictionCurve
from elastid.friction_study.inverse_dynamics_regression import MotionFriction
from elastid.friction_study.least_squares import Estimate
from elastid.friction_study.presliding import (
    Elements,
    PreslidingFit,
    fit_presliding,
    fit_presliding_responses,
    presliding_responses,
)
from elastid.friction_study.rigid_body_columns import RigidBody
from elastid.friction_study.spec import FrictionSpec, LawSpec
from elastid.friction_study.static_model_fit import ABSENT, NOT_ASKED, StaticLaw, UnidentifiedTerm, identified_names
from elastid.friction_study.warm_up import ThermalModel, WarmUp, fit_warm_up, warm_up_note, warm_up_of
from elastid.model.formulation import ElasticJoint, locked_joint
from elastid.record import motion_unit
from elastid.robot import Friction, LuGre, Robot, channel_name
from elastid.robot.friction import MAX_DAMPING_VELOCITY_RATIO
from elastid.robot.friction_numbers import TERMS, FrictionTerm, friction_numbers, law_of

PRESLIDING = ("friction/presliding-test", "friction/presliding-loops")
# misfit: a motion leaves errors of the model that the intervals of its numbers do not hold.
# partly: stiction of some joint cannot be identified, or none of its numbers.  failed: no friction of any joint.
Status: TypeAlias = Literal["identified", "misfit", "partly", "failed"]


@dataclass(frozen=True)
class FrictionNumber:
    """A row of the table: one identified number of a joint, link side, with its 95 % interval, SI.

    name: Fc_m1, unique in a study.  symbol: F_c.  meaning: Coulomb friction.  learnt_from: the data that identify it.
    truth: of a simulated robot.
    """

    name: str
    symbol: str
    meaning: str
    unit: str
    value: float
    std: float
    low: float
    high: float
    learnt_from: str
    truth: float | None = None


@dataclass(frozen=True)
class SlidingFriction:
    """Result of stage `constant_velocity` of one joint: curve of its passes, the regression of its motion, or both."""

    joint: str
    slides: bool
    constant_velocity: FrictionCurve | None = None
    motion: MotionFriction | None = None
    notes: tuple[Note, ...] = ()
    commanded: CommandedJoint | None = None


@dataclass(frozen=True)
class JointFriction(SlidingFriction):
    """Friction of one joint, link side; None if it was not measured or is not identifiable.

    friction, viscous: the law as a whole, with the ranges in which it was measured.
    numbers: the table.  unidentified: parts without numbers, with reasons.
    """

    static: StaticLaw | None = None
    presliding: Elements | None = None
    presliding_test: PreslidingFit | None = None
    thermal: ThermalModel | None = None
    friction: Friction | None = None
    viscous: float | None = None
    numbers: tuple[FrictionNumber, ...] = ()
    unidentified: tuple[UnidentifiedTerm, ...] = ()

    @property
    def shared(self) -> Mapping[str, tuple[float, float]]:
        """Values and stds of identified parameters other than friction: inertia, gravity."""
        if self.motion is None:
            return {} if self.constant_velocity is None else self.constant_velocity.shared
        regression = self.motion.regression
        return {name: (regression[name], regression.std(name)) for name in regression.names}

    @property
    def misfit(self) -> str:
        """Errors of the model that intervals of numbers from a motion do not hold; empty where passes have them."""
        if self.commanded is not None:
            return self.commanded.misfit
        return self.motion.misfit if self.motion is not None and self.static is None else ""

    @property
    def has_one_speed(self) -> bool:
        """True if the torque at one speed was identified, and so no law."""
        return self.static is not None and self.static.has_one_speed

    @property
    def is_unrelated(self) -> bool:
        """True if most torque of the motion is unexplained, and no friction parameter is significant (3 std).

        Negative friction is not significant: chance gives either sign.
        """
        if self.motion is None or self.motion.regression.relative_error**2 < 0.5:
            return False
        rigid = [term.symbol for term in RIGID_TERMS.values()]
        return not any(row.value > 3 * row.std for row in self.numbers if row.symbol not in rigid)

    @property
    def missing(self) -> tuple[UnidentifiedTerm, ...]:
        """Parts of a law of friction that these data cannot identify: stiction, or friction at all."""
        if self.is_unrelated:
            why = "no friction is significant and most torque is unexplained. Check the joint and time of the torque"
            return (UnidentifiedTerm("friction", why),)
        if self.friction is None and not self.has_one_speed:
            slid = any(fit is not None for fit in (self.static, self.motion, self.commanded))
            why = "the data identify no law that is physically possible" if slid else "the joint slides in no log"
            return (UnidentifiedTerm("friction", why),)
        terms = (term for term in self.unidentified if term.term in ("stribeck", "presliding"))
        return tuple(term for term in terms if not term.reason.startswith((NOT_ASKED, ABSENT)))


@dataclass(frozen=True)
class FrictionResult:
    """All joints.  message: how the identification ended, in one sentence."""

    joints: tuple[JointFriction, ...]
    notes: tuple[Note, ...]
    status: Status
    message: str

    __repr__, _repr_html_ = as_text, as_html

    @property
    def display(self) -> Display:
        """How it ended, and the table of numbers."""
        rows = []
        for row in self.numbers:
            n_digits = digits(row.value, row.std)
            value, ends = number(row.value, n_digits), " to ".join(format_interval((row.low, row.high), n_digits))
            rows.append((row.name, row.meaning, f"{value} {row.unit}", ends))
        return Display(f"Friction {self.status}: {self.message}", ("number", "meaning", "value", "95 % interval"), rows)

    def at(self, joint: str) -> JointFriction:
        """Return the friction of a joint; UnknownNameError names the known ones."""
        return self.joints[index_of(joint, [row.joint for row in self.joints], "friction of joint")]

    @property
    def numbers(self) -> tuple[FrictionNumber, ...]:
        """The table of all joints."""
        return tuple(number for joint in self.joints for number in joint.numbers)

    @property
    def rigid_bodies(self) -> tuple[RigidBody, ...]:
        """Base parameters of each group of joints that moved together."""
        bodies = (joint.motion.rigid_body for joint in self.joints if joint.motion is not None)
        return tuple({body.joints: body for body in bodies if body is not None}.values())


Truth = Mapping[str, float]
# Numbers of a regression that are no friction.
RIGID_TERMS = {
    path: FrictionTerm(path, symbol, symbol, meaning, unit, power)
    for path, symbol, meaning, unit, power in (
        ("inertia", "J", "inertia", "kg*m^2", 2),
        ("armature", "J_a", "armature: inertia of the motor", "kg*m^2", 2),
        ("offset", "o", "offset of the torque", "N*m", 1),
        ("gain", "g", "gain of the drive: torque logged over torque", "", 0),
        ("delay", "T", "delay of the torque", "s", 0),
        (DELAY, "T_d", "delay of the commands of all joints", "s", 0),
        ("gravity.cos", "G", "gravity, cos q", "N*m", 1),
        ("gravity.sin", "H", "gravity, sin q", "N*m", 1),
        ("stick_time", "tau", "time constant of the velocity of a sticking joint without creep", "s", 0),
        ("creep", "c", "fraction of its torque that accelerates a sticking joint", "", 0),
        ("bristle_compliance", "s", "compliance before sliding", "rad/(N*m)", -2),
        ("bristle_time", "T_s", "damping time before sliding (damping over stiffness)", "s", 0),
    )
}


def law_numbers(joint: str, law: StaticLaw, truth: Truth) -> Iterator[FrictionNumber]:
    """Yield numbers of the static law, and of each direction where they differ."""
    curve, unit = law.curve, motion_unit("velocity", law.curve.slides)
    learnt = f"{curve.n_conditions} friction torques from {curve.speed.min():.3g} to {curve.speed.max():.3g} {unit}"
    at, terms = f"friction torque at {curve.speed.mean():.3g} {unit}", dict(TERMS)
    if law.has_one_speed:
        by_heat, meaning = "temperature.coulomb", f"{at}: change with temperature"
        terms["coulomb"] = replace(TERMS["coulomb"], prefix="tau", symbol="tau_f", meaning=at)
        terms[by_heat] = replace(TERMS[by_heat], prefix="tauT", symbol="tau_T", meaning=meaning)
    names, half_width = identified_names(law.names, law.unidentified), law.quantile_95
    yield from _table(joint, curve.slides, learnt, names, law.estimate, truth, half_width, terms)


def thermal_numbers(joint: str, model: ThermalModel, warm_up: WarmUp) -> Iterator[FrictionNumber]:
    """Yield time constants, and heat given off where kelvins are known."""
    constants, read = model.time_constants.tolist(), int(np.isfinite(warm_up.log.temperature).sum())
    learnt = f"{read} readings, {len(warm_up.torque)} test passes in {np.ptp(warm_up.log.time_s) / 60:.3g} min"
    suffixes = zip([""] if len(constants) == 1 else ["1", "2"], constants, strict=True)
    rows = [(f"h_m{joint}", "h", "heat given off", "W/K", model.h)]
    rows += [(f"Tc{i}_m{joint}", "C / h", "time constant of warming", "s", T) for i, T in suffixes]
    for (name, symbol, meaning, unit, value), log_std in zip(rows, model.log_std.tolist(), strict=True):
        half_width = math.exp(QUANTILE_95 * log_std)  # symmetric in the logarithm
        if math.isfinite(value):
            yield FrictionNumber(
                name, symbol, meaning, unit, value, value * log_std, value / half_width, value * half_width, learnt
            )


def _table(
    joint: str, slides: bool, learnt: str, identified: Sequence[str], estimate: Estimate, truth: Truth,
    half_width: float = QUANTILE_95, terms: Mapping[str, FrictionTerm] = TERMS,
) -> Iterator[FrictionNumber]:  # fmt: skip
    """Yield numbers that are known, by name, and Coulomb and viscous friction forwards and backwards where they differ.

    The latter are mean and half difference, summed and subtracted.
    """
    terms = {**terms, **RIGID_TERMS}
    names = estimate.names
    rows = [(terms[name], "", "", {name: 1.0}) for name in names if name in terms and name in identified]
    for name in ("coulomb", "viscous"):
        if name in identified and (half := f"directions.{name}") in names:
            rows += [(terms[name], "+", " forwards", {name: 1.0, half: 1.0})]
            rows += [(terms[name], "-", " backwards", {name: 1.0, half: -1.0})]
    for term, mark, word, weights in rows:
        value, std = estimate.combination(weights)
        unit = "kg" if slides and term.path in ("inertia", "armature") else term.unit_at(slides)
        name = channel_name("gain", "u", f"motor {joint}") if term.path == "gain" else f"{term.name(joint)}{mark}"
        yield FrictionNumber(
            name, f"{term.symbol}{mark}", f"{term.meaning}{word}", unit, value, std, value - half_width * std,
            value + half_width * std, learnt, truth.get(name)
        )  # fmt: skip


def true_numbers(robot: Robot, joint: str, static: StaticLaw | None = None) -> dict[str, float]:
    """Return numbers of a joint by name, link side, SI; empty for one without friction.

    static: the law that they are compared with. Its numbers stand at the mean temperature of its torques, and where it
    has no part for the load, under the mean load of these.
    """
    law, numbers = law_of(robot, joint), friction_numbers(robot)
    if law is None:
        return {}
    paths = {path: numbers[term.name(joint)][0] for path, term in TERMS.items() if term.name(joint) in numbers}
    if static is not None:
        degc, by_load = static.curve.measured_temperatures, law.load is not None and "load.coulomb" not in static.names
        friction_law = next(law for law in frictions(robot) if law.place == f"motor {joint}")
        load = float(np.mean(static.curve.load)) if by_load else 0.0
        curve = friction_law.curve(load, float(np.mean(degc)) if len(degc) else None)
        F_c, F_s, inverse_nu_s, _, alpha_T, F_l = curve[:6].tolist()
        terms = {"coulomb": F_c, "stiction": F_s + F_l, "stribeck_velocity": 1 / inverse_nu_s if inverse_nu_s else None}
        terms |= {name: paths[name] + alpha_T for name in ("viscous", "temperature.viscous") if name in paths}
        paths |= {name: value for name, value in terms.items() if name in paths and value is not None}
    return {TERMS[path].name(joint): value for path, value in paths.items()}


def identify_friction(
    robot: Robot, sliding: Sequence[SlidingFriction], measured: FrictionRecords, spec: FrictionSpec,
    truth: Robot | None = None,
) -> FrictionResult:  # fmt: skip
    """Identify friction of all joints; truth: the simulated robot.  FitError if a required part is not identifiable."""
    joints = tuple(_joint(robot, part, measured, spec, truth) for part in sliding)
    misfits = [f"joint {joint.joint}: {joint.misfit}" for joint in joints if joint.misfit]
    results = ((j.friction, j.presliding, j.presliding_test, j.thermal, j.has_one_speed) for j in joints)
    if not any(map(any, results)) or all(joint.is_unrelated for joint in joints):
        reasons = [f"joint {joint.joint}: {term.reason}" for joint in joints for term in joint.missing]
        return FrictionResult(joints, measured.notes, "failed", "; ".join(reasons))
    status: Status = "misfit" if misfits else "partly" if any(joint.missing for joint in joints) else "identified"
    numbers = [f"joint {joint.joint}: {_first_numbers(joint)}" for joint in joints]
    return FrictionResult(joints, measured.notes, status, "; ".join([*misfits, *numbers]))


def _joint(
    robot: Robot, sliding: SlidingFriction, measured: FrictionRecords, spec: FrictionSpec, truth: Robot | None
) -> JointFriction:
    name, curve, static = sliding.joint, sliding.constant_velocity, None
    if curve is not None:
        loads = {record.load for record in measured.of(name, "constant_velocity")}
        if len(loads) <= 1:  # it changes along the paths with speed
            curve = replace(curve, load=np.full_like(curve.load, curve.load.mean()))
        static = StaticLaw.of(curve, spec.law)
    notes = list(sliding.notes)
    at_rest = attempt(notes, "friction/presliding-test", _at_rest, robot, measured.of(name, "presliding_test"), static)
    loops = measured.of(name, "presliding_loops")
    presliding = attempt(notes, "friction/presliding-loops", _presliding, loops, at_rest, spec)
    warm_up = attempt(notes, "friction/warm-up", _heat, name, measured)
    friction, viscous, refusals = _law(sliding, static, presliding, at_rest, spec.law)
    true = {} if truth is None else true_numbers(truth, name, static)
    numbers = {row.name: row for row in _numbers(sliding, None if refusals else static, at_rest, true)}
    if warm_up is not None:
        numbers |= {row.name: row for row in thermal_numbers(name, *warm_up)}
        notes += warm_up_note(*warm_up, f"warm-up of joint {name}")
    notes += () if at_rest is None else at_rest.notes
    fit = sliding.motion if static is None else static
    terms = () if fit is None else fit.unidentified
    if presliding is None and at_rest is None:  # logs that were recorded for it, and give no number
        terms += tuple(UnidentifiedTerm("presliding", note.text) for note in notes if note.code in PRESLIDING)
    return JointFriction(
        **vars(sliding) | {"notes": (*notes, *refusals)}, static=static, presliding=presliding, presliding_test=at_rest,
        thermal=None if warm_up is None else warm_up[0], friction=friction, viscous=viscous,
        numbers=tuple(numbers.values()), unidentified=terms,
    )  # fmt: skip


P = ParamSpec("P")
T = TypeVar("T")


def attempt(
    notes: list[Note], code: str, identify: Callable[P, T | None], *args: P.args, **kwargs: P.kwargs
) -> T | None:
    """Return a part of the friction; None, and the note on why, where the data do not identify it."""
    try:
        return identify(*args, **kwargs)
    except (DataError, FitError) as error:
        notes.append(Note(code, error.text, error.place))
        return None


def _law(
    sliding: SlidingFriction, static: StaticLaw | None, presliding: Elements | None, at_rest: PreslidingFit | None,
    spec: LawSpec,
) -> tuple[Friction | None, float | None, tuple[Note, ...]]:  # fmt: skip
    """Return the law and its viscous friction, link side; a note where the numbers are physically impossible."""
    regression = static if static is not None else sliding.motion or sliding.commanded
    if regression is None or (static is not None and static.has_one_speed):
        return None, None, ()
    try:
        friction, viscous = regression.to_friction()
        if presliding is not None:
            friction = replace(friction, maxwell_slip=presliding.to_maxwell_slip())
        elif at_rest is not None and at_rest.sigma_0 > 0 and spec.presliding in ("auto", "lugre"):
            damping = max(0.0, at_rest.sigma_1)
            # Falls with velocity so that the law supplies no energy, nine tenths of the largest with which it does not.
            falling = 0.9 * MAX_DAMPING_VELOCITY_RATIO * friction.coulomb / damping if damping > 0 else None
            friction = replace(friction, lugre=LuGre(at_rest.sigma_0, damping, falling))
        friction.check_passive(viscous, sliding.slides)
    except ValueError as error:
        text = f"no valid friction law for the robot model: {error}. More runs or less noise narrow the intervals"
        return None, None, (Note("friction/law", text, f"joint {sliding.joint}"),)
    return friction, viscous, ()


def _numbers(
    sliding: SlidingFriction, static: StaticLaw | None, at_rest: PreslidingFit | None, truth: Truth
) -> Iterator[FrictionNumber]:
    """Yield the table of parameters; of two experiments for one, the later counts, and runs before motions."""
    table = partial(_table, sliding.joint, sliding.slides, truth=truth)
    if static is not None:
        yield from law_numbers(sliding.joint, static, truth)
    if sliding.motion is not None:
        motion, fit = sliding.motion, sliding.motion.regression
        learnt = f"the motion, {len(motion.plateaus)} plateaus, up to {motion.passband_hz:g} Hz"
        rigid = "inertia", "offset", "gain", "gravity.cos", "gravity.sin"
        yield from table(learnt, identified_names(fit.names, motion.unidentified) if static is None else rigid, fit)
    if sliding.commanded is not None:
        joint = sliding.commanded
        learnt, names = f"commands, {joint.seconds:.3g} s", joint.names
        names = ("armature", *names[1:]) if joint.coupled_inertia else names
        yield from table(learnt, names if joint.is_first else names[:-1], replace(joint, names=names))
    if at_rest is not None:
        learnt, names = f"responses at rest, {at_rest.amplitudes} amplitudes", ("lugre.stiffness", "lugre.damping")
        estimate = Estimate(names, np.array([at_rest.sigma_0, at_rest.sigma_1]), at_rest.covariance)
        yield from table(learnt, names, estimate)


def _heat(joint: str, measured: FrictionRecords) -> tuple[ThermalModel, WarmUp] | None:
    """Return the thermal model of a joint, with its warm-up; None without one."""
    log = next((log for log in measured.warm_ups if log.joint == joint), None)
    if log is None:
        return None
    warm_up = warm_up_of(log, [record for record in measured.of(joint, "constant_velocity") if record.is_warm_up])
    return fit_warm_up(warm_up), warm_up


def _first_numbers(joint: JointFriction) -> str:
    numbers = ", ".join(f"{number.symbol} = {number.value:.4g} {number.unit}" for number in joint.numbers[:4])
    return numbers or next((note.text for note in joint.notes if note.severity == "warning"), "nothing was found")


def _presliding(loops: Sequence[FrictionRecord], at_rest: PreslidingFit | None, spec: FrictionSpec) -> Elements | None:
    if not loops or spec.law.presliding == "no" or (spec.law.presliding == "lugre" and at_rest is not None):
        return None
    if spec.law.presliding == "lugre":
        raise DataError(
            "friction/presliding-loops",
            "loops do not show the damping of bristles; give responses at rest, or law.presliding: maxwell_slip",
            f"record {loops[0].name}",
        )
    hz = None if spec.presliding_loops is None else spec.presliding_loops.frequency_hz
    return fit_presliding(loops[0], hz, spec.law.elements)


def _at_rest(robot: Robot, records: Sequence[FrictionRecord], static: StaticLaw | None) -> PreslidingFit | None:
    if not records:
        return None
    viscous = (0.0, 0.0)
    if static is not None and "viscous" in static.names:
        value, std = static.value_and_std("viscous")
        viscous = max(0.0, value), std
    spring = joint_spring(robot, records[0])
    return fit_presliding_responses(f"joint {records[0].joint}", presliding_responses(records), spring, viscous)


def joint_spring(robot: Robot, record: FrictionRecord) -> ElasticJoint | None:
    """Return the joint with its spring, the others held; None for a rigid one."""
    return locked_joint(robot, record.joint, record.angles(robot.n_u))
