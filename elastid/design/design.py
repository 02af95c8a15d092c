"""The design of an experiment: configurations chosen if the study asks for it, a plan within limits, its forecast."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import Note, StudyError
from elastid.base.execution import Execution
from elastid.design.configuration_selection import choose_configurations
from elastid.design.forecast import COULOMB_RATIO, Forecast, LimitUse, check_line_count, forecast
from elastid.design.limits import within_limits
from elastid.design.predicted_response import Prospect
from elastid.design.problem import DesignProblem, Measurement, best_spectra_of, with_torques, with_typical_spectrum
from elastid.design.spec import DesignSpec, n_free_configurations, unit_time_s
from elastid.experiment.plan.plan import DesignedConfiguration, Plan
from elastid.experiment.simulated.plant import true_robot
from elastid.experiment.specs.simulated import CarrierSpec
from elastid.fit.parameter_selection import with_tolerances
from elastid.friction.robot_friction import coulomb_torques, frictions
from elastid.linear.presliding import AMPLITUDES
from elastid.record import Configuration, drive_unit
from elastid.robot import Robot


def sticking(plan: Plan, robot: Robot, carrier: CarrierSpec | None) -> tuple[Note, ...]:
    """A note for each motor whose Coulomb friction is more than a third of its rms torque (Nm, link side), at rest.

    Under a carrier the joints slide with any multisine.
    """
    if carrier is not None:
        return ()
    # Friction holds shafts, which gears may couple.
    power = np.sum(np.abs(plan.R @ np.linalg.inv(robot.mixing)) ** 2, axis=3) / 2
    rms = np.sqrt(power.sum(axis=(0, 1, 2)) / len(plan.experiments))
    notes = []
    for joint, torque, coulomb in zip(robot.driven, rms.tolist(), coulomb_torques(robot).tolist(), strict=True):
        if coulomb > COULOMB_RATIO * torque:
            unit = drive_unit(joint.slides)
            text = (
                f"its Coulomb friction ({coulomb:.3g} {unit}) exceeds a third of its rms torque ({torque:.3g} {unit}), "
                "so that the joint sticks and friction biases the stiffness. Raise excitation.torque_rms or add "
                "experiment.simulated.carrier"
            )
            notes.append(Note("design/motor-sticks", text, f"motor {joint.name}"))
    return tuple(notes)


def presliding(fitted: Sequence[Measurement], robot: Robot) -> tuple[Note, ...]:
    """A note for each motor that is expected to reverse within 0.2 to 4 presliding distances, where friction deflects.

    The presliding distance is F_c / sigma_0 of the friction model of the motor.
    """
    distances = {
        law.place: float(law.curve()[0]) / law.at_rest()[0]
        for law in frictions(robot)
        if law.spec.lugre is not None or law.spec.maxwell_slip is not None
    }
    of_plan = np.median([prospect.reversal_distances(c, prospect.parameters.x) for prospect, c in fitted], axis=0)
    notes = []
    for place, motion in zip(robot.motor_locations, of_plan.tolist(), strict=True):
        ratio = motion / distances.get(place, math.nan)
        if AMPLITUDES[0] < ratio < AMPLITUDES[1]:
            text = (
                f"the distance between two reversals is {ratio:.2g} times the presliding distance (limit "
                f"{AMPLITUDES[1]:g} times). Friction acts partly as a spring, and the stiffness is less certain than "
                f"forecast. Raise excitation.torque_rms by a factor of {AMPLITUDES[1] / ratio:.2g}, or lower "
                "excitation.band_hz"
            )
            notes.append(Note("design/presliding", text, place))
    return tuple(notes)


@dataclass(frozen=True)
class Design:
    """A plan within the robot's limits, its forecast, and its use of the limits."""

    plan: Plan
    forecast: Forecast
    limit_use: LimitUse


def design(problem: DesignProblem, execution: Execution | None = None) -> Design:
    """Choose configurations, plan, keep within limits, forecast.

    Raises StudyError for a problem without a solution, with what is in the way.
    """
    execution = execution or Execution()
    excitation, experiment = problem.excitation, problem.experiment
    settled = completed_problem(problem)
    chosen, choice = ((), "") if problem.design is None else _choose(settled, problem.design, execution)
    spectra = best_spectra_of(settled, experiment, chosen, excitation.torque_rms)
    # Plan and rehearsal take the problem as it was given: the rehearsal has Coulomb friction itself.
    plan = problem.plan(experiment, chosen, spectra)
    check_line_count(plan.freq_hz, settled.parameters)
    plan, limit_use = within_limits(problem.rig(plan), excitation, execution)
    parameters = with_tolerances(settled.parameters, settled.robot, settled.fit)
    fitted, truth = settled.fitted(plan), true_robot(problem.robot, problem.simulated.truth)
    responses = [replace(model, parameters=parameters).expected(c, parameters.x) for model, c in fitted]
    is_compensated = not settled.includes_friction and bool(coulomb_torques(settled.robot).any())
    expected = forecast(responses, parameters.x, is_compensated)
    notes = (*sticking(plan, truth, problem.simulated.carrier), *presliding(fitted, truth), *expected.notes)
    expected = replace(expected, notes=notes, choice=choice)
    return Design(plan, expected, limit_use)


def completed_problem(problem: DesignProblem) -> DesignProblem:
    """Problem with defaults for open settings: torques, typical spectrum, damping by friction."""
    return with_friction_damping(with_typical_spectrum(with_torques(problem), problem.excitation.torque_rms))


def with_friction_damping(problem: DesignProblem) -> DesignProblem:
    """The problem of a robot whose viscous friction includes the damping by Coulomb friction under this excitation.

    Averaged over the configurations given and some candidates; repeated, since damping reduces the motion.
    """
    damped = problem
    probe = problem.probe(problem.experiment)
    before = np.zeros(len(problem.robot.driven))
    for _ in range(20):
        damping = partial(_equivalent_damping, damped, probe)
        d = np.mean(damped.at_equilibria(probe, damping, problem.experiment.configurations), axis=0)
        if np.all(np.abs(d - before) <= 0.01 * d):
            break
        damped, before = _with_damping(problem, d), d
    return damped


def _equivalent_damping(problem: DesignProblem, probe: Plan, q: int, configuration: Configuration) -> FloatArray:
    return problem.prospect(probe, q).equivalent_damping(configuration, problem.parameters.x)


def _with_damping(problem: DesignProblem, d: FloatArray) -> DesignProblem:
    """Problem with d (n_u,) in Nms/rad more viscous friction in the motors, link side."""
    values = {}
    for joint, more in zip(problem.robot.driven, d, strict=True):
        if joint.motor is not None:
            values[f"fm_{joint.name}"] = joint.motor.viscous + float(more) / joint.motor.ratio**2
    unknown = {name: value for name, value in values.items() if name not in dict(problem.fitted_values)}
    return replace(
        problem, robot=problem.robot.with_parameters(values), fitted_values=(*problem.fitted_values, *unknown.items())
    )


def _choose(
    problem: DesignProblem, spec: DesignSpec, execution: Execution
) -> tuple[tuple[DesignedConfiguration, ...], str]:
    candidates = problem.candidates(spec)
    sections = problem.excitation, problem.experiment, len(problem.robot.driven)
    count = n_free_configurations(spec, *sections)
    if count < 1:
        raise StudyError(
            "design/limits",
            "the robot time is too short for a configuration in addition to the "
            f"{len(problem.experiment.configurations)} given; one needs "
            f"{unit_time_s(*sections, problem.experiment.periods):g} s. Give more, or fewer realisations or periods",
            "design.robot_time",
        )
    criterion, n = problem.criterion, len(candidates.configurations)
    if spec.count is not None and n < spec.count:
        raise StudyError(
            "design/candidates",
            f"design.count: {spec.count} configurations for {n} admissible candidates"
            + (f" ({candidates.reasons})" if candidates.refused else "")
            + f"; lower count to {n}, give more candidates, or more realisations of each",
        )
    given = tuple(problem.experiment.configurations)
    prospect, prior = _prospect(problem)
    return choose_configurations(criterion, prospect, count, prior, candidates.configurations, given, execution)


def _prospect(problem: DesignProblem) -> tuple[Prospect, FloatArray]:
    """The prospect of a candidate, and the information (n_x, n_x) of the configurations given."""
    probe = problem.probe(problem.experiment)
    check_line_count(probe.freq_hz, problem.parameters)
    prior = problem.prior_information()
    for q, configuration in enumerate(probe.configurations):
        if configuration.name in set(problem.experiment.configurations) - set(problem.excluded_configurations):
            prior = prior + problem.prospect(probe, q).information(configuration, problem.parameters.x)
    return problem.prospect(probe, -1), prior
