"""`elastid compare`: ranking of several models of one robot, fitted to the frequency responses of one run.

The models are listed in a study, or come from a stepwise search (--search) over the elastic gears, joints and rods.
Finished fits are kept in compare.partial, from which an interrupted comparison or search resumes.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import TypeAlias

from elastid.app.run import Run, hash_of, run_stage
from elastid.base.display import number
from elastid.base.errors import StudyError
from elastid.base.execution import Execution
from elastid.base.files import clear_folder, path_below
from elastid.fit.parameter_selection import choose, named_geometry
from elastid.fit.spec import FitSpec
from elastid.model.formulation import elastic_joints_within, inert_parameters
from elastid.response import Responses
from elastid.robot.simplified import elastic_coordinates, with_stiff_joints, without_motor_coupling
from elastid.store.checkpoint import Checkpoint
from elastid.store.files import save_checksums
from elastid.store.measured import read_responses
from elastid.store.results import write_comparison
from elastid.study import LoadedStudy, Study, load
from elastid.validation.comparison import (
    ComparedModel,
    ComparedVariant,
    Comparison,
    Elastic,
    Refit,
    fix,
    rank,
    refit,
    restrict,
    split_folds,
)
from elastid.validation.elastic_search import describe_search, search
from elastid.validation.spec import VariantSpec

RESULT = "compare.json"
PARTIAL = "compare.partial"
_Fits: TypeAlias = dict[Elastic, tuple[ComparedVariant, Sequence[Refit]]]


def compare(run: Run, studies: Sequence[LoadedStudy] = ()) -> Comparison:
    """Rank models, write compare.json and update the report if there is one; return the ranking.

    studies: robots, formulations and parameters of further models, which are fitted to the responses of `run` with its
    weights and criterion.  StudyError without current responses, or for a single model.
    """
    run.require("fit")  # a comparison needs the same files
    with run.open_folder():
        models = list(variants(run.loaded, studies))
        if len(models) < 2:
            text = "nothing to compare: the study has one model without optional parts"
            raise StudyError("compare/variants", text + ". Give compare.variants, or a second study", run.loaded.path)
        responses = read_responses(run.path("estimate"))
        comparison = rank(responses.names, models, refit_all(run, models, responses))
        finish(run, comparison)
    return comparison


def finish(run: Run, comparison: Comparison) -> None:
    """Write a comparison, print its verdict, and update the report if there is one."""
    write_comparison(run.folder / RESULT, comparison, run.stamps["estimate"])
    save_checksums(run.folder, [RESULT])
    clear_folder(run.folder, PARTIAL)
    run.console.table(comparison_table(comparison))
    run.console.say(f"compare: {comparison.verdict}")
    run.console.say(str(run.folder / RESULT))
    if run.path("report").is_file() and all(run.is_current(s) for s in run.stages if s != "report"):
        run_stage(run, "report")


def variants(loaded: LoadedStudy, studies: Sequence[LoadedStudy] = ()) -> Iterator[ComparedVariant]:
    """Yield the model of the study, its variants and models of other studies; raise StudyError for an invalid one."""
    study = loaded.study
    yield ComparedVariant(study.name, study.as_robot(), study.seeded_fit, study.model)
    for spec in study.compare.variants or (() if studies else _default_variants(study)):
        try:
            yield variant(loaded, spec)
        except StudyError as error:
            raise StudyError("compare/variants", f"{spec.name}: {error}", "compare.variants") from None
    for peer in studies:
        name = peer.study.name if peer.study.name != study.name else str(peer.path)
        yield ComparedVariant(name, peer.study.as_robot(), _comparable_fit(study, peer.study), peer.study.model)


def comparison_table(comparison: Comparison) -> list[list[str]]:
    """Return headings, then a row for each model, the best first."""
    has_validation = any(math.isfinite(row.mean_misfit) for row in comparison.rows)
    rows = [["model", "note", "parameters", "QAIC above best", "residuals / noise"]]
    rows[0] += ["left out: error / sigma", "magnitude dB", "phase deg", "misfit above best"] if has_validation else []
    best = comparison.rows[0]
    for row in comparison.rows:
        ratio = math.sqrt(row.cost / row.dof) if row.dof else math.nan
        line = [row.name, row.note, str(row.n_free), number(row.criterion, 4), number(ratio, 3)]
        if has_validation:
            line += [number(v, 3) for v in (math.sqrt(row.mean_misfit), row.rms_log_db, row.phase_rms_deg)]
            line.append("–" if row is best else "{} ± {}".format(*(number(v, 2) for v in row.behind(best))))
        rows.append(line)
    return rows


def _default_variants(study: Study) -> tuple[VariantSpec, ...]:
    """List the default models: the robot without one of its elements, or with other equations of its loops."""
    robot = study.as_robot()
    has_coupling = any(joint.motor is not None and joint.motor.on for joint in robot.driven)
    coupling = [VariantSpec("without motor coupling", motor_coupling=False)] if has_coupling else []
    # Passive elastic joints distinguish the extended flexible joint model.
    joints = [coordinate.name for coordinate in elastic_coordinates(robot) if coordinate.kind == "joint"]
    return (*_loop_variants(study), *coupling, *[VariantSpec(f"{name} rigid", rigid=(name,)) for name in joints])


def _loop_variants(study: Study) -> tuple[VariantSpec, ...]:
    """List the exact equations of a robot with loops, and the approximations that differ from them."""
    robot, model = study.as_robot(), study.model
    if not robot.loops:
        return ()
    rods = [loop.rod for loop in robot.loops if loop.rod is not None]
    stretches, bends = any(rod.is_elastic for rod in rods), bool(elastic_joints_within(robot))
    differs = {
        "rigid_loop": stretches or bends,
        "constant_stiffness": stretches and not named_geometry(study.fit.parameters, robot),
        "series_stiffness": stretches,
        "bending_outside": bends,
        "lumped_rod": any(rod.mass > 0 or rod.inertia > 0 for rod in rods),
    }
    exact = "constrained" if model.formulation == "minimal" and model.variant == "exact" else "minimal"
    formulation = VariantSpec(f"exact, {exact}", set=(f"model={{formulation: {exact}}}",))
    approximate = (
        VariantSpec(name.replace("_", " "), set=(f"model={{formulation: minimal, variant: {name}}}",))
        for name, is_different in differs.items()
        if is_different and name != model.variant
    )
    return (formulation, *approximate)


def variant(loaded: LoadedStudy, spec: VariantSpec) -> ComparedVariant:
    """Return the study's own model with changes; raise StudyError for an invalid one."""
    original = loaded.study
    study = load(loaded.path, (*loaded.overrides, *spec.set)).study if spec.set else original
    robot = study.as_robot() if spec.motor_coupling else without_motor_coupling(study.as_robot())
    robot = with_stiff_joints(robot, spec.rigid)
    fit = restrict(_comparable_fit(original, study), robot, study.as_robot())
    if study.model != original.model:
        fit = fix(fit, robot, inert_parameters(robot, study.model.variant))
    choose(fit, robot)
    # Independent coordinates are chosen for the robot of the study; they do not influence its response.
    return ComparedVariant(spec.name, robot, fit, replace(study.model, independent=()) if spec.rigid else study.model)


def _comparable_fit(study: Study, variant: Study) -> FitSpec:
    """Return the fit of another study with criterion, weights and band of this study, for comparable costs."""
    fit = study.seeded_fit
    return replace(variant.fit, criterion=fit.criterion, weights=fit.weights, band_hz=fit.band_hz, seed=fit.seed)


def refit_all(run: Run, models: Sequence[ComparedVariant], responses: Responses) -> list[list[Refit]]:
    """Fit each model to all responses and without each fold; missing fits run in several processes."""
    folds = ((), *split_folds(responses.names, run.study.compare.folds))
    tasks = [(variant, fold) for variant in models for fold in folds]
    checkpoint = Checkpoint(path_below(run.folder, PARTIAL), run.stamps["estimate"].code)
    # Hash of everything that a fit depends on, except the code.
    keys = [f"refit-{hash_of([task, run.stamps['estimate'].inputs])[:24]}" for task in tasks]
    if n_finished := sum(key in checkpoint for key in keys):
        run.console.say(f"compare: resumed, {n_finished} of {len(tasks)} fits kept")
    with run.console.progress("compare") as progress:
        results = Execution(run.jobs, progress, checkpoint).resumed(partial(refit, responses), tasks, keys)
    n = len(folds)
    return [results[i * n : (i + 1) * n] for i in range(len(models))]


def search_elasticity(run: Run) -> None:
    """Search for elastic elements; write compare.json with all trials and models, and update the report if any.

    StudyError without current responses, for a single configuration, or for a robot without elastic elements.
    """
    run.require("fit")  # a search needs the same files
    with run.open_folder():
        coordinates, start = _coordinates(run.loaded)
        responses = read_responses(run.path("estimate"))
        names = responses.names
        if len(names) < 2:
            text = "cross-validation needs two configurations or more, and there is one. Measure further configurations"
            raise StudyError("compare/variants", text, run.loaded.path)
        fits: _Fits = {}

        def fitted(models: Sequence[Elastic]) -> Mapping[Elastic, ComparedModel]:
            # The model of the study is fitted first, since all others are submodels and its fit scales QAIC.
            new = [model for model in dict.fromkeys((everything, *models)) if model not in fits]
            fits.update(_fit_variant(run, coordinates, start, new, responses))
            by_name = {row.name: row for row in rank(names, *zip(*fits.values(), strict=True)).rows}
            return {model: by_name[variant.name] for model, (variant, _) in fits.items()}

        everything, trials = tuple(coordinates), []
        for trial in search(everything, fitted, start):
            trials.append(trial)
            say = run.console.say if trial.taken else run.console.detail
            errors = " → ".join(number(math.sqrt(misfit), 3) for misfit in (trial.before, trial.after))
            say(f"search: step {trial.step}: {', '.join(trial.coordinates)} {trial.becomes}: {errors}")
        comparison = rank(names, *zip(*fits.values(), strict=True))
        verdict = f"{describe_search(everything, trials, start)} {comparison.verdict}"
        finish(run, replace(comparison, verdict=verdict, trials=tuple(trials)))


def _coordinates(loaded: LoadedStudy) -> tuple[dict[str, str], Elastic]:
    """Return the coordinates that can be elastic (label to name), and the labels of the gears, which start elastic."""
    robot, unknown = loaded.study.as_robot(), inert_parameters(loaded.study.as_robot(), loaded.study.model.variant)
    coordinates = [spring for spring in elastic_coordinates(robot) if f"k_{spring.name}" not in unknown]
    if not coordinates:
        text = f"nothing to search: robot {robot.name} has no elastic part"
        advice = "Give springs to the gears and passive joints, and stiffness to the rods, that may be elastic"
        raise StudyError("compare/variants", f"{text}. {advice}", loaded.path)
    start = tuple(spring.label for spring in coordinates if spring.kind == "gear")
    return {spring.label: spring.name for spring in coordinates}, start


def _fit_variant(
    run: Run, coordinates: Mapping[str, str], start: Elastic, models: Sequence[Elastic], responses: Responses
) -> _Fits:
    """Fit the robot with only these elements elastic; a model that cannot be fitted gets a failed fit."""
    variants: dict[Elastic, ComparedVariant] = {}
    failures: _Fits = {}
    for model in models:
        name = run.study.name if len(model) == len(coordinates) else f"{', '.join(model) or 'nothing'} elastic"
        rigid = tuple(coordinate for label, coordinate in coordinates.items() if label not in model)
        try:
            variants[model] = variant(run.loaded, VariantSpec(name, rigid=rigid))
        except StudyError as error:
            if model in (start, tuple(coordinates)):
                raise StudyError("compare/variants", f"{name}: {error}", "search") from None
            first = ComparedVariant(name, run.study.as_robot(), run.study.fit, run.study.model)
            failures[model] = first, 2 * [Refit("failed", str(error), 0, math.inf, 0, {})]
    fits = zip(variants.values(), refit_all(run, list(variants.values()), responses), strict=True)
    return dict(zip(variants, fits, strict=True)) | failures
