"""The section `modal` of a study: keys, and messages that name the wrong one."""

import pytest

from elastid.modal.spec import GeometrySpec

POINTS = {"foot": (0.0, 0.0, 0.0), "tip": (0.0, 0.0, 1.0)}


@pytest.mark.parametrize(
    ("keys", "says"),
    [
        ({"lines": (("foot", "head"),)}, r"head.*foot, tip"),
        ({"motion": {"a": ("tip", "up")}}, "direction of a is up; give x, y or z"),
    ],
)
def test_geometry_names_what_is_wrong(keys: dict, says: str) -> None:
    assert GeometrySpec(points=POINTS).direction_of("tip -x") == ("tip", "-x")
    assert not any(GeometrySpec(points=POINTS).direction_of(output) for output in ("head x", "tip up"))
    with pytest.raises(ValueError, match=says):
        GeometrySpec(points=POINTS, **keys)
