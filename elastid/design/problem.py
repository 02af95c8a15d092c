"""DesignProblem: the sections of a study that a plan depends on; default amplitudes and optimal spectra."""

from collections.abc import Callable, Collection, Sequence
from dataclasses import replace
from typing import TypeAlias, TypeVar

import numpy as np

from elastid.base.arrays import FloatArray, frozen_value
from elastid.base.errors import DataError, StudyError
from elastid.design.configuration_selection import Candidates, draw_candidates, identifiable
from elastid.design.limits import power_costs, within_limits
from elastid.design.optimal import DesignCriterion, best_powers, even_powers
from elastid.design.predicted_response import Prospect
from elastid.design.spec import DesignSpec, interest
from elastid.excitation.spec import AskedTorque, MultisineSpec
from elastid.experiment.plan.plan import DesignedConfiguration, Plan, make_plan
from elastid.experiment.plan.reference_trajectory import max_excursion, movement
from elastid.experiment.simulated.plant import closed_loop_of
from elastid.experiment.simulated.rig import SimulatedRig
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.simulated import SimulatedSpec
from elastid.fit.parameter_selection import choose
from elastid.fit.spec import FitSpec
from elastid.frf.spec import Friction
from elastid.model.formulation import EXACT
from elastid.model.spec import ModelSpec
from elastid.parameters import Parameters
from elastid.record import Configuration, Motion
from elastid.robot import Robot

Value = TypeVar("Value")
# The model of a measurement and its configuration.
Measurement: TypeAlias = tuple[Prospect, Configuration]


@frozen_value
class DesignProblem:
    """Sections of a study that a plan depends on, and values of earlier fits.

    excluded_configurations: not used by the fit.  model: of the fit.  typical_spectrum (F, n_u), Nm: default for
    configurations.  friction: `none` if the estimator does not compensate motor friction.
    """

    robot: Robot
    excitation: MultisineSpec
    experiment: ExperimentSpec
    fit: FitSpec
    quantity: Motion
    seed: int
    design: DesignSpec | None = None
    excluded_configurations: tuple[str, ...] = ()
    fitted_values: tuple[tuple[str, float], ...] = ()
    model: ModelSpec = EXACT
    typical_spectrum: FloatArray | None = None
    friction: Friction = "none"

    @property
    def simulated(self) -> SimulatedSpec:
        """Simulated rig, with noise and controller."""
        return self.experiment.as_simulated()

    @property
    def parameters(self) -> Parameters:
        """Parameters of the fit, at the values of earlier fits.

        Groups of configurations have separate parameters only without a `design` section, which selects configurations
        of one robot.
        """
        names = () if self.design is not None else tuple(self.experiment.configurations)
        parameters = choose(self.fit, self.robot, [name for name in names if name not in self.excluded_configurations])
        fit = dict(self.fitted_values)
        return parameters.with_values(
            {p.name: min(max(fit[p.stands_for], p.lower), p.upper) for p in parameters.free if p.stands_for in fit}
        )

    @property
    def criterion(self) -> DesignCriterion:
        """D-optimality for the parameters of the section `design`, or for all parameters."""
        design, names = self.design, self.parameters.free_names
        return DesignCriterion(interest(names, () if design is None else design.parameters))

    def candidates(self, design: DesignSpec) -> Candidates:
        """Return the candidates within the joint limits minus the excursion of the carrier and a margin."""
        carrier, excitation, experiment = self.simulated.carrier, self.excitation, self.experiment
        excursion = np.zeros(self.robot.n_u)
        if carrier is not None:
            start_s = (experiment.transient_periods + experiment.periods / 2) * excitation.period + experiment.ramp / 2
            excursion = max_excursion(carrier, len(excursion), excitation.period, start_s) / (1 - excitation.margin)
        return draw_candidates(design.candidates, self.robot, self.seed, excursion)

    def plan(
        self, experiment: ExperimentSpec, choices: Sequence[DesignedConfiguration] = (),
        spectra: dict[str, FloatArray] | None = None
    ) -> Plan:  # fmt: skip
        """Plan experiments; spectra (F, n_u) of configurations, default `typical_spectrum`."""
        spectra_of = dict(spectra or {})
        if self.typical_spectrum is not None:
            for name in (*experiment.configurations, *(choice.configuration.name for choice in choices)):
                spectra_of.setdefault(name, self.typical_spectrum)
        excitation = self.excitation
        loop = closed_loop_of(self.robot, self.simulated.controller, excitation.rate_hz, excitation.inject)
        return make_plan(excitation, experiment, self.robot, self.seed, choices, spectra_of, loop)

    def rig(self, plan: Plan) -> SimulatedRig:
        """Return the simulated rig with the nominal robot for a plan."""
        return SimulatedRig(self.robot, self.experiment.with_truth({}), plan, self.seed)

    def probe(self, experiment: ExperimentSpec, realisations: int = 4) -> Plan:
        """Plan the given configurations and eight candidates that represent all of them.

        Its phases are random instead of optimised, because it is not measured.
        """
        problem = self
        if self.excitation.phases == "optimised":
            problem = replace(self, excitation=replace(self.excitation, phases="random"))
        if self.design is None:
            return problem.plan(experiment)
        probes = self.candidates(self.design).configurations[:8]
        configurations = (replace(configuration, name=f"probe{i}") for i, configuration in enumerate(probes))
        return problem.plan(experiment, [DesignedConfiguration(probe, realisations) for probe in configurations])

    def at_equilibria(
        self, probe: Plan, value: Callable[[int, Configuration], Value], names: Collection[str] = ()
    ) -> list[Value]:
        """Return value(q, configuration) of each configuration of a probe that has an equilibrium.

        names: configurations that must have one.  Raises their StudyError or DataError, or the last error without any
        value.
        """
        values = []
        error_of_last = None
        for q, configuration in enumerate(probe.configurations):
            try:
                values.append(value(q, configuration))
            except (StudyError, DataError) as error:
                if configuration.name in names:
                    raise
                error_of_last = error
        if error_of_last is not None and not values:
            raise error_of_last
        return values

    def prospect(self, plan: Plan, q: int) -> Prospect:
        """Return the model of a measurement like the q-th configuration of a plan; negative q count from the last."""
        q %= len(plan.configurations)
        distortion = 0.0 if self.design is None else self.design.distortion
        plan_of_one = plan.at(q, plan.realisations[q])
        context = self.robot, self.parameters, self.fit, self.model, self.outputs, self.quantity, self.simulated
        velocity = movement(self.simulated.carrier, plan).velocity[plan.first_sample :][: plan.period_samples]
        return Prospect(
            *context, distortion, plan_of_one, self.experiment.realisations, velocity, self.includes_friction
        )

    @property
    def outputs(self) -> tuple[str, ...]:
        """Locations that the rig measures."""
        return self.simulated.outputs or self.robot.motor_locations

    @property
    def includes_friction(self) -> bool:
        """True if the responses will include motor friction, because it is not identifiable or not compensated."""
        n_u, M = self.robot.n_u, self.experiment.realisations
        E = self.experiment.runs(n_u)
        is_identifiable = n_u < M * E if M > 1 else self.excitation.grid == "odd-random" and n_u <= E
        has_angles = set(self.robot.motor_locations) <= set(self.outputs)
        return self.friction == "none" or not is_identifiable or not has_angles

    def fit_measurements(self, plan: Plan) -> list[Measurement]:
        """Return model and configuration of each measurement of a plan that the fit uses."""
        return [
            (replace(self.prospect(plan, q), realisations=M), c)
            for q, (c, M) in enumerate(zip(plan.configurations, plan.realisations, strict=True))
            if c.name not in self.excluded_configurations
        ]

    def prior_information(self) -> FloatArray:
        """Return the information matrix (n_x, n_x) of the priors."""
        return np.diag(np.square([0.0 if p.prior is None else 1 / p.prior.std for p in self.parameters.free]))


def with_torques(problem: DesignProblem) -> DesignProblem:
    """Return the problem with rms torques (Nm) within the limits at a few postures, if `torque_rms` is `limits`."""
    excitation = problem.excitation
    if excitation.torque_rms != "limits":
        return problem
    probe = problem.probe(replace(problem.experiment, realisations=1), 1)
    probe, _ = within_limits(problem.rig(probe), replace(excitation, flat="torque"))
    rms = np.sqrt(np.mean(np.sum(np.abs(probe.R) ** 2, axis=3) / 2, axis=(0, 1, 2)))
    return replace(problem, excitation=replace(excitation, torque_rms=tuple(rms.tolist())))


def with_typical_spectrum(problem: DesignProblem, torque_rms: AskedTorque) -> DesignProblem:
    """Return the problem with the optimal common spectrum of a few configurations, for `flat: information`.

    torque_rms: of the study, including `limits`.
    """
    if problem.excitation.flat != "information":
        return problem
    probe, excitation = problem.probe(problem.experiment), replace(problem.excitation, torque_rms=torque_rms)

    def measurement(q: int, configuration: Configuration) -> tuple[Measurement, FloatArray]:
        prospect = replace(problem.prospect(probe, q), realisations=probe.realisations[q])
        prospect.expected(configuration, problem.parameters.x)
        return (prospect, configuration), power_costs(problem.rig(probe.at(q)), excitation)

    measurements, costs = zip(*problem.at_equilibria(probe, measurement), strict=True)
    return replace(
        problem, typical_spectrum=_optimal_spectra(problem, measurements, np.concatenate(costs), is_common=True)[0]
    )


def best_spectra_of(
    problem: DesignProblem, experiment: ExperimentSpec, choices: Sequence[DesignedConfiguration],
    torque_rms: AskedTorque
) -> dict[str, FloatArray]:  # fmt: skip
    """Return the optimal spectrum (F, n_u) of each configuration; the typical one if the fit does not use it.

    Empty without `flat: information`.
    """
    if problem.typical_spectrum is None:
        return {}
    plan = problem.plan(experiment, choices)
    measurements = problem.fit_measurements(plan)
    names = [configuration.name for _, configuration in measurements]
    rows = [q for q, c in enumerate(plan.configurations) if c.name in names]
    costs = power_costs(problem.rig(plan), replace(problem.excitation, torque_rms=torque_rms))
    best = _optimal_spectra(problem, measurements, costs[rows])
    return {c.name: problem.typical_spectrum for c in plan.configurations} | dict(zip(names, best, strict=True))


def _optimal_spectra(
    problem: DesignProblem, measurements: Sequence[Measurement], cost: FloatArray, is_common: bool = False
) -> FloatArray:
    """Return optimal amplitudes (Q, F, n_u), Nm, of Q configurations, or common ones (1, F, n_u).

    cost (Q, n_o, F, n_u): `limits.power_costs`.  StudyError for fewer experiments than inputs.
    """
    x, first = problem.parameters.x, measurements[0][0]
    _, E, _, n_u = first.R.shape
    if n_u > E:
        raise StudyError(
            "excitation/power",
            f"flat: information needs as many experiments as motors; there are {E} for {n_u}. Choose another flat, or "
            "omit experiment.experiments",
            "excitation.flat",
        )
    sources = [prospect.source(c, x) for prospect, c in measurements]
    H = [source.information(P) for source, P in zip(sources, even_powers(cost), strict=True)]
    prior = problem.prior_information()
    criterion, free_information = identifiable(problem.criterion, np.array(H), prior, first.parameters)
    groups = [[[source] for source in sources]] if is_common else [[[source]] for source in sources]
    cost = cost.mean(axis=0, keepdims=True) if is_common else cost
    best = best_powers(groups, cost, criterion, (prior + free_information)[None], problem.excitation.least)
    return np.asarray(np.sqrt(best.P / E))
