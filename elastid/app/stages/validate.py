"""validate: responses, records and a fit -> validation.h5 and validation.json."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

from elastid.app.records_in_time import InTime, records_in_time
from elastid.app.run import Run
from elastid.app.summaries import validation_summary, write_summary
from elastid.app.twin_runs import runs_of_fit
from elastid.base.execution import Execution, in_order
from elastid.fit.fitted_robot import FittedRobot
from elastid.response import FrequencyResponse
from elastid.store import read_fit, read_responses, read_stamp, write_validation
from elastid.validation.agreement import validate as validate_responses
from elastid.validation.compare import ComparedVariant, RefitTask, refit
from elastid.validation.cost import cost_p, explain_cost
from elastid.validation.cross_validation import describe_folds, divide, gather_folds
from elastid.validation.replay import describe_replays
from elastid.validation.results import Fold, Validation
from elastid.validation.twin import describe_balance
from elastid.validation.twin_run import TwinFindings


def validate(run: Run) -> None:
    """validation.h5 and validation.json: how far the fitted model carries, on left-out configurations if any."""
    unfinished = run.resumed("validate")
    with run.execution("validate", unfinished) as execution:
        validation, in_time = _validation(run, execution)
        runs = runs_of_fit(run, execution) if in_time is not None else ()
    balances = tuple(balance for each in in_time or () for balance in each.balances)
    twin = TwinFindings(balances, runs)
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


def _validation(run: Run, execution: Execution) -> tuple[Validation, list[InTime] | None]:
    """How far the fitted model carries, why its cost is what it is, and the records through it, None without them."""
    study, left_out = run.study, run.study.validation.left_out
    responses, result = read_responses(run.path("estimate")), read_fit(run.path("fit"))
    fitted = FittedRobot.of(result, study.as_robot(), responses, study.model)
    modelled = fitted.responses
    measured = [response.configuration.name for response in responses]
    shifts = {name: fitted.response_shifts(name) for name in left_out if name in measured}
    judged = validate_responses(responses, modelled, left_out, cost_p(result), shifts)
    seen = [(Ghat, G) for Ghat, G in zip(responses, modelled, strict=True) if Ghat.configuration.name not in left_out]
    in_time = records_in_time(run, fitted, execution) if _has_records(run) else None
    replays = tuple(each.replayed for each in in_time or ())
    folds = _folds(run, [Ghat for Ghat, _ in seen], execution)
    validation = replace(
        judged,
        cost=explain_cost(result, [Ghat for Ghat, _ in seen], [G for _, G in seen], judged.fitted, study.fit),
        replays=replays,
        replayed=describe_replays(replays) if replays else "",
        folds=folds,
        folded=describe_folds(folds, judged.fitted) if folds else "",
    )
    return validation, in_time


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


def _has_records(run: Run) -> bool:
    """Whether the records are there and are those of this study; responses from elsewhere have none."""
    if "measure" not in run.stages:
        return False
    path = run.path("measure")
    found = read_stamp(path)
    if found is not None and found.inputs == run.stamps["measure"].inputs:
        return True
    run.console.say(f"validate: {path} is not there as it was measured; nothing is replayed in time")
    return False
