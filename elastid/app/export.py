"""export: a fit -> export/<target>/ in the run folder, the identified model for another tool; or responses alone."""

from __future__ import annotations

import shutil
from pathlib import Path

from elastid.app.run import Run
from elastid.app.stages.fit import TRUSTED
from elastid.base.errors import StudyError
from elastid.export.targets import RESPONSE_TARGETS, TARGETS
from elastid.fit.fitted_model import models_by_group
from elastid.store import read_fit, read_responses


def export(run: Run, target: str) -> tuple[Path, ...]:
    """export/<target>/: the identified model for another tool; StudyError where there is no current fit.

    Where robots, or other groups of configurations, have parameters of their own: a model of each in a folder below.
    """
    if run.study.robot is None or target not in TARGETS:
        return _export_responses(run, target)
    run.require("validate")  # reads what an export reads
    responses, result = read_responses(run.path("estimate")), read_fit(run.path("fit"))
    folder = run.folder / "export" / target
    shutil.rmtree(folder, ignore_errors=True)
    models = models_by_group(result, run.study.as_robot(), responses, run.study.model, run.study.name)
    if any(models):
        each = (f"{label} ({', '.join(G.configuration.name for G in of.measured)})" for label, of in models.items())
        run.console.say(f"export: a model for each of {', '.join(each)}, which have parameters of their own")
    paths = tuple(path for label, model in models.items() for path in TARGETS[target](folder / label, model))
    if result.status not in TRUSTED:
        run.console.warn(f"export: the fit cannot be trusted ({result.status.replace('_', ' ')}): {result.message}")
    return _said(run, paths)


def _export_responses(run: Run, target: str) -> tuple[Path, ...]:
    """The measured responses, of a study without a robot or for a target that takes them alone."""
    if target not in RESPONSE_TARGETS:
        raise StudyError(
            f"study {run.study.name} has no robot, and {target} takes the model of one; export its responses to "
            f"{', '.join(RESPONSE_TARGETS)}, or give the robot and fit it"
        )
    run.require_result("estimate")
    folder = run.folder / "export" / target
    shutil.rmtree(folder, ignore_errors=True)
    return _said(run, RESPONSE_TARGETS[target](folder, run.study.name, read_responses(run.path("estimate"))))


def _said(run: Run, paths: tuple[Path, ...]) -> tuple[Path, ...]:
    for path in paths:
        run.console.say(f"export: {path}")
    return paths
