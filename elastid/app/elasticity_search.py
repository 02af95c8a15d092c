"""compare --search: where the elasticity of a study's robot sits, step by step; file -> value -> file.

It searches among all that `robot.variants` finds elastic: gears, joints without a motor, rods. The models that it meets
are ranked as those of any comparison, in the same compare.json; an interrupted search finds its finished fits again and
goes the same way.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

from elastid.app.compare import finish, refitted, variant
from elastid.app.run import Run
from elastid.base.errors import StudyError
from elastid.base.numbers import number
from elastid.model.parallel_linkage.approximations import unseen
from elastid.response import FrequencyResponse
from elastid.robot.simplified import elastic_coordinates
from elastid.store import read_responses
from elastid.study import LoadedStudy, Study
from elastid.validation.compare import ComparedVariant, rank
from elastid.validation.comparison import ComparedModel, Elastic, Refit, Trial
from elastid.validation.elasticity_search import describe_search, search
from elastid.validation.spec import VariantSpec


def search_elasticity(run: Run) -> None:
    """compare.json with every trial and the models met, and the report anew where there is one.

    StudyError where there are no current responses, those of one configuration only, or nothing to search among.
    """
    run.require("fit")  # reads what a search reads
    with run.logged():
        coordinates, start = _coordinates(run.loaded)
        responses = read_responses(run.path("estimate"))
        names = [response.configuration.name for response in responses]
        if len(names) < 2:
            raise StudyError(
                f"{run.loaded.path}: the search judges by configurations that were left out, and there is one only; "
                "measure in further ones"
            )
        met: dict[Elastic, tuple[ComparedVariant, Sequence[Refit]]] = {}

        def fitted(models: Sequence[Elastic]) -> Mapping[Elastic, ComparedModel]:
            # The study's own model is fitted first: all others are part of it, and its fit scales QAIC.
            new = [model for model in dict.fromkeys((everything, *models)) if model not in met]
            met.update(_fitted(run, coordinates, start, new, responses))
            rows = rank(names, *zip(*met.values(), strict=True)).rows
            by_name = {row.name: row for row in rows}
            return {model: by_name[of.name] for model, (of, _) in met.items()}

        everything, trials = tuple(coordinates), []
        for trial in search(everything, fitted, start):
            trials.append(trial)
            if trial.taken:
                run.console.say(f"search: step {trial.step}: {_move(trial)}: {_errors(trial)}")
        comparison = rank(names, *zip(*met.values(), strict=True))
        verdict = f"{describe_search(everything, trials, start)} {comparison.verdict}"
        run.console.table(trial_table(trials))
        finish(run, replace(comparison, verdict=verdict, trials=tuple(trials)))


def trial_table(trials: Sequence[Trial]) -> list[list[str]]:
    """Headings, then a line for each trial in the order of the search."""
    rows = [["step", "trial", "parameters", "left out: error / sigma", "change of misfit", "change of QAIC", ""]]
    for trial in trials:
        change = "{} ± {}".format(*(number(v, 2) for v in (trial.change, trial.standard_error)))
        line = [str(trial.step), _move(trial), str(trial.n_free), _errors(trial), change, number(trial.criterion, 4)]
        rows.append([*line, "taken" if trial.taken else ""])
    return rows


def _coordinates(loaded: LoadedStudy) -> tuple[dict[str, str], Elastic]:
    """What can be elastic or rigid, label to name, and the labels of what is elastic to begin with: the gears."""
    robot, unknown = loaded.study.as_robot(), unseen(loaded.study.as_robot(), loaded.study.model.variant)
    coordinates = [each for each in elastic_coordinates(robot) if f"k_{each.name}" not in unknown]
    if not coordinates:
        raise StudyError(
            f"{loaded.path}: nothing of robot {robot.name} is elastic, so there is nothing to search among; give "
            "springs to gears, to joints without a motor, and stiffness to rods wherever it may be elastic"
        )
    start = tuple(each.label for each in coordinates if each.kind == "gear")
    return {each.label: each.name for each in coordinates}, start


def _fitted(
    run: Run,
    coordinates: Mapping[str, str],
    start: Elastic,
    models: Sequence[Elastic],
    responses: Sequence[FrequencyResponse],
) -> Mapping[Elastic, tuple[ComparedVariant, Sequence[Refit]]]:
    """The models and their fits; one that leaves nothing to identify has none, with the reason for a message."""
    made: dict[Elastic, ComparedVariant] = {}
    cannot: dict[Elastic, tuple[ComparedVariant, Sequence[Refit]]] = {}
    for model in models:
        name, rigid = _name(run.study, coordinates, start, model), [c for c in coordinates if c not in model]
        try:
            made[model] = variant(run.loaded, VariantSpec(name, rigid=tuple(coordinates[label] for label in rigid)))
        except StudyError as error:
            if model in (start, tuple(coordinates)):
                raise StudyError(f"search: {name}: {error}") from None
            own = ComparedVariant(name, run.study.as_robot(), run.study.fit, run.study.model)
            cannot[model] = own, 2 * [Refit("failed", str(error), 0, math.inf, 0, {})]
    fits = refitted(run, list(made.values()), responses)
    return dict(zip(made, zip(made.values(), fits, strict=True), strict=True)) | cannot


def _name(study: Study, coordinates: Mapping[str, str], start: Elastic, model: Elastic) -> str:
    """What is elastic in a model beyond the gears, and which gears are not."""
    if len(model) == len(coordinates):
        return study.name
    further, rigid = [c for c in model if c not in start], [c for c in start if c not in model]
    words = [f"{', '.join(further)} elastic"] if further else ["driven joints alone"]
    return ", ".join([*words, *([f"{', '.join(rigid)} rigid"] if rigid else [])])


def _move(trial: Trial) -> str:
    return f"{', '.join(trial.coordinates)} {trial.becomes}"


def _errors(trial: Trial) -> str:
    return " → ".join(number(math.sqrt(misfit), 3) for misfit in (trial.before, trial.after))
