"""validate: responses, records and a fit -> validation.h5 and validation.json."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial

from elastid.app.dry_friction import shaft_couplings
from elastid.app.run import Run
from elastid.app.summaries import validation_summary, write_summary
from elastid.app.twin_runs import runs_of_fit
from elastid.base.errors import StudyError
from elastid.base.execution import Execution, in_order
from elastid.fit.fitted_robot import FittedRobot
from elastid.frf.friction.net_torque import net_records
from elastid.response import FrequencyResponse
from elastid.store import (
    read_configurations,
    read_fit,
    read_friction,
    read_records,
    read_responses,
    read_stamp,
    write_validation,
)
from elastid.validation.agreement import validate as validate_responses
from elastid.validation.compare import ComparedVariant, RefitTask, refit
from elastid.validation.cost import cost_p, explain_cost
from elastid.validation.cross_validation import describe_folds, divide, gather_folds
from elastid.validation.elastic_twin import elastic_balances, model_parts, rigid_linearisation
from elastid.validation.replay import describe_replays, replay
from elastid.validation.results import Fold, Replay, Validation
from elastid.validation.twin import TorqueBalance, describe_balance
from elastid.validation.twin_run import TwinFindings


def validate(run: Run) -> None:
    """validation.h5 and validation.json: how far the fitted model carries, on left-out configurations if any."""
    unfinished = run.resumed("validate")
    with run.execution("validate", unfinished) as execution:
        validation = _validation(run, execution)
    measured = "measure" in run.stages and _is_as_measured(run)
    balances = tuple(_balances(run)) if measured else ()
    twin = TwinFindings(balances, runs_of_fit(run) if measured else ())
    write_summary(run.summary("validate"), validation_summary(run.study, validation, twin))
    write_validation(run.path("validate"), validation, run.stamps["validate"], twin)
    unfinished.clear()
    for words in (validation.verdict, validation.folded, validation.cost, validation.replayed):
        if words:
            run.console.say(f"validate: {words}")
    if balances:
        worst = max(balances, key=lambda balance: balance.left)
        run.console.say(f"validate: {describe_balance(worst)}")
    for words in twin.run_words:
        run.console.say(f"validate: {words}")


def _validation(run: Run, execution: Execution) -> Validation:
    """How far the fitted model carries, why its cost is what it is, and the records replayed through it."""
    study, left_out = run.study, run.study.validation.left_out
    responses, result = read_responses(run.path("estimate")), read_fit(run.path("fit"))
    fitted = FittedRobot.of(result, study.as_robot(), responses, study.model)
    modelled = fitted.responses
    measured = [response.configuration.name for response in responses]
    shifts = {name: fitted.response_shifts(name) for name in left_out if name in measured}
    judged = validate_responses(responses, modelled, left_out, cost_p(result), shifts)
    seen = [(Ghat, G) for Ghat, G in zip(responses, modelled, strict=True) if Ghat.configuration.name not in left_out]
    replays = tuple(_replays(run, fitted, execution))
    folds = _folds(run, [Ghat for Ghat, _ in seen], execution)
    return replace(
        judged,
        cost=explain_cost(result, [Ghat for Ghat, _ in seen], [G for _, G in seen], judged.fitted, study.fit),
        replays=replays,
        replayed=describe_replays(replays) if replays else "",
        folds=folds,
        folded=describe_folds(folds, judged.fitted) if folds else "",
    )


def _folds(run: Run, responses: Sequence[FrequencyResponse], execution: Execution) -> tuple[Fold, ...]:
    """The fit again without each part of the configurations; none where the study asks for none."""
    study = run.study
    parts = divide([r.configuration.name for r in responses], study.validation.folds) if study.validation.folds else ()
    if not parts:
        return ()
    own = ComparedVariant(study.name, study.as_robot(), study.seeded_fit, study.model)
    tasks = [RefitTask(own, part) for part in parts]
    names = [f"refit-{i}" for i in range(len(tasks))]
    return gather_folds(parts, in_order(execution.resumed(partial(refit, responses), tasks, names)))


def _replays(run: Run, fitted: FittedRobot, execution: Execution) -> Iterator[Replay]:
    """One record in memory at a time; none where responses came from elsewhere or the records are gone."""
    if "measure" not in run.stages:
        return
    path = run.path("measure")
    if not _is_as_measured(run):
        run.console.say(f"validate: {path} is not there as it was measured; nothing is replayed in time")
        return
    names = read_configurations(path)
    friction = read_friction(run.path("estimate"))
    todo = [response for response in fitted.measured if response.configuration.name in names]
    for done, response in enumerate(todo):
        execution.progress(done, len(todo))
        name = response.configuration.name
        band_hz = (float(response.freq_hz[0]), float(response.freq_hz[-1]))
        records = net_records(read_records(path, name), friction, shaft_couplings(run.study))
        yield replay(records, fitted.at(name), fitted.theta_of(name), band_hz, run.study.estimator)


def _balances(run: Run) -> Iterator[TorqueBalance]:
    """The torque of each motor in the first record of each configuration, part by part."""
    study = run.study
    fitted = FittedRobot.of(
        read_fit(run.path("fit")), study.as_robot(), read_responses(run.path("estimate")), study.model
    )
    path, friction, E = run.path("measure"), read_friction(run.path("estimate")), shaft_couplings(study)
    try:
        rigid = rigid_linearisation(fitted, study.model)
    except StudyError as error:
        run.console.say(f"validate: the torque is not divided into parts: {error}")
        return
    names = read_configurations(path)
    for response in fitted.measured:
        name = response.configuration.name
        parts = model_parts(fitted, rigid, name) if name in names else None
        if parts is not None:
            record = next(iter(read_records(path, name)))
            net = next(net_records([record], friction, E))
            yield from elastic_balances(record, net, parts, response.freq_hz, study.estimator)


def _is_as_measured(run: Run) -> bool:
    """Whether the records are those of this study."""
    found = read_stamp(run.path("measure"))
    return found is not None and found.inputs == run.stamps["measure"].inputs
