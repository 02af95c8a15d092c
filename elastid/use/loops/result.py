"""Loops of a study: today's controller, as stated and as measured, the designed one; steps on the twin."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from elastid.base.arrays import FloatArray, frozen_value, labelled
from elastid.base.display import number
from elastid.base.errors import DataError, StudyError
from elastid.base.statistics import QUANTILE_95
from elastid.experiment.simulated.plant import exact_plant
from elastid.experiment.specs.simulated import ControllerSpec
from elastid.fit.result import FitResult
from elastid.linear.equilibrium import equilibrium
from elastid.model.formulation import EXACT
from elastid.record import Configuration
from elastid.robot import Robot
from elastid.simulation.closed_loop import Commands, simulate
from elastid.simulation.controller import Filters, Gains, filters_of, gains_of
from elastid.use.loops.assess import LoopState, assess
from elastid.use.loops.cascade import Cascade
from elastid.use.loops.design import robust
from elastid.use.loops.measured import MeasuredLoops
from elastid.use.loops.plants import PlantMode, Plants, PostureFamily

TODAY, DESIGNED = "today's controller", "designed controller"


@frozen_value
class Loops:
    """today: None where it is not known, with its `source`.  designed, with its gains, and steps on the twin.

    steps: None where the twin cannot be simulated, for the reason in no_steps.  count: of draws.
    """

    name: str
    joints: tuple[str, ...]
    units: tuple[str, ...]
    rate_hz: float = labelled("rate of the controller", "Hz")
    count: int
    source: str
    today: LoopState | None
    measured: tuple[MeasuredLoops, ...]
    designed: LoopState
    gains: Cascade
    steps: Steps | None
    no_steps: str = ""

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
    """A known controller: gains (n_u,) or (Q, n_u) with filters, or a `ControllerSpec`, and where it is known from.

    rate_hz: its own, which may be another than that of the loops that are designed.
    """

    source: str
    rate_hz: float
    gains: Gains | None = None
    filters: Filters | None = None
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
    """postures, rate and delay of the loops that are designed; draws of the fit; judge: robot of the steps."""

    postures: tuple[Configuration, ...]
    rate_hz: float
    delay_samples: int
    draws: int
    seed: int
    judge: Robot
    judge_name: str


def design_loops(
    name: str, result: FitResult, asked: Asked, today: Today | None, measured: Sequence[MeasuredLoops],
    say: Callable[[str], None] = lambda _: None,
) -> Loops:  # fmt: skip
    """FitError where no gains keep the limit, StudyError for a posture without rest."""
    family = PostureFamily.of(result, asked.postures, asked.rate_hz)
    plants = family.estimate()

    def drawn_of(family: PostureFamily) -> Plants | None:
        return family.draws(result, asked.draws, asked.seed) if asked.draws else None

    drawn = drawn_of(family)
    modes = tuple(_sprung(family.modes(q), family.names[q]) for q in range(len(family.names)))
    robot = family.family.robot
    joints = tuple(joint.name for joint in robot.driven)
    state = None
    if today is not None:
        filters = today.filters if today.spec is None else filters_of(joints, today.spec, today.rate_hz)
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
    slowest = float(designed.bandwidth_hz.min())
    stepped, reason = None, ""
    try:
        stepped = steps(asked.judge, asked.judge_name, asked.postures, spec, asked.rate_hz, slowest)
    except StudyError as error:  # the gains are no worse for it
        reason = str(error)
    units = tuple(joint.unit for joint in robot.driven)
    return Loops(
        name, joints, units, asked.rate_hz, asked.draws, "" if today is None else today.source, state,
        tuple(measured), designed, found, stepped, reason,
    )  # fmt: skip


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


def with_delay(gains: Gains, delay: int) -> tuple[Gains, Filters]:
    """Gains of n_u axes with a delay alone."""
    return gains, Filters(((),) * len(gains.kp), delay)


def inertias(result: FitResult, configuration: Configuration, rate_hz: float) -> FloatArray:
    """J (n_u,) of a configuration, by which M_S compares torques."""
    return np.asarray(PostureFamily.of(result, [configuration], rate_hz).inertia[0])


STEP = {"rad": np.radians(0.05), "m": 1e-4}  # of a reference


@frozen_value
class Steps:
    """Responses (Q, n_u, n) of each motor to a step of its own reference, over the step, others held.

    overshoot, settled_s, end (Q, n_u): largest beyond 1, time of the last leave of 5 % about the end, and the end
    itself; friction keeps it from 1.
    """

    judge: str
    postures: tuple[str, ...]
    axes: tuple[str, ...]
    time_s: FloatArray = labelled("time", "s")
    response: FloatArray = labelled("angle over the step of its reference", "", "postures axes time_s")

    @property
    def overshoot(self) -> FloatArray:
        """(Q, n_u)."""
        return np.asarray(np.maximum(self.response.max(axis=2) - 1, 0.0))

    @property
    def end(self) -> FloatArray:
        """(Q, n_u), mean of the last tenth."""
        return np.asarray(self.response[:, :, -max(1, len(self.time_s) // 10) :].mean(axis=2))

    @property
    def settled_s(self) -> FloatArray:
        """(Q, n_u), the last time where it does not settle."""
        away = np.abs(self.response - self.end[:, :, None]) > 0.05  # of a step, in which it has settled
        last = len(self.time_s) - 1 - np.argmax(away[:, :, ::-1], axis=2)
        return np.asarray(np.where(away.any(axis=2), self.time_s[last], 0.0))


def steps(
    robot: Robot, judge: str, postures: Sequence[Configuration], controller: ControllerSpec, rate_hz: float,
    slowest_hz: float,
) -> Steps:  # fmt: skip
    """Of a robot with its friction; slowest_hz: bandwidth of its slowest axis.  DataError where a motor is lost."""
    n = int(np.ceil(min(4.0 / slowest_hz, 10.0) * rate_hz))  # four periods, at most 10 s
    rows = [list(_of_posture(robot, posture, controller, rate_hz, n)) for posture in postures]
    axes = tuple(joint.name for joint in robot.driven)
    return Steps(judge, tuple(each.name for each in postures), axes, np.arange(n) / rate_hz, np.array(rows))


def _of_posture(
    robot: Robot, posture: Configuration, controller: ControllerSpec, rate_hz: float, n: int
) -> Iterator[FloatArray]:
    plant, point = exact_plant(robot, EXACT, rate_hz, posture, controller=controller)
    model = plant.model
    gains = gains_of(model, point.q, controller)
    rest = model.B.T @ point.q
    for i, joint in enumerate(robot.driven):
        position, none = np.tile(rest, (n, 1)), np.zeros((n, model.n_u))
        size = STEP[joint.unit]
        position[1:, i] += size
        torque = np.tile(point.u, (n, 1))
        try:
            run = simulate(plant.loop, gains, Commands(position, none, torque, none, none), point.q)
        except DataError as error:
            raise StudyError("use/gains", f"posture {posture.name}, a step of axis {joint.name}: {error}") from error
        yield ((run.q @ model.B)[:, i] - rest[i]) / size
