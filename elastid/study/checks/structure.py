"""A study without a robot: logs or responses, and none of the sections that need a robot."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields

from elastid.study.messages import Problem
from elastid.study.sections import Study

# Sections that only stages with a robot read.
_OF_A_ROBOT = ("excitation", "design", "model", "fit", "validation", "compare")


def check_structure(study: Study) -> Iterator[Problem]:
    """Every contradiction between the sections of a study without a robot, its files and channels excepted."""
    experiment = study.experiment
    if experiment.simulated is not None:
        message = "the experiment is simulated, and the robot is what the rig simulates; give the path of its file"
        yield Problem(("robot",), message, at_key=True)
        return
    for section, default in ((f.name, f.default) for f in fields(Study) if f.name in _OF_A_ROBOT):
        if getattr(study, section) != default:
            message = "this section needs a robot, and the study has none; give robot: its file, or drop the section"
            yield Problem((section,), message, at_key=True)
    if not experiment.configurations:
        message = (
            "no configuration is given; name each state of the structure that was measured, for example {bench: []}"
        )
        yield Problem(("experiment", "configurations"), message)
    for name, angles in experiment.configurations.items():
        path = ("experiment", "configurations", name)
        if refused := study.places.count_refusal(len(angles)):
            yield Problem(path, refused)
    if experiment.experiments is not None:
        message = f"the experiment is {experiment.kind}: its files determine the number of experiments; drop this key"
        yield Problem(("experiment", "experiments"), message, at_key=True)
