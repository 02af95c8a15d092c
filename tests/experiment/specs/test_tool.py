"""The section `tool`: drives that hold the motors while somebody taps."""

from pathlib import Path

import pytest

from elastid.experiment.specs.recorded import ResponseFileSpec, ResponsesSpec
from elastid.experiment.specs.tool import ToolSpec


@pytest.mark.parametrize("name", ["stiffness", "damping"])
def test_a_drive_that_pushes_away_is_refused(name: str) -> None:
    """A sign that was turned would make an unstable robot, whose response has no error that shows it."""
    responses = ResponsesSpec(files=(ResponseFileSpec(path=Path("tap.csv"), configuration="a"),))
    gains = {"stiffness": (40.0,), "damping": (0.1,)}
    with pytest.raises(ValueError, match=f"{name} is -1"):
        ToolSpec(responses, "controlled", **(gains | {name: (-1.0,)}))
