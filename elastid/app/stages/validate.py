"""Stage validate: responses, records and a fit -> validation.h5 and validation.json."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain
from pathlib import Path

from elastid.app.console import Console
from elastid.app.identified_robot import with_identified_effects
from elastid.app.run import Artefacts, Work, Write
from elastid.app.stages.estimate import tool_responses
from elastid.app.summaries import as_json, validation_summary
from elastid.base.arrays import FloatArray
from elastid.base.errors import StudyError
from elastid.base.execution import Execution
from elastid.fit.fitted_robot import FittedRobot, robots_by_group
from elastid.frf.spec import EstimatorSpec
from elastid.nonlinear.compensate_friction import compensated_records, shaft_couplings
from elastid.nonlinear.compensated_friction import CompensatedFriction
from elastid.nonlinear.gear_result import GearResult, with_gears
from elastid.parameters import DELAY
from elastid.response import Response
from elastid.store.measured import read_configurations, read_friction, read_records, read_responses
from elastid.store.results import read_fit, read_gears, read_modelled, write_validation
from elastid.study import Study
from elastid.validation.frf_error import Validation, predict_response
from elastid.validation.frf_error import validate as validate_responses
from elastid.validation.log_comparison import NO_COMPARISON, LogComparison, LogSimulation, TorqueBalance
from elastid.validation.measured_modes import measured_modes
from elastid.validation.simulation import simulate_record
from elastid.validation.torque_balance import MotorModel, elastic_balances, model_parts, rigid_linearisation


@dataclass(frozen=True)
class ValidationBasis:
    """Study, fitted robot and friction; gears: used in the simulation only."""

    study: Study
    fitted: FittedRobot
    friction: CompensatedFriction | None
    gears: GearResult | None = None


def validate(study: Study, work: Work) -> Artefacts:
    """Validate the fit: validation.h5 and validation.json with errors of FRFs and, if records exist, simulations."""
    responses, result = read_responses(work.sources["estimate"]), read_fit(work.sources["fit"])
    fitted = FittedRobot.of(result, study.as_robot(), responses, study.model)
    gears = read_gears(work.sources.get("gears"))
    fitted = replace(fitted, modelled=read_modelled(work.sources["fit"]))
    basis = ValidationBasis(study, fitted, read_friction(work.sources["estimate"]), gears)
    records = work.sources.get("measure")
    if records is None and study.experiment.responses is None:
        work.console.say("validate: no simulation in time, because records.h5 is missing or outdated")
    validation_names = study.validation.configurations
    with work.execution() as execution:
        validation, comparison = validate_model(basis, validation_names, records, work.console, execution)
    has_tool = result.tool is not None and not result.tool.disagrees
    predictions = [predict_response(result, G) for G in tool_responses(study.validation.tool, study, work.base)]
    predictions += [
        predict_response(result, G, is_fitted=has_tool and G.configuration.name not in validation_names)
        for G in tool_responses(study.tool, study, work.base)
    ]
    verdict = validation.verdict
    if result.required_value:  # differs from the nominal value
        verdict = verdict.replace(". The model", f" with {result.required_value}. The model", 1)
    validation = replace(validation, predictions=tuple(predictions), verdict=verdict)

    def report(console: Console) -> None:
        verdict = validation.verdict.removeprefix("Validation ")
        console.say(f"validate: {verdict[:1].lower()}{verdict[1:]}")
        for prediction in validation.predictions:
            console.say(f"validate: {'fitted' if prediction.is_fitted else 'predicted'}: {prediction.sentence}")
        worst = sorted(comparison.balances, key=lambda balance: balance.unexplained_fraction)[-1:]
        for sentence in replace(comparison, balances=tuple(worst)).sentences:
            console.detail(f"validate: {sentence}")

    files: dict[str, Write] = {
        "validation.json": as_json(validation_summary(study.name, validation, comparison)),
        "validation.h5": lambda p, stamp: write_validation(p, validation, stamp, comparison, measured_modes(fitted)),
    }
    return Artefacts(files, report)


def validate_model(
    basis: ValidationBasis, validation_names: Sequence[str], records: Path | None, console: Console,
    execution: Execution,
) -> tuple[Validation, LogComparison]:  # fmt: skip
    """Compute the errors of all responses and, for records with torques, the torque balance and a simulation."""
    log_comparison, fitted = NO_COMPARISON, basis.fitted
    if records is not None and all(response.controller is None for response in fitted.measured):
        log_comparison = LogComparison(_balances(basis, records, console, execution), _simulations(basis, records))
    shifts = {
        name: fitted.at(name).response_shifts(G.freq_hz)
        for G in fitted.measured
        if (name := G.configuration.name) in validation_names
    }
    return validate_responses(fitted.measured, fitted.responses, validation_names, shifts), log_comparison


def _balances(basis: ValidationBasis, path: Path, console: Console, execution: Execution) -> tuple[TorqueBalance, ...]:
    """Compute the torque balance of each motor in the first record of each configuration, if the robot can be rigid."""
    fitted, names, E = basis.fitted, read_configurations(path), shaft_couplings(basis.study.robot)
    try:
        rigid = rigid_linearisation(fitted, basis.study.model)
    except StudyError as error:
        console.say(f"validate: no torque balance: {error}")
        return ()
    responses = [response for response in fitted.measured if response.configuration.name in names]
    pairs = ((model_parts(fitted, rigid, response.configuration.name), response) for response in responses)
    models = [(parts, response) for parts, response in pairs if parts is not None]
    balances = execution.ordered(partial(_balance_of_record, path, basis.friction, E, basis.study.estimator), models)
    return tuple(chain.from_iterable(balances))


def _balance_of_record(
    path: Path, friction: CompensatedFriction | None, E: FloatArray | None, spec: EstimatorSpec,
    model: tuple[Sequence[MotorModel], Response]
) -> tuple[TorqueBalance, ...]:  # fmt: skip
    parts, response = model
    first = next(read_records(path, response.configuration.name))
    return elastic_balances(first, next(compensated_records([first], friction, E)), parts, response.freq_hz, spec)


def _simulations(basis: ValidationBasis, path: Path) -> tuple[LogSimulation, ...]:
    """Simulate along the first record of the first validation configuration, or else of the first configuration."""
    names = read_configurations(path)
    name_of_posture = next((name for name in basis.study.validation.configurations if name in names), names[0])
    result = with_gears(basis.fitted.result, basis.gears)
    responses = [response for response in basis.fitted.measured if response.configuration.name == name_of_posture]
    if not responses:
        return ()
    ((robot, _),) = robots_by_group(result, basis.study.as_robot(), [name_of_posture]).values()
    plant = with_identified_effects(robot, basis.friction, basis.gears)
    record = next(iter(read_records(path, name_of_posture)))
    band_hz = float(responses[0].freq_hz[0]), float(responses[0].freq_hz[-1])
    delay_s = result.parameters.numbers(result.x, name_of_posture).get(DELAY, 0.0)
    return simulate_record(record, plant, band_hz, delay_s, basis.study.model)
