"""DesignProblem: the sections of a study that a plan depends on, and the amplitudes that a study leaves open."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TypeAlias

import numpy as np

from elastid.base.arrays import FloatArray, frozen_value
from elastid.design.choice import Candidates, draw_candidates
from elastid.design.limits import within_limits
from elastid.design.optimal import DesignCriterion
from elastid.design.prospect import ExpectedResponse, Prospect
from elastid.design.spec import DesignSpec, interest
from elastid.excitation.spec import MultisineSpec
from elastid.experiment.plan.movement import one_period, reach
from elastid.experiment.plan.plan import ChosenConfiguration, Plan, make_plan
from elastid.experiment.simulated.plant import closed_loop_of
from elastid.experiment.simulated.rig import SimulatedRig
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.simulated import SimulatedSpec
from elastid.fit.parameter_choice import choose
from elastid.fit.problem.elastic import linear_model
from elastid.fit.problem.weights import weigh
from elastid.fit.spec import FitSpec
from elastid.frf.spec import Friction
from elastid.linear.linearise import Linearisation
from elastid.model.formulation import EXACT
from elastid.model.spec import ModelSpec
from elastid.parameters import Parameters
from elastid.record import Configuration, Motion
from elastid.response import Response
from elastid.robot import Robot

# A prospect, its configuration, and the realisations in which it is measured.
_Measurement: TypeAlias = tuple[Prospect, Configuration, int]


@frozen_value
class DesignProblem:
    """The sections of a study that a plan depends on, and earlier measurements.

    left_out: configurations that the fit does not use.  measured: responses that the choice adds to.  fitted_values: of
    parameters, from a fit of these.  model: of the fit.  friction: `none` if the estimator leaves that of the motors in
    the responses.
    """

    robot: Robot
    excitation: MultisineSpec
    experiment: ExperimentSpec
    fit: FitSpec
    quantity: Motion
    seed: int
    design: DesignSpec | None = None
    left_out: tuple[str, ...] = ()
    measured: tuple[Response, ...] = ()
    fitted_values: tuple[tuple[str, float], ...] = ()
    model: ModelSpec = EXACT
    friction: Friction = "none"

    @property
    def simulated(self) -> SimulatedSpec:
        """The rig that is planned for, with its noise and its controller."""
        return self.experiment.as_simulated()

    @property
    def parameters(self) -> Parameters:
        """The parameters of the fit, at the values of earlier fits.

        Robots and other groups of configurations have parameters of their own where all configurations are given; those
        chosen by a design are of one robot.
        """
        given = () if self.design is not None else tuple(self.experiment.configurations)
        parameters = choose(self.fit, self.robot, [name for name in given if name not in self.left_out])
        known = dict(self.fitted_values)
        return parameters.with_values(
            {p.name: min(max(known[p.stands_for], p.lower), p.upper) for p in parameters.free if p.stands_for in known}
        )

    @property
    def guesses(self) -> FloatArray:
        """Guesses (S, n_x) of the parameters, the nominal one first; linear parameters keep their number."""
        parameters, spec = self.parameters, None if self.design is None else self.design.robust
        if spec is None:
            return parameters.x[None]
        draw = np.random.default_rng(np.random.SeedSequence(self.seed, spawn_key=(0x90,)))
        spread = np.array([math.log(spec.factor) if p.log else 0.0 for p in parameters.free])
        drawn = parameters.x + spread * draw.standard_normal((spec.guesses - 1, len(spread)))
        return np.vstack([parameters.x, np.clip(drawn, *parameters.x_bounds)])

    @property
    def criterion(self) -> DesignCriterion:
        """The criterion of the section `design`; without it the volume of the ellipsoid of all parameters."""
        design, names = self.design, self.parameters.free_names
        return DesignCriterion(interest(names, () if design is None else design.parameters))

    def candidates(self, design: DesignSpec) -> Candidates:
        """The admissible configurations, with room for the carrier and the margin of the limits."""
        carrier, excitation, experiment = self.simulated.carrier, self.excitation, self.experiment
        swing = np.zeros(len(self.robot.driven))
        if carrier is not None:
            periods = experiment.transient_periods + experiment.periods
            run_s = periods * excitation.period + 2 * experiment.ramp
            swing = reach(carrier, len(swing), excitation.period, run_s) / (1 - excitation.margin)
        return draw_candidates(design.candidates, self.robot, self.seed, swing)

    def plan(self, experiment: ExperimentSpec, chosen: Sequence[ChosenConfiguration] = ()) -> Plan:
        """A plan of the configurations of an experiment, and of those chosen."""
        loop = closed_loop_of(self.robot, self.simulated.controller, self.excitation.rate_hz)
        return make_plan(self.excitation, experiment, self.robot, self.seed, chosen, loop)

    def rig(self, plan: Plan) -> SimulatedRig:
        """The rig that rehearses a plan: the simulated one without its truth."""
        return SimulatedRig(self.robot, self.experiment.with_truth({}), plan, self.seed)

    def probe(self, experiment: ExperimentSpec, realisations: int = 4) -> Plan:
        """A plan of the given configurations, and of eight more that stand for all candidates.

        Its phases are random where the study's are optimised, since it is not measured.
        """
        drawn = self
        if self.excitation.phases == "optimised":
            drawn = replace(self, excitation=replace(self.excitation, phases="random"))
        if self.design is None:
            return drawn.plan(experiment)
        some = self.candidates(self.design).configurations[:8]
        return drawn.plan(
            experiment, [ChosenConfiguration(replace(c, name=f"probe{i}"), realisations) for i, c in enumerate(some)]
        )

    def prospect(self, plan: Plan, q: int) -> Prospect:
        """The measurement of configurations like the q-th of a plan."""
        distortion = 0.0 if self.design is None else self.design.distortion
        own = replace(plan, configurations=(plan.configurations[q],), R=plan.R[q : q + 1, : plan.realisations[q]])
        fixed = self.robot, self.parameters, self.fit, self.model, self.outputs, self.quantity, self.simulated
        velocity, M = one_period(self.simulated.carrier, plan), self.experiment.realisations
        return Prospect(*fixed, distortion, own, M, velocity, self.friction_is_left)

    @property
    def outputs(self) -> tuple[str, ...]:
        """The places that the rig logs."""
        return self.simulated.outputs or self.robot.motor_locations

    @property
    def friction_is_left(self) -> bool:
        """True if the responses will contain the motors' friction: it is not taken out, or cannot be identified."""
        n_u, M = len(self.robot.driven), self.experiment.realisations
        E = self.experiment.runs(n_u)
        is_visible = n_u < M * E if M > 1 else self.excitation.grid == "odd-random" and n_u <= E
        return self.friction == "none" or not is_visible or not set(self.robot.motor_locations) <= set(self.outputs)

    def fitted(self, plan: Plan) -> list[_Measurement]:
        """Prospect, configuration and realisations of each configuration of a plan that the fit uses."""
        measured = enumerate(zip(plan.configurations, plan.realisations, strict=True))
        return [(self.prospect(plan, q), c, M) for q, (c, M) in measured if c.name not in self.left_out]

    def prior_information(self, x: FloatArray) -> FloatArray:
        """Information (S, n_x, n_x) of priors and earlier measurements at guesses x (S, n_x)."""
        parameters = self.parameters
        slopes = [0.0 if p.prior is None else 1 / p.prior.std for p in parameters.free]
        known = np.repeat(np.diag(np.square(slopes))[None], len(x), axis=0)
        for response in self.measured:
            linearisation = Linearisation.of_robot(self.robot, self.model, parameters.names)
            for s, guess in enumerate(x):
                model = linear_model(linearisation, response, parameters.expand(guess))
                expected = ExpectedResponse(response, model, weigh(response, self.fit), parameters, self.fit)
                known[s] += expected.information(guess)
        return known


def with_torques(problem: DesignProblem) -> DesignProblem:
    """The problem with the torques that a few postures bear, where the study leaves them to the limits."""
    excitation = problem.excitation
    if excitation.torque_rms != "limits":
        return problem
    probe = problem.probe(replace(problem.experiment, realisations=1), 1)
    if excitation.phases == "optimised":
        # The peaks that it would have if measured: phases optimised in one configuration, taken for all.
        single = replace(problem.experiment, configurations={}, realisations=1)
        phases = np.angle(problem.plan(single, [ChosenConfiguration(probe.configurations[0], 1)]).R)
        probe = replace(probe, R=np.abs(probe.R) * np.exp(1j * phases))
    probe, _ = within_limits(problem.rig(probe), excitation)
    rms = np.sqrt(np.mean(np.sum(np.abs(probe.R) ** 2, axis=3) / 2, axis=(0, 1, 2)))
    return replace(problem, excitation=replace(excitation, torque_rms=tuple(rms.tolist())))
