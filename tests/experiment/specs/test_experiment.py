"""The section `experiment`: one rig, and counts that give a variance."""

from __future__ import annotations

import pytest

from elastid.base.errors import StudyError
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.simulated import SimulatedSpec


def test_exactly_one_rig_with_its_kind() -> None:
    spec = ExperimentSpec(simulated=SimulatedSpec())
    assert (spec.kind, spec.channels, spec.runs(3)) == ("simulated", (), 3)
    with pytest.raises(StudyError, match="logs need the section recorded"):
        spec.as_recorded()
    with pytest.raises(ValueError, match="exactly one"):
        ExperimentSpec()


def test_one_period_shows_no_noise() -> None:
    with pytest.raises(ValueError, match="periods is 1; it must be at least 2"):
        ExperimentSpec(simulated=SimulatedSpec(), periods=1)
