"""DesignProblem: the sections of a study that a plan depends on, and the plans and prospects that they give."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from elastid.base.arrays import FloatArray, frozen_value
from elastid.design.candidates import Candidates, draw_candidates
from elastid.design.choice import draw_guesses
from elastid.design.expected_response import ExpectedResponse, linear_model, variance_like
from elastid.design.optimal import DesignCriterion
from elastid.design.prospect import NoiseLevel, Prospect
from elastid.design.spec import DesignSpec, LevelSpec, interest
from elastid.excitation.spec import MultisineSpec
from elastid.experiment.plan.movement import one_period, reach
from elastid.experiment.plan.plan import ChosenConfiguration, Plan, make_plan
from elastid.experiment.simulated.plant import closed_loop_of
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.simulated import SimulatedSpec
from elastid.fit.parameter_choice import choose
from elastid.fit.problem.weights import weigh
from elastid.fit.spec import FitSpec
from elastid.frf.spec import Friction
from elastid.model.formulation import EXACT
from elastid.model.spec import ModelSpec
from elastid.parameters import ParameterSet
from elastid.record import Configuration, Motion
from elastid.response import FrequencyResponse
from elastid.robot import Robot


@frozen_value
class DesignProblem:
    """The sections of a study that a plan depends on, and earlier measurements.

    left_out: configurations that the fit does not use.  measured: responses that the choice adds to.  fitted_values:
    of parameters, from a fit of these.  like: responses whose variance is expected again.  model: of the fit.  typical
    (F, n_u): spectrum for all configurations until each has its own.  friction: `none` if the estimator leaves that of
    the motors in the responses.
    """

    robot: Robot
    excitation: MultisineSpec
    experiment: ExperimentSpec
    fit: FitSpec
    quantity: Motion
    seed: int
    design: DesignSpec | None = None
    left_out: tuple[str, ...] = ()
    measured: tuple[FrequencyResponse, ...] = ()
    fitted_values: tuple[tuple[str, float], ...] = ()
    like: tuple[FrequencyResponse, ...] = ()
    model: ModelSpec = EXACT
    typical: FloatArray | None = None
    friction: Friction = "none"

    @property
    def simulated(self) -> SimulatedSpec:
        """The rig that is planned for, with its noise and its controller."""
        return self.experiment.as_simulated()

    @property
    def parameters(self) -> ParameterSet:
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
        """Guesses (S, n_x) of the parameters, the nominal one first."""
        return draw_guesses(self.parameters, None if self.design is None else self.design.robust, self.seed)

    @property
    def criterion(self) -> DesignCriterion:
        """The criterion of the section `design`; without it the volume of the ellipsoid of all parameters."""
        design = self.design
        wanted = interest(self.parameters.free_names, () if design is None else design.parameters)
        over = design.robust.over if design is not None and design.robust is not None else "mean"
        return DesignCriterion("D" if design is None else design.criterion, wanted, over)

    def candidates(self, design: DesignSpec) -> Candidates:
        """The admissible configurations, with room for the carrier and the margin of the limits."""
        carrier, excitation, experiment = self.simulated.carrier, self.excitation, self.experiment
        swing = np.zeros(len(self.robot.driven))
        if carrier is not None:
            periods = experiment.transient_periods + experiment.periods
            run_s = periods * excitation.period + 2 * experiment.ramp
            swing = reach(carrier, len(swing), excitation.period, run_s) / (1 - excitation.margin)
        return draw_candidates(design.candidates, self.robot, self.seed, swing)

    def plan(
        self,
        experiment: ExperimentSpec,
        chosen: Sequence[ChosenConfiguration] = (),
        spectra: dict[str, FloatArray] | None = None,
    ) -> Plan:
        """A plan in which all configurations without a spectrum of their own have the typical one, if there is one."""
        own = dict(spectra or {})
        if self.typical is not None:
            for name in (*experiment.configurations, *(choice.configuration.name for choice in chosen)):
                own.setdefault(name, self.typical)
        loop = closed_loop_of(self.robot, self.simulated.controller, self.excitation.rate_hz)
        return make_plan(self.excitation, experiment, self.robot, self.seed, chosen, own, loop)

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
        outputs = self.simulated.outputs or self.robot.motor_locations
        spec = self.design.noise if self.design is not None else LevelSpec()
        variance = None
        if self.like:
            variance = variance_like(self.like, plan.freq_hz, outputs, plan.inputs) * self.experiment.realisations
        return Prospect(
            model=self.model,
            robot=self.robot,
            parameters=self.parameters,
            fit=self.fit,
            outputs=outputs,
            quantity=self.quantity,
            controller=self.simulated.controller,
            carrier_velocity=one_period(self.simulated.carrier, plan),
            level=NoiseLevel(self.simulated.noise, spec.distortion, spec.absolute, variance),
            lines=plan.lines,
            R=plan.R[q, : plan.realisations[q]],
            rate_hz=plan.rate_hz,
            period_samples=plan.period_samples,
            periods=plan.periods,
            realisations=self.experiment.realisations,
            friction_is_left=self.friction_is_left,
        )

    @property
    def friction_is_left(self) -> bool:
        """True if the responses will contain the motors' friction: it is not taken out, or cannot be identified."""
        outputs = self.simulated.outputs or self.robot.motor_locations
        n_u, M = len(self.robot.driven), self.experiment.realisations
        E = self.experiment.runs(n_u)
        is_visible = n_u < M * E if M > 1 else self.excitation.grid == "odd-random" and n_u <= E
        return self.friction == "none" or not is_visible or not set(self.robot.motor_locations) <= set(outputs)

    def fitted(self, plan: Plan) -> list[tuple[Prospect, Configuration, int]]:
        """Prospect, configuration and realisations of each configuration of a plan that the fit uses."""
        measured = enumerate(zip(plan.configurations, plan.realisations, strict=True))
        return [(self.prospect(plan, q), c, M) for q, (c, M) in measured if c.name not in self.left_out]

    def prior_information(self, x: FloatArray) -> FloatArray:
        """Information (S, n_x, n_x) of priors and earlier measurements at guesses x (S, n_x)."""
        parameters = self.parameters
        slopes = [0.0 if p.prior is None else 1 / p.prior.std for p in parameters.free]
        known = np.repeat(np.diag(np.square(slopes))[None], len(x), axis=0)
        for response in self.measured:
            for s, guess in enumerate(x):
                model = linear_model(self.robot, self.model, parameters, response, guess)
                expected = ExpectedResponse(response, model, weigh(response, self.fit), parameters, self.fit)
                known[s] += expected.information(guess)
        return known
