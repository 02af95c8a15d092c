"""Design of an experiment: selection of configurations, a plan within the robot's limits, and its forecast."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from elastid.base.arrays import FloatArray, values_by_name
from elastid.base.errors import Note, StudyError
from elastid.base.execution import Execution
from elastid.design.configuration_selection import choose_configurations
from elastid.design.forecast import COULOMB_RATIO, Forecast, check_line_count, forecast
from elastid.design.limit_use import LimitUse
from elastid.design.limits import within_limits
from elastid.design.predicted_response import ExpectedResponse
from elastid.design.problem import DesignProblem, Measurement, best_spectra_of, with_torques, with_typical_spectrum
from elastid.design.spec import DesignSpec, unit_time_s
from elastid.experiment.plan.plan import DesignedConfiguration, Plan
from elastid.experiment.simulated.plant import true_robot
from elastid.experiment.specs.simulated import CarrierSpec
from elastid.fit.parameter_selection import local_ratio_std, with_ratio_std, with_tolerances
from elastid.fit.presliding import with_relaxing_springs
from elastid.fit.result_rows import Presliding
from elastid.friction.robot_friction import coulomb_torques, frictions
from elastid.linear.presliding import AMPLITUDES
from elastid.record import Configuration, drive_unit
from elastid.robot import Robot


def sticking_notes(plan: Plan, robot: Robot, carrier: CarrierSpec | None) -> tuple[Note, ...]:
    """Return a note for each motor whose Coulomb friction exceeds a third of its rms torque (Nm, link side).

    With a carrier (superimposed slow motion) the joints always slide, and there is no note.
    """
    if carrier is not None:
        return ()
    # Friction acts on shafts, which gears may couple.
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


def presliding(measurements: Sequence[Measurement], robot: Robot) -> tuple[Presliding, ...]:
    """Return the presliding friction of motors with 0.2 to 4 presliding distances between two expected reversals.

    The presliding distance is F_c / sigma_0 of the motor's friction model; the rate is E|w| over this distance.
    """
    distance, speed, _ = np.median([model.reversals(c, model.parameters.x) for model, c in measurements], axis=0)
    laws = {law.place: law for law in frictions(robot) if law.spec.lugre or law.spec.maxwell_slip}
    rows = []
    for i, joint in enumerate(robot.driven):
        if (law := laws.get(location := robot.motor_locations[i])) is None:
            continue
        stiffness, unit = law.at_rest()[0], "N/m" if joint.slides else "N*m/rad"
        scale = float(law.curve()[0]) / stiffness
        if AMPLITUDES[0] < distance[i] / scale < AMPLITUDES[1]:
            rows.append(Presliding(location, unit, stiffness, 0.0, speed[i] / scale, 0.0, distance[i] / scale))
    return tuple(rows)


def _presliding_note(friction: Presliding) -> Note:
    text = (
        f"the motor moves {friction.amplitude:.2g} presliding distances between two reversals (limit "
        f"{AMPLITUDES[1]:g}). The forecast includes the stiffness of the friction. Raise "
        f"excitation.torque_rms by a factor of {AMPLITUDES[1] / friction.amplitude:.2g}, or lower excitation.band_hz"
    )
    return Note("design/presliding", text, friction.place)


@dataclass(frozen=True)
class Design:
    """Plan within the robot's limits, its forecast, and its use of the limits."""

    plan: Plan
    forecast: Forecast
    limit_use: LimitUse


def design(problem: DesignProblem, execution: Execution | None = None) -> Design:
    """Select configurations, plan, scale to the limits, and forecast; StudyError for a problem without a solution."""
    execution = execution or Execution()
    excitation, experiment = problem.excitation, problem.experiment
    completed = completed_problem(problem)
    selection, choice = ((), "") if problem.design is None else _choose(completed, problem.design, execution)
    # Plan and simulation use the given problem, because the simulation has Coulomb friction itself.
    plan = problem.plan(experiment, selection, best_spectra_of(completed, experiment, selection, excitation.torque_rms))
    check_line_count(plan.freq_hz, completed.parameters)
    plan, limit_use = within_limits(problem.rig(plan), excitation, execution)
    measurements, truth = completed.fit_measurements(plan), true_robot(problem.robot, problem.simulated.truth)
    friction = presliding(measurements, truth)
    responses = _expected_responses(completed, measurements, friction)
    is_compensated = not completed.includes_friction and bool(coulomb_torques(completed.robot).any())
    expected = forecast(responses, responses[0].parameters.x, is_compensated)
    notes = (*sticking_notes(plan, truth, problem.simulated.carrier), *map(_presliding_note, friction), *expected.notes)
    expected = replace(expected, notes=notes, choice=choice)
    return Design(plan, expected, limit_use)


def _expected_responses(
    problem: DesignProblem, measurements: Sequence[Measurement], friction: Sequence[Presliding]
) -> list[ExpectedResponse]:
    """Return expected responses with the tolerances of the robot model, and with presliding friction."""
    robot, freq_hz = problem.robot, measurements[0][0].plan.freq_hz
    springs = {row.spring: (row.stiffness, row.rate) for row in friction}
    tolerant = with_tolerances(problem.parameters, robot, problem.fit)
    parameters = with_relaxing_springs(tolerant, springs, (2 * np.pi * freq_hz[0], 2 * np.pi * freq_hz[-1]))
    responses = []
    for prospect, configuration in measurements:
        _, _, travel = prospect.reversals(configuration, problem.parameters.x)
        model = replace(prospect, parameters=parameters, presliding=tuple(springs))
        expected = model.expected(configuration, parameters.x)
        std = local_ratio_std(robot, values_by_name(robot.motor_locations, travel))
        responses.append(replace(expected, response=with_ratio_std(replace(expected.response, ratio_std=std), robot)))
    return responses


def completed_problem(problem: DesignProblem) -> DesignProblem:
    """Return the problem with defaults for open settings: torques, typical spectrum, damping by friction."""
    return with_friction_damping(with_typical_spectrum(with_torques(problem), problem.excitation.torque_rms))


def with_friction_damping(problem: DesignProblem) -> DesignProblem:
    """Add the equivalent damping of Coulomb friction under this excitation to the viscous friction of the robot.

    It is the mean over the given configurations and some candidates, iterated because damping reduces the motion.
    """
    with_damping = problem
    probe = problem.probe(problem.experiment)
    previous = np.zeros(problem.robot.n_u)

    def damping(q: int, configuration: Configuration) -> FloatArray:
        return with_damping.prospect(probe, q).equivalent_damping(configuration, with_damping.parameters.x)

    for _ in range(20):
        d = np.mean(with_damping.at_equilibria(probe, damping, problem.experiment.configurations), axis=0)
        if np.all(np.abs(d - previous) <= 0.01 * d):
            break
        with_damping, previous = _with_damping(problem, d), d
    return with_damping


def _with_damping(problem: DesignProblem, d: FloatArray) -> DesignProblem:
    """Return the problem with viscous friction of the motors that is larger by d (n_u,), Nms/rad, link side."""
    pairs = [(joint.name, joint.motor, d_i) for joint, d_i in zip(problem.robot.driven, d.tolist(), strict=True)]
    values = {f"fm_{name}": motor.viscous + d_i / motor.ratio**2 for name, motor, d_i in pairs if motor is not None}
    unknown = {name: value for name, value in values.items() if name not in dict(problem.fitted_values)}
    return replace(
        problem, robot=problem.robot.with_parameters(values), fitted_values=(*problem.fitted_values, *unknown.items())
    )


def _choose(
    problem: DesignProblem, spec: DesignSpec, execution: Execution
) -> tuple[tuple[DesignedConfiguration, ...], str]:
    """Select configurations among the candidates of a `design` section; return them and a sentence."""
    candidates = problem.candidates(spec)
    experiment, names = problem.experiment, tuple(problem.experiment.configurations)
    time_s = unit_time_s(problem.excitation, experiment, problem.robot.n_u, experiment.periods)
    count = spec.count or 0
    if spec.robot_time is not None:
        count = int(spec.robot_time / time_s + 1e-9) - len(names)
    if count < 1:
        raise StudyError(
            "design/limits",
            f"the robot time is too short for a configuration in addition to the {len(names)} given; one needs "
            f"{time_s:g} s. Give more, or fewer realisations or periods",
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
    probe = problem.probe(experiment)
    check_line_count(probe.freq_hz, problem.parameters)
    prior = problem.prior_information()
    for q, configuration in enumerate(probe.configurations):
        if configuration.name in set(names) - set(problem.excluded_configurations):
            prior = prior + problem.prospect(probe, q).information(configuration, problem.parameters.x)
    prospect = problem.prospect(probe, -1)
    return choose_configurations(criterion, prospect, count, prior, candidates.configurations, names, execution)
