"""Amplitudes that a study leaves open: torques from the robot's limits, spectra of the most information.

Each configuration gets its own spectrum, all of them computed jointly for the criterion of the design, since they add.
Before configurations are chosen a typical spectrum, the best one common to several candidates, stands for all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import DataError, StudyError
from elastid.design.choice import visible
from elastid.design.limits import power_costs, within_limits
from elastid.design.optimal_powers import best_powers, even_powers
from elastid.design.problem import DesignProblem
from elastid.design.prospect import Prospect
from elastid.excitation.spec import AskedTorque
from elastid.experiment.plan.plan import ChosenConfiguration, Plan
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.record import Configuration


def with_torques(problem: DesignProblem) -> DesignProblem:
    """The problem with the torques that a few postures bear, where the study leaves them to the limits."""
    excitation, experiment = problem.excitation, problem.experiment
    if excitation.torque_rms != "limits":
        return problem
    probe = _with_phases(problem, problem.probe(replace(experiment, realisations=1), 1))
    probe, _ = within_limits(probe, replace(excitation, flat="torque"), experiment, problem.robot, problem.seed)
    rms = np.sqrt(np.mean(np.sum(np.abs(probe.R) ** 2, axis=3) / 2, axis=(0, 1, 2)))
    return replace(problem, excitation=replace(excitation, torque_rms=tuple(rms.tolist())))


def _with_phases(problem: DesignProblem, probe: Plan) -> Plan:
    """The probe with the peaks that it would have if measured: phases optimised in one configuration, taken for all."""
    if problem.excitation.phases != "optimised":
        return probe
    single = replace(problem.experiment, configurations={}, realisations=1)
    phases = np.angle(problem.plan(single, [ChosenConfiguration(probe.configurations[0], 1)]).R)
    return replace(probe, R=np.abs(probe.R) * np.exp(1j * phases))


def with_typical_spectrum(problem: DesignProblem, torque_rms: AskedTorque) -> DesignProblem:
    """The problem with the spectrum of the most information about a few configurations, for `flat: information`.

    torque_rms: as the study has it, `limits` included.
    """
    if problem.excitation.flat != "information":
        return problem
    probe, measurements, costs = problem.probe(problem.experiment), [], []
    refused: StudyError | DataError | None = None
    for q, configuration in enumerate(probe.configurations):
        try:
            prospect = problem.prospect(probe, q)
            for x in problem.guesses:
                prospect.expected(configuration, x)
            single = replace(probe, configurations=probe.configurations[q : q + 1], R=probe.R[q : q + 1])
            costs.append(_costs(problem, single, torque_rms))
            measurements.append((prospect, configuration, probe.realisations[q]))
        except (StudyError, DataError) as error:
            refused = error
    if refused is not None and not measurements:
        raise refused
    return replace(problem, typical=_best(problem, measurements, np.concatenate(costs), together=True)[0])


def best_spectra_of(
    problem: DesignProblem, experiment: ExperimentSpec, chosen: Sequence[ChosenConfiguration], torque_rms: AskedTorque
) -> dict[str, FloatArray]:
    """The best spectrum (F, n_u) of each configuration, the typical one of those that the fit does not see.

    Empty without `flat: information`.
    """
    if problem.typical is None:
        return {}
    plan = problem.plan(experiment, chosen)
    fitted = problem.fitted(plan)
    names = [configuration.name for _, configuration, _ in fitted]
    rows = [q for q, c in enumerate(plan.configurations) if c.name in names]
    best = _best(problem, fitted, _costs(problem, plan, torque_rms)[rows])
    return {c.name: problem.typical for c in plan.configurations} | dict(zip(names, best, strict=True))


def _best(
    problem: DesignProblem,
    measurements: Sequence[tuple[Prospect, Configuration, int]],
    cost: FloatArray,
    together: bool = False,
) -> FloatArray:
    """Amplitudes (Q, F, n_u) in Nm of Q configurations, or (1, F, n_u) where all have the same.

    measurements: prospect, configuration and realisations of each.  cost (Q, n_o, F, n_u): `limits.power_costs`.
    StudyError where fewer experiments than inputs are run.
    """
    x = problem.guesses
    first = measurements[0][0]
    E, n_u = first.R.shape[1], first.R.shape[3]
    if n_u > E:
        raise StudyError(
            f"excitation.flat: information needs as many experiments as motors, and there are {E} for {n_u}: with "
            "fewer the inputs are separated by neighbouring lines, which must all be strong; take another flat, or "
            "leave experiment.experiments out"
        )
    sources = [[prospect.source(c, guess, M) for guess in x] for prospect, c, M in measurements]
    even = even_powers(cost)
    H = [[source.information(P) for source in guesses] for guesses, P in zip(sources, even, strict=True)]
    known = problem.prior_information(x)
    criterion, ground = visible(problem.criterion, np.swapaxes(np.array(H), 0, 1), known, first.parameters)
    groups = [sources] if together else [[guesses] for guesses in sources]
    cost = cost.mean(axis=0, keepdims=True) if together else cost
    best = best_powers(groups, cost, criterion, known + ground, problem.excitation.least)
    return np.asarray(np.sqrt(best.P / E))


def _costs(problem: DesignProblem, plan: Plan, torque_rms: AskedTorque) -> FloatArray:
    excitation = replace(problem.excitation, torque_rms=torque_rms)
    return power_costs(plan, excitation, problem.experiment, problem.robot, problem.seed)
