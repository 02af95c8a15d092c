"""Contradictions between the sections of a study: names, counts, limits, units, files.

A check yields a Problem with the key path at which it stands. A rule that a section or a stage enforces as well is a
function of theirs, called here for its place in the file.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from elastid.study.checks.experiment import (
    check_configurations,
    check_count,
    check_design,
    check_estimator,
    check_excitation,
    check_lines,
    check_payload,
    check_simulated,
    check_structure,
)
from elastid.study.checks.fit import check_fit, check_loads, check_model, check_moved_inertias
from elastid.study.checks.friction import check_friction
from elastid.study.checks.names import check_names
from elastid.study.checks.recorded import check_recorded, check_responses, check_tool
from elastid.study.checks.unused import check_unused
from elastid.study.messages import Problem
from elastid.study.sections import Study

__all__ = ["check_lines", "check_study"]


def check_study(study: Study, base: Path) -> Iterator[Problem]:
    """Every contradiction between the sections of a study whose files are relative to `base`."""
    experiment = study.experiment
    yield from check_unused(study)
    if study.friction is not None:
        yield from check_friction(study, base)
        return
    if experiment.recorded is not None:
        yield from check_recorded(study, experiment.recorded, base)
    if experiment.responses is not None:
        yield from check_responses(study, experiment.responses, base)
    if study.robot is None:
        yield from check_structure(study)
        if experiment.simulated is None:
            yield from check_estimator(study)
        return
    yield from check_count(study)
    yield from check_configurations(study)
    yield from check_payload(study)
    yield from check_estimator(study)
    yield from check_excitation(study)
    yield from check_design(study, base)
    if experiment.simulated is not None:
        yield from check_simulated(study, experiment.simulated)
    yield from check_model(("model",), study.model, study.robot)
    yield from check_moved_inertias(study)
    yield from check_fit(study)
    yield from check_loads(study)
    yield from check_tool(study, base)
    configurations, left_out = list(experiment.configurations), study.validation.left_out
    yield from check_names(("validation", "left_out"), "configuration", left_out, configurations)
    if configurations and study.design is None and set(left_out) >= set(configurations):
        yield Problem(("validation", "left_out"), "every configuration is left out; leave at least one to the fit")
