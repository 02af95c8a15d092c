"""The section `experiment`: one rig, and counts that give a variance."""

from __future__ import annotations

from pathlib import Path

import pytest
from plants.refusals import refused

from elastid.experiment.specs.experiment import ExperimentSpec, ToolSpec
from elastid.experiment.specs.recorded import ResponseFileSpec, ResponsesSpec
from elastid.experiment.specs.simulated import SimulatedSpec


def test_exactly_one_rig_with_its_kind() -> None:
    spec = ExperimentSpec(simulated=SimulatedSpec())
    assert (spec.kind, spec.channels, spec.runs(3)) == ("simulated", (), 3)
    with refused("study/stage", place="experiment"):
        spec.as_recorded()
    with pytest.raises(ValueError, match="exactly one"):
        ExperimentSpec()


@pytest.mark.parametrize("name", ["stiffness", "damping"])
def test_a_drive_that_pushes_away_is_refused(name: str) -> None:
    """A sign that was turned would make an unstable robot, whose response has no error that shows it."""
    responses = ResponsesSpec(files=(ResponseFileSpec(path=Path("tap.csv"), configuration="a"),))
    gains = {"stiffness": (40.0,), "damping": (0.1,)}
    with pytest.raises(ValueError, match=f"{name} is -1"):
        ToolSpec(responses, "controlled", **(gains | {name: (-1.0,)}))
