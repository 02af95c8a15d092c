"""Contradictions between the sections of a study: names, counts, limits, units, files.

A check yields a Problem with the key path at which it stands. What the first stage says in its first second is not
repeated here.
"""

from collections.abc import Iterator, Sequence
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any

from elastid.study.checks.experiment import (
    check_configurations,
    check_count,
    check_design,
    check_excitation,
    check_payload,
    check_simulated,
    check_structure,
)
from elastid.study.checks.fit import check_fit, check_loads
from elastid.study.checks.names import check_names
from elastid.study.messages import Problem
from elastid.study.sections import Study
from elastid.study.source import KeyPath


def check_study(study: Study, base: Path) -> Iterator[Problem]:
    """Yield every contradiction between the sections of a study whose files are relative to `base`."""
    experiment = study.experiment
    yield from check_unused(study)
    if study.friction is not None:
        from elastid.study.checks.friction import check_friction  # brings the reader of logs

        yield from check_friction(study, base)
        return
    if (experiment.recorded, experiment.responses, study.tool, study.validation.tool) != (None,) * 4:
        from elastid.study.checks.logs import check_measured  # brings the reader of logs

        yield from check_measured(study, base)
    if study.robot is None:
        yield from check_structure(study)
        return
    yield from check_count(study)
    yield from check_configurations(study)
    yield from check_payload(study)
    yield from check_excitation(study)
    yield from check_design(study)
    if experiment.simulated is not None:
        yield from check_simulated(study, experiment.simulated)
    yield from check_fit(study)
    yield from check_loads(study)
    configurations, validation = list(experiment.configurations), study.validation.configurations
    yield from check_names(("validation", "configurations"), "configuration", validation, configurations)
    if configurations and study.design is None and set(validation) >= set(configurations):
        text = "every configuration is reserved for validation. Leave at least one for the fit"
        yield Problem(("validation", "configurations"), text)


# Kinds of study: dotted keys that they do not use, * for the entries of a list.
_UNUSED = """
friction friction-recorded: excitation design estimator model fit compare loads tool validation.tool gears modal
  experiment.without_payload experiment.responses
friction: validation.configurations experiment.realisations experiment.periods experiment.transient_periods
  experiment.ramp experiment.hold experiment.experiments experiment.simulated.outputs experiment.simulated.carrier
friction-recorded: seed friction.rate_hz friction.loads.*.configuration experiment.recorded.period
  experiment.recorded.period_samples experiment.recorded.half_wave experiment.recorded.files.*.realisation
  experiment.recorded.files.*.experiment experiment.recorded.channels.*.low_pass_hz
simulated: experiment.simulated.heat filter modal
recorded responses: design filter modal
responses: gears
frf frf-responses: excitation design model fit loads tool validation compare seed filter gears
  experiment.without_payload
recorded frf responses frf-responses friction-recorded: experiment.realisations experiment.periods
  experiment.transient_periods experiment.ramp experiment.hold experiment.experiments
recorded frf: experiment.recorded.files.*.joint experiment.recorded.files.*.purpose experiment.recorded.files.*.speed
  experiment.recorded.files.*.load experiment.recorded.files.*.temperature
responses frf-responses: estimator.lines estimator.friction estimator.transient_periods estimator.outlier_sigma
  estimator.local_order estimator.window estimator.segment estimator.resolution_hz
"""
UNUSED = [tuple(map(str.split, row.partition(": ")[::2])) for row in _UNUSED.replace("\n  ", " ").strip().splitlines()]


def check_unused(study: Study) -> Iterator[Problem]:
    """Yield keys that no stage uses; none for a simulated study without its robot, whose kind is unknown."""
    if study.robot is None and study.experiment.simulated is not None:
        return
    for key in (key for kinds, keys in UNUSED if study.kind in kinds for key in keys):
        for path in _changed_keys(study, key.split(".")):
            yield Problem(path, f"no stage of a study of kind {study.kind} uses it. Remove it", at_key=True)


def _changed_keys(value: Any, steps: Sequence[str], path: KeyPath = ()) -> Iterator[KeyPath]:
    step, *further = steps
    if value is None:
        return
    if step == "*":
        for i, entry in enumerate(value):
            yield from _changed_keys(entry, further, (*path, i))
    elif further:
        yield from _changed_keys(getattr(value, step), further, (*path, step))
    else:
        field = next(member for member in fields(value) if member.name == step)
        default = field.default if field.default_factory is MISSING else field.default_factory()
        yield from [(*path, step)] if getattr(value, step) != default else []
