"""Contradictions between the sections of a study: names, counts, limits, units, files.

A check yields a Problem with the key path at which it stands. What the first stage says in its first second is not
repeated here.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import MISSING, dataclass, fields
from pathlib import Path
from typing import Any

from elastid.study.checks.experiment import (
    check_configurations,
    check_count,
    check_design,
    check_estimator,
    check_excitation,
    check_payload,
    check_simulated,
    check_structure,
)
from elastid.study.checks.fit import check_fit, check_loads
from elastid.study.checks.friction import check_friction
from elastid.study.checks.names import check_names
from elastid.study.checks.recorded import check_recorded, check_responses, check_tool
from elastid.study.messages import Problem
from elastid.study.sections import Kind, Study
from elastid.study.source import KeyPath


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
    yield from check_fit(study)
    yield from check_loads(study)
    yield from check_tool(study, base)
    configurations, left_out = list(experiment.configurations), study.validation.left_out
    yield from check_names(("validation", "left_out"), "configuration", left_out, configurations)
    if configurations and study.design is None and set(left_out) >= set(configurations):
        yield Problem(("validation", "left_out"), "every configuration is left out; leave at least one to the fit")


@dataclass(frozen=True)
class Unused:
    """Dotted keys (* for the entries of a list) that some kinds of study do not use, and why."""

    kinds: tuple[Kind, ...]
    keys: tuple[str, ...]
    why: str


_FRICTION: tuple[Kind, ...] = ("friction", "friction-recorded")
_LOGS: tuple[Kind, ...] = ("recorded", "frf")
_RESPONSES: tuple[Kind, ...] = ("responses", "frf-responses")
# Keys of a plan, which logs and responses from elsewhere do not follow.
PLAN_KEYS = ("realisations", "periods", "transient_periods", "ramp", "hold")
_RECORDS = (
    "lines", "transient_periods", "outlier_sigma", "local_order", "window", "segment", "resolution_hz",
)  # fmt: skip
_FILES = "experiment.recorded.files.*."

UNUSED = (
    Unused(_FRICTION, ("excitation", "design"), "friction is measured by passes and loops, not by {key}; drop this "
           "section, or friction"),
    Unused(_FRICTION, ("estimator", "model", "fit", "compare", "loads", "tool"), "no stage of a study of friction "
           "uses {key}; drop this section, or friction"),
    Unused(_FRICTION, ("validation.folds", "validation.tool"), "a study of friction has no {key}; name logs in "
           "validation.left_out"),
    Unused(("friction",), ("validation.left_out",), "it names logs, and this experiment is simulated; drop this key"),
    Unused(("friction",), tuple(f"experiment.{key}" for key in (*PLAN_KEYS, "experiments")), "it is of multisines; the "
           "motions of a study of friction are given in friction: drop this key"),
    Unused(("friction",), ("experiment.simulated.outputs", "experiment.simulated.carrier",
           "experiment.simulated.warming"), "the rig of a study of friction logs the motor that it moves, without a "
           "carrier, and its joints warm by experiment.simulated.heat; drop this key"),
    Unused(("recorded", "responses"), ("design",), "the experiment is {kind}: what was measured cannot be chosen any "
           "more; drop this section"),
    Unused(("simulated", *_LOGS, *_RESPONSES), ("filter",), "a filter follows friction; give friction (the joints), or "
           "drop it"),
    Unused((*_FRICTION, "frf", *_RESPONSES), ("gears",), "gears are laid open in records of an elastic robot, and this "
           "study has no robot or no records of one; drop this section"),
    Unused(("simulated", "recorded", "responses", *_FRICTION), ("modal",), "modes are found in responses without a "
           "robot; drop this section, or robot and fit"),
    Unused(("frf", "frf-responses"), ("excitation", "design", "model", "fit", "loads", "tool", "validation", "compare"),
           "this section needs a robot, and the study has none; give robot: its file, or drop the section"),
    Unused((*_LOGS, *_RESPONSES, "friction-recorded"), tuple(f"experiment.{key}" for key in PLAN_KEYS), "the "
           "experiment is {kind}: its files determine this; drop the key (files[].realisation numbers realisations, "
           "estimator.transient_periods leaves periods out)"),
    Unused((*_LOGS, *_RESPONSES, "friction-recorded"), ("experiment.experiments",), "the experiment is {kind}: its "
           "files determine the number of experiments; drop this key"),
    Unused((*_FRICTION, "frf", "frf-responses"), ("experiment.without_payload",), "it is of fits of elasticity; loads "
           "of a study of friction are friction.loads: drop this key"),
    Unused(_FRICTION, ("experiment.responses",), "friction is found in motions, not in frequency responses; give logs "
           "(recorded) or simulated"),
    Unused(("simulated",), ("experiment.simulated.heat",), "it is of studies of friction; drop this key, or give "
           "warming"),
    Unused(("friction-recorded",), ("friction.rate_hz",), "it is of designs; logs have experiment.recorded.rate_hz: "
           "drop this key"),
    Unused(("friction-recorded",), ("friction.loads.*.configuration",), "a log names its posture itself, by "
           "files[].configuration: drop this key"),
    Unused(("friction-recorded",), ("experiment.recorded.period", "experiment.recorded.period_samples",
           "experiment.recorded.half_wave", f"{_FILES}realisation", f"{_FILES}experiment"), "motions of friction are "
           "evaluated without periods and realisations; drop this key"),
    Unused(("friction-recorded", "frf", "frf-responses"), ("seed",), "nothing in this study is drawn at random; drop "
           "this key"),
    Unused(_LOGS, tuple(f"{_FILES}{key}" for key in ("joint", "purpose", "speed", "load", "temperature")), "it is of "
           "logs of friction; drop this key, or give friction"),
    Unused(_RESPONSES, tuple(f"estimator.{key}" for key in _RECORDS), "it is of records, and the responses of this "
           "study are estimated already; drop this key"),
)  # fmt: skip


def check_unused(study: Study) -> Iterator[Problem]:
    """Of a simulated study without its robot none: its kind is not known."""
    if study.robot is None and study.experiment.simulated is not None:
        return
    for each in UNUSED:
        for key in each.keys if study.kind in each.kinds else ():
            for path in _given(study, tuple(key.split("."))):
                yield Problem(path, each.why.format(key=key, kind=study.experiment.kind), at_key=True)


def _given(value: Any, steps: tuple[str, ...], path: KeyPath = ()) -> Iterator[KeyPath]:
    """The places under these steps that differ from their default."""
    step, *rest = steps
    if value is None:
        return
    if step == "*":
        for i, entry in enumerate(value):
            yield from _given(entry, tuple(rest), (*path, i))
        return
    field = next(each for each in fields(value) if each.name == step)
    default = field.default if field.default_factory is MISSING else field.default_factory()
    given = getattr(value, step)
    if rest:
        yield from _given(given, tuple(rest), (*path, step))
    elif given != default:
        yield (*path, step)
