"""Every row of the table names a function whose arguments are the values that it declares."""

import inspect
from pkgutil import resolve_name

import pytest

from elastid.app.stage_table import STAGES, Stage, helps


@pytest.mark.parametrize("stage", STAGES, ids=lambda stage: f"{stage.name} of {stage.kinds[0]}")
def test_a_stage_takes_what_its_row_declares(stage: Stage) -> None:
    """No value more, and none less: one that is not declared would not be in the stamp."""
    declared = {value.argument for value in stage.values} | {source.argument for source in stage.sources}
    declared |= {name.partition(".")[0] for name in stage.extras} | ({"files"} if stage.files is not None else set())
    assert set(inspect.signature(resolve_name(stage.function)).parameters) == declared | {"work"}


def test_no_kind_of_study_has_two_stages_of_a_name() -> None:
    """And a stage reads only earlier ones."""
    for kind in {kind for stage in STAGES for kind in stage.kinds}:
        names = [stage.name for stage in STAGES if kind in stage.kinds]
        assert len(set(names)) == len(names)
        for stage in STAGES:
            if kind in stage.kinds:
                earlier = [source.stage for source in stage.sources if source.stage in names]
                assert all(names.index(name) < names.index(stage.name) for name in earlier)
    assert tuple(helps())[:3] == ("design", "measure", "estimate")
