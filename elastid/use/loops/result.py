"""Loops of a study: today's controller, as stated and as measured, and the designed one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from elastid.base.arrays import FloatArray, frozen_value, labelled
from elastid.base.display import number
from elastid.base.errors import StudyError
from elastid.base.statistics import QUANTILE_95
from elastid.experiment.specs.simulated import ControllerSpec
from elastid.fit.result import Result
from elastid.linear.equilibrium import equilibrium
from elastid.record import Configuration
from elastid.simulation.controller import Gains, filters_of, gains_of
from elastid.use.loops.assess import LoopState, assess
from elastid.use.loops.cascade import Cascade
from elastid.use.loops.design import robust
from elastid.use.loops.plants import PlantMode, Plants, PostureFamily
from elastid.use.loops.sensitivity import MeasuredLoops

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
