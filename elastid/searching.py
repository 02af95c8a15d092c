"""compare --search: where the elasticity of a study's robot sits, step by step; file -> value -> file.

The models that the search meets are ranked as those of any comparison, in the same compare.json; an interrupted search
finds its finished fits again and goes the same way.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

from elastid.comparing import finish, refitted, variant
from elastid.errors import StudyError
from elastid.report.numbers import number
from elastid.robot.variants import further_elastic
from elastid.run import Run
from elastid.store import read_responses
from elastid.study import LoadedStudy
from elastid.validation.comparison import Refit, Row, Variant, ranked
from elastid.validation.search import Elastic, Trial, found_words, search
from elastid.validation.spec import VariantSpec


def search_elasticity(run: Run) -> None:
    """compare.json with every trial and the models met, and the report anew where there is one.

    StudyError where there are no current responses, those of one configuration only, or nothing to search among.
    """
    run.require("fit")  # reads what a search reads
    with run.logged():
        coordinates = _coordinates(run.loaded)
        responses = read_responses(run.path("estimate"))
        names = [response.configuration.name for response in responses]
        if len(names) < 2:
            raise StudyError(
                f"{run.loaded.path}: the search judges by configurations that were left out, and there is one only; "
                "measure in further ones"
            )
        met: dict[Elastic, tuple[Variant, Sequence[Refit]]] = {}

        def fitted(models: Sequence[Elastic]) -> Mapping[Elastic, Row]:
            # The study's own model is fitted first: all others are part of it, and its fit scales QAIC.
            new = [model for model in dict.fromkeys((coordinates, *models)) if model not in met]
            made = [_model(run.loaded, coordinates, model) for model in new]
            met.update(zip(new, zip(made, refitted(run, made, responses), strict=True), strict=True))
            rows = ranked(names, *zip(*met.values(), strict=True)).rows
            by_name = {row.name: row for row in rows}
            return {model: by_name[of.name] for model, (of, _) in met.items()}

        trials = []
        for trial in search(coordinates, fitted):
            trials.append(trial)
            if trial.taken:
                run.console.say(f"search: step {trial.step}: {_move(trial)}: {_errors(trial)}")
        comparison = ranked(names, *zip(*met.values(), strict=True))
        verdict = f"{found_words(coordinates, trials)} {comparison.verdict}"
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


def _coordinates(loaded: LoadedStudy) -> Elastic:
    coordinates = further_elastic(loaded.study.robot)
    if not coordinates:
        raise StudyError(
            f"{loaded.path}: every elastic joint of robot {loaded.study.robot.name} is driven, so there is nothing to "
            "search among; give it joints with a spring and no motor wherever it may give way"
        )
    return coordinates


def _model(loaded: LoadedStudy, coordinates: Elastic, elastic: Elastic) -> Variant:
    """The study's model with these of its coordinates elastic."""
    rigid = tuple(name for name in coordinates if name not in elastic)
    name = f"{', '.join(elastic)} elastic" if elastic else "driven joints alone"
    try:
        return variant(loaded, VariantSpec(name if rigid else loaded.study.name, rigid=rigid))
    except StudyError as error:
        raise StudyError(f"search: {name}: {error}") from None


def _move(trial: Trial) -> str:
    return f"{', '.join(trial.coordinates)} {trial.becomes}"


def _errors(trial: Trial) -> str:
    return " → ".join(number(math.sqrt(misfit), 3) for misfit in (trial.before, trial.after))
