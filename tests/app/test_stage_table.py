"""The rows of the table agree with one another."""

from elastid.app.stage_table import NAMES, STAGES


def test_no_kind_of_study_has_two_stages_of_a_name() -> None:
    """And a stage reads only earlier ones."""
    for kind in {kind for stage in STAGES for kind in stage.kinds}:
        names = [stage.name for stage in STAGES if kind in stage.kinds]
        assert len(set(names)) == len(names)
        for stage in STAGES:
            if kind in stage.kinds:
                earlier = [source for source in stage.sources if source in names]
                assert all(names.index(name) < names.index(stage.name) for name in earlier)
    assert NAMES[:3] == ("design", "measure", "estimate")
