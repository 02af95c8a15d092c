"""What the stage `validate` does: responses, records and a fit -> Validation."""

from __future__ import annotations

from collections.abc import Iterator, MutableMapping, Sequence
from dataclasses import replace
from functools import partial

from elastid.app.run import Run
from elastid.base.execution import Progress, in_order, resumed
from elastid.fit.fitted_model import FittedModel
from elastid.fit.result import FitResult
from elastid.response import FrequencyResponse
from elastid.store import read_configurations, read_records, read_stamp
from elastid.validation.agreement import validate
from elastid.validation.compare import RefitTask, Variant, refit
from elastid.validation.cost import explain_cost
from elastid.validation.cross_validation import describe_folds, divide, gather_folds
from elastid.validation.replay import describe_replays, replay
from elastid.validation.results import Fold, Refit, Replay, Validation


def validated(
    run: Run,
    responses: Sequence[FrequencyResponse],
    result: FitResult,
    finished: MutableMapping[str, Refit],
    progress: Progress,
) -> Validation:
    """How far the fitted model carries, why its cost is what it is, and the records replayed through it.

    finished: the fits of an earlier validation that was stopped, and where those of this one are kept.
    """
    study, left_out = run.study, run.study.validation.left_out
    fitted = FittedModel.of(result, study.robot, responses, study.model)
    modelled = fitted.responses
    judged = validate(responses, modelled, left_out)
    seen = [(Ghat, G) for Ghat, G in zip(responses, modelled, strict=True) if Ghat.configuration.name not in left_out]
    replays = tuple(_replays(run, fitted, progress))
    left_out_in_turn = _folds(run, [Ghat for Ghat, _ in seen], finished, progress)
    return replace(
        judged,
        cost=explain_cost(result, [Ghat for Ghat, _ in seen], [G for _, G in seen], judged.fitted, study.fit),
        replays=replays,
        replayed=describe_replays(replays) if replays else "",
        folds=left_out_in_turn,
        folded=describe_folds(left_out_in_turn, judged.fitted) if left_out_in_turn else "",
    )


def _folds(
    run: Run, responses: Sequence[FrequencyResponse], finished: MutableMapping[str, Refit], progress: Progress
) -> tuple[Fold, ...]:
    """The fit again without each part of the configurations; none where the study asks for none."""
    study = run.study
    parts = divide([r.configuration.name for r in responses], study.validation.folds) if study.validation.folds else ()
    if not parts:
        return ()
    own = Variant(study.name, study.robot, study.seeded_fit, study.model)
    tasks = [RefitTask(own, part) for part in parts]
    names = [f"refit-{i}" for i in range(len(tasks))]
    return gather_folds(parts, in_order(resumed(partial(refit, responses), tasks, names, finished, run.jobs, progress)))


def _replays(run: Run, fitted: FittedModel, progress: Progress) -> Iterator[Replay]:
    """One record in memory at a time; none where responses came from elsewhere or the records are gone."""
    if "measure" not in run.stages:
        return
    path, stamp = run.path("measure"), run.stamps["measure"]
    found = read_stamp(path)
    if found is None or found.inputs != stamp.inputs:
        run.console.say(f"validate: {path} is not there as it was measured; nothing is replayed in time")
        return
    names = read_configurations(path)
    todo = [response for response in fitted.measured if response.configuration.name in names]
    for done, response in enumerate(todo):
        progress(done, len(todo))
        name = response.configuration.name
        band_hz = (float(response.freq_hz[0]), float(response.freq_hz[-1]))
        yield replay(read_records(path, name), fitted.at(name), fitted.theta_of(name), band_hz, run.study.estimator)
