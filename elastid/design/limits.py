r"""Amplitudes that a robot can bear: scaled to its limits by linear prediction, then rehearsed on the nonlinear model.

.. math:: |x_{movement}| + |x_{multisine}| \le (1 - margin)\, limit, \qquad
          x = torque, position, velocity, acceleration

The movement's peaks (holding torque, friction, carrier, ramps) come from a rehearsal without multisine, those of the
multisine from the closed loop's linear response. Every experiment is then rehearsed as a whole run on the nominal robot
with its friction and noise, and the configuration scaled again until all peaks are inside.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, frozen
from elastid.base.errors import DataError, StudyError
from elastid.base.execution import Progress, ordered, silent
from elastid.base.units import of_translation
from elastid.excitation.crest import peaks as signal_peaks
from elastid.excitation.spec import MultisineSpec
from elastid.experiment.plan.plan import Experiment, Plan
from elastid.experiment.plan.rehearsal import Rehearsal, derivatives
from elastid.experiment.plan.torque_spectra import torque_rms
from elastid.experiment.simulated.closed_loop import closed_loop_of
from elastid.experiment.simulated.rig import SimulatedRig
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.simulated import CarrierSpec
from elastid.record import Configuration
from elastid.robot import Robot

# `turning back`: how far a motor's speed falls below that of a carrier of constant velocity, which is the limit, in the
# measured periods.
QUANTITIES = ("torque", "position", "velocity", "acceleration", "turning back")
UNITS = ("N*m", "rad", "rad/s", "rad/s^2", "rad/s")

_ROUNDS = 8  # of rehearsals
_SPARE = 0.98  # of the room that a rescaled configuration is to fill
_TOO_SMALL = 1.05  # below this factor it is not worth while to raise the amplitudes again
_BALANCING_STEPS = 15
_SAMPLES_PER_CYCLE = 16


@dataclass(frozen=True)
class LimitUse:
    """Largest values in the rehearsal, and the limits: peak, limit (Q, 5, n_u) for QUANTITIES, infinite where none.

    position: about the configuration, to either side, its limit the room to the nearer end.  factor (Q, n_u): by which
    the amplitudes of the study were multiplied.  notes: a word for every configuration that was scaled down.  nearest:
    the run that came closest to a limit.  sliding: inputs that translate, in N and m.
    """

    configurations: tuple[str, ...]
    inputs: tuple[str, ...]
    peak: FloatArray
    limit: FloatArray
    factor: FloatArray
    margin: float
    notes: tuple[str, ...] = ()
    nearest: str = ""
    sliding: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Freeze."""
        for name in ("peak", "limit", "factor"):
            object.__setattr__(self, name, frozen(getattr(self, name)))

    @property
    def used(self) -> FloatArray:
        """Part of each limit that is used (Q, 5, n_u)."""
        used: FloatArray = self.peak / self.limit
        return used

    @property
    def closest(self) -> str:
        """Where a limit is closest, in words."""
        if not np.isfinite(self.limit).any():
            return "no limits are given"
        q, kind, i = np.unravel_index(np.argmax(self.used), self.used.shape)
        return (
            f"peaks use at most {self.used[q, kind, i]:.0%} of a limit ({QUANTITIES[kind]} of {self.inputs[i]} in "
            f"{self.configurations[q]}: {self.peak[q, kind, i]:.4g} of {self.limit[q, kind, i]:.4g} "
            f"{unit_of(int(kind), self.inputs[i] in self.sliding)})"
        )


def unit_of(kind: int, slides: bool) -> str:
    """SI unit of one of QUANTITIES, of a motor whose joint turns or slides."""
    return of_translation(UNITS[kind]) if slides else UNITS[kind]


def within_limits(
    plan: Plan,
    excitation: MultisineSpec,
    experiment: ExperimentSpec,
    robot: Robot,
    seed: int,
    jobs: int = 1,
    progress: Progress = silent,
) -> tuple[Plan, LimitUse]:
    """The plan with amplitudes whose peaks in the rehearsal keep the margin, and these peaks.

    torque_rms: limits is scaled up or down, motor by motor; numbers are scaled down where they must be, all motors of a
    configuration alike.  Raises StudyError where a limit leaves no room for any excitation.
    """
    simulated = experiment.simulated
    assert simulated is not None  # a recorded experiment has no design
    rig = SimulatedRig(robot, replace(experiment, simulated=replace(simulated, truth={})), plan, seed)
    limit, base = _limits_and_base(rig, excitation.margin)
    allowed = (1 - excitation.margin) * limit
    is_free = excitation.torque_rms == "limits"
    factor = np.ones((len(plan.configurations), len(plan.inputs)))
    if is_free:
        for q in range(len(factor)):
            factor[q] = _filling(plan, q, experiment, robot, allowed[q] - base[q], excitation.flat == "information")
    factor, runs = _rehearsed(rig, factor, base, allowed, is_free, jobs, progress)
    scaled = replace(plan, R=plan.R * factor[:, None, None, None, :])
    notes = () if is_free else _notes(plan, factor, excitation.margin)
    names = tuple(c.name for c in plan.configurations)
    peak, nearest = _largest(plan, runs), _nearest(plan, runs, limit)
    return scaled, LimitUse(names, plan.inputs, peak, limit, factor, excitation.margin, notes, nearest, plan.sliding)


def costs(plan: Plan, excitation: MultisineSpec, experiment: ExperimentSpec, robot: Robot, seed: int) -> FloatArray:
    r"""What powers cost of the limits in each configuration: c (Q, n_o, F, n_u) with sum_kl c_okl P_kl <= 1.

    .. math:: c_{okl} = \frac{|T_{okl}|^2}{2 E}\, \frac{\kappa^2}{room_o^2}, \qquad \kappa^2 = 2 \ln (2 F E M)

    T from injected torques to torque, position, velocity and acceleration of the motors, room_o what the movement
    leaves of a limit, kappa the crest factor that M E experiments of F lines with random phases lead one to expect;
    where torque_rms is given, also c = 1 / (2 E rms_l^2).  P: |R|^2 summed over the E experiments of a realisation.
    Raises StudyError where a limit leaves no room, and where nothing limits a motor.
    """
    simulated = experiment.simulated
    assert simulated is not None  # a recorded experiment has no design
    rig = SimulatedRig(robot, replace(experiment, simulated=replace(simulated, truth={})), plan, seed)
    limit, base = _limits_and_base(rig, excitation.margin)
    room = (1 - excitation.margin) * limit - base
    _, M, E, F, n_u = plan.R.shape
    crest = 2 * np.log(2 * F * E * M)
    own = np.zeros((0, F, n_u))
    if excitation.torque_rms != "limits":
        rms = torque_rms(excitation, robot)
        own = np.repeat(np.diag(1 / (2 * E * rms**2))[:, None, :], F, axis=1)
    found = []
    for configuration, here in zip(plan.configurations, room, strict=True):
        if excitation.torque_rms == "limits":
            _check_ends(plan, here)
        loop = closed_loop_of(robot, simulated.controller, plan.rate_hz)(configuration, plan.freq_hz)
        power = np.abs(loop.of(("torque", "position", "velocity", "acceleration"))) ** 2
        least = np.array([here[0], here[1], np.minimum(here[2], here[4]), here[3]]).ravel()
        motion = np.swapaxes(power, 0, 1) * (crest / (2 * E * least**2))[:, None, None]
        found.append(np.concatenate([own, motion]))
    return np.array(found)


def nearest_run(plan: Plan, peaks: LimitUse, experiment: ExperimentSpec, robot: Robot, seed: int) -> Rehearsal:
    """The rehearsal of the run that came closest to a limit, once more, with its signals."""
    assert experiment.simulated is not None  # a recorded experiment has no design
    experiment = replace(experiment, simulated=replace(experiment.simulated, truth={}))
    run = next(run for run in plan.experiments if run.name == peaks.nearest)
    position, torque = SimulatedRig(robot, experiment, plan, seed).rehearse(run)
    return Rehearsal(run, plan.rate_hz, plan.first_sample, position, torque)


def _limits(robot: Robot, configuration: Configuration, carrier: CarrierSpec | None, plan: Plan) -> FloatArray:
    """(5, n_u), in the order of QUANTITIES."""
    limits = [joint.limits for joint in robot.driven]
    angles = configuration.angles
    room = [min(one.angle[1] - angle, angle - one.angle[0]) for one, angle in zip(limits, angles, strict=True)]
    is_offset = carrier is not None and carrier.kind == "offset"
    v = np.abs(carrier.velocities(len(plan.inputs))) if carrier is not None and is_offset else np.inf
    rows = ([x.torque for x in limits], room, [x.velocity for x in limits], [x.acceleration for x in limits])
    return np.array([*rows, np.broadcast_to(v, len(limits))], dtype=np.float64)


def _limits_and_base(rig: SimulatedRig, margin: float) -> tuple[FloatArray, FloatArray]:
    """Limits and the peaks without multisine, both (Q, 5, n_u); StudyError where these leave no room."""
    plan = rig.plan
    limit = np.array([_limits(rig.robot, c, rig.simulated.carrier, plan) for c in plan.configurations])
    first = {e.configuration.name: e for e in reversed(plan.experiments)}
    base = np.array([_moving(rig, first[c.name]) for c in plan.configurations])
    _check_room(plan, rig.robot, base, limit, margin)
    return limit, base


def _check_room(plan: Plan, robot: Robot, base: FloatArray, limit: FloatArray, margin: float) -> None:
    """StudyError where gravity, friction and movement alone need what the margin leaves of a limit."""
    used = base / limit
    q, kind, i = np.unravel_index(np.argmax(used), used.shape)
    if used[q, kind, i] < 1 - margin:
        return
    advice = {
        "torque": "move the configuration, or correct limits.torque",
        "position": "move the configuration away from the end of the joint, or make the carrier smaller",
        "turning back": "raise the carrier's velocity well above what friction and the ramps disturb",
    }.get(QUANTITIES[kind], "make the carrier slower, or the ramp longer")
    unit = unit_of(int(kind), robot.driven[i].slides)
    raise StudyError(
        f"configuration {plan.configurations[q].name}: no excitation fits into the limits of joint "
        f"{robot.driven[i].name}. Without any, its motor goes to {base[q, kind, i]:.4g} {unit} "
        f"({QUANTITIES[kind]}), the limit is {limit[q, kind, i]:.4g} {unit}, of which excitation.margin keeps "
        f"{margin:.0%} free; {advice}"
    )


def _filling(
    plan: Plan, q: int, experiment: ExperimentSpec, robot: Robot, room: FloatArray, is_shared: bool
) -> FloatArray:
    """Factors (n_u,) with which every motor fills its room (5, n_u), by linear prediction; StudyError where endless.

    is_shared: powers have been shared out between the motors; their peaks keep the proportion of their RMS.
    """
    assert experiment.simulated is not None
    _check_ends(plan, room)
    predict = closed_loop_of(robot, experiment.simulated.controller, plan.rate_hz)
    loop = predict(plan.configurations[q], plan.freq_hz)
    response = loop.of(("torque", "position", "velocity", "acceleration"))

    def used(largest: FloatArray) -> FloatArray:
        each = largest.reshape(4, -1)
        ratio: FloatArray = (np.concatenate([each, each[2:3]]) / room).max(axis=0)
        return ratio

    def peak_used(a: FloatArray, realisations: ComplexArray) -> FloatArray:
        S = np.einsum("foi,mefi->meof", response, realisations * a)
        return used(np.max([signal_peaks(plan.lines, one, _SAMPLES_PER_CYCLE).max(axis=0) for one in S], axis=0))

    a = wanted = np.ones(len(plan.inputs))
    if is_shared:
        S = np.einsum("foi,efi->eof", response, plan.R[q, 0])
        wanted = used(np.sqrt(np.sum(np.abs(S) ** 2, axis=2).mean(axis=0)))
    for _ in range(_BALANCING_STEPS):
        a = a * (wanted / peak_used(a, plan.R[q, :1])) ** 0.8
    filled: FloatArray = a / max(peak_used(a, plan.R[q, m : m + 1]).max() for m in range(plan.R.shape[1]))
    return filled


def _check_ends(plan: Plan, room: FloatArray) -> None:
    """StudyError where a motor has endless room (5, n_u)."""
    endless = [name for name, column in zip(plan.inputs, room.T, strict=True) if not np.isfinite(column).any()]
    if endless:
        raise StudyError(
            f"excitation.torque_rms: limits needs a limit of every motor, and {', '.join(endless)} has none; give "
            "limits: {torque: ..., velocity: ...} in the robot's file, or numbers for torque_rms"
        )


def _rehearsed(
    rig: SimulatedRig,
    factor: FloatArray,
    base: FloatArray,
    allowed: FloatArray,
    is_free: bool,
    jobs: int,
    progress: Progress,
) -> tuple[FloatArray, dict[str, FloatArray]]:
    """Factors (Q, n_u) with which every run keeps inside `allowed` (Q, 5, n_u), and each run's peaks (5, n_u) there."""
    plan = rig.plan
    runs: dict[str, FloatArray] = {}
    open_ = np.ones(len(factor), dtype=np.bool_)
    for round_ in range(_ROUNDS):
        runs |= _all_peaks(rig, factor, open_, jobs, progress)
        peak = _largest(plan, runs)
        with np.errstate(divide="ignore", invalid="ignore"):
            growth = np.where(peak > base, (allowed - base) / (peak - base), np.inf).min(axis=(1, 2))
        may_grow = is_free and round_ == 0
        open_ = (peak > allowed).any(axis=(1, 2)) | (may_grow & (_SPARE * growth > _TOO_SMALL))
        if not open_.any():
            return factor, runs
        factor = np.where(open_[:, None], factor * (_SPARE * np.minimum(growth, 10.0))[:, None], factor)
    names = ", ".join(c.name for c, unsettled in zip(plan.configurations, open_, strict=True) if unsettled)
    raise StudyError(
        f"configuration {names}: after {_ROUNDS} rehearsals with ever smaller amplitudes the peaks are still beyond "
        "the limits; lower excitation.torque_rms, or raise excitation.margin or the limits"
    )


def _all_peaks(
    rig: SimulatedRig, factor: FloatArray, wanted: BoolArray, jobs: int, progress: Progress
) -> dict[str, FloatArray]:
    """Peaks (5, n_u) of every run of the wanted configurations, by its name."""
    plan = replace(rig.plan, R=rig.plan.R * factor[:, None, None, None, :])
    names = {c.name for c, is_wanted in zip(plan.configurations, wanted, strict=True) if is_wanted}
    todo = [e for e in plan.experiments if e.configuration.name in names]
    found = ordered(partial(_peaks_of, replace(rig, plan=plan)), todo, jobs, progress)
    return {experiment.name: one for experiment, one in zip(todo, found, strict=True)}


def _largest(plan: Plan, runs: Mapping[str, FloatArray]) -> FloatArray:
    """Largest peaks (Q, 5, n_u) of the runs in each configuration."""
    of = {
        c.name: [runs[e.name] for e in plan.experiments if e.configuration.name == c.name] for c in plan.configurations
    }
    return np.array([np.max(of[c.name], axis=0) for c in plan.configurations])


def _nearest(plan: Plan, runs: Mapping[str, FloatArray], limit: FloatArray) -> str:
    """The run that comes closest to a limit (Q, 5, n_u)."""
    index = {c.name: q for q, c in enumerate(plan.configurations)}
    return max(plan.experiments, key=lambda e: float((runs[e.name] / limit[index[e.configuration.name]]).max())).name


def _peaks_of(rig: SimulatedRig, experiment: Experiment) -> FloatArray:
    """Peaks (5, n_u) of one run; a motor that is lost has gone to twice its limits."""
    try:
        position, torque = rig.rehearse(experiment)
    except DataError:
        assert rig.spec.simulated is not None
        limit = _limits(rig.robot, experiment.configuration, rig.spec.simulated.carrier, rig.plan)
        return np.where(np.isfinite(limit), 2 * limit, 0.0)
    return peaks_of_run(rig, experiment, position, torque)


def _moving(rig: SimulatedRig, experiment: Experiment) -> FloatArray:
    """Peaks (5, n_u) without multisine; StudyError where even so a motor is lost."""
    try:
        return peaks_of_run(rig, experiment, *rig.rehearse(experiment, 0.0))
    except DataError as error:
        raise StudyError(f"without any excitation the robot does not stay: {error}") from None


def peaks_of_run(rig: SimulatedRig, experiment: Experiment, position: FloatArray, torque: FloatArray) -> FloatArray:
    """Peaks (5, n_u) of motor angles and torques (n, n_u) of a whole run."""
    plan = rig.plan
    velocity, acceleration = derivatives(position, plan.rate_hz)
    rows = [torque, position - experiment.configuration.angles, velocity, acceleration]
    largest = [np.abs(row).max(axis=0) for row in rows]
    assert rig.spec.simulated is not None
    carrier = rig.spec.simulated.carrier
    back = np.zeros(len(plan.inputs))
    if carrier is not None and carrier.kind == "offset":
        v = carrier.velocities(len(plan.inputs))
        end = plan.run_samples - plan.first_sample
        measured = velocity[end - plan.periods * plan.period_samples : end]
        back = np.maximum(0.0, np.abs(v) - (np.sign(v) * measured).min(axis=0))
    return np.array([*largest, back])


def _notes(plan: Plan, factor: FloatArray, margin: float) -> tuple[str, ...]:
    return tuple(
        f"configuration {c.name}: excitation.torque_rms was lowered to {f[0]:.1%}, so that {margin:.0%} of every limit "
        "stays free in the rehearsal"
        for c, f in zip(plan.configurations, factor, strict=True)
        if f[0] < 1
    )
