"""The section `modal` of a study: keys, and messages that name the wrong one."""

import pytest

from elastid.modal.spec import GeometrySpec, ModalSpec

POINTS = {"foot": (0.0, 0.0, 0.0), "tip": (0.0, 0.0, 1.0)}


@pytest.mark.parametrize(
    ("keys", "says"),
    [
        ({"lines": (("foot", "head"),)}, "head is none of the points"),
        ({"motion": {"a": ("tip", "up")}}, "direction of a is up; give x, y or z"),
    ],
)
def test_geometry_names_what_is_wrong(keys: dict, says: str) -> None:
    assert GeometrySpec(points=POINTS).direction_of("tip -x") == ("tip", "-x")
    assert not any(GeometrySpec(points=POINTS).direction_of(output) for output in ("head x", "tip up"))
    with pytest.raises(ValueError, match=says):
        GeometrySpec(points=POINTS, **keys)


@pytest.mark.parametrize(
    ("keys", "says"),
    [
        ({"band_hz": (5.0, 2.0)}, "give .lowest, highest"),
        ({"max_order": 1}, "^max_order: .*2"),
        ({"exponential": 0.0}, "^exponential: .*0"),
        ({"poles_hz": ()}, "^poles_hz"),
        ({"poles_hz": (11.0, -5.0)}, "^poles_hz: .*-5"),
        ({"poles_hz": (11.0, float("nan"))}, "^poles_hz.1: "),
        ({"poles_hz": (11.0, 11.0)}, "^poles_hz: 11"),
    ],
)
def test_numbers_have_their_limits(keys: dict, says: str) -> None:
    with pytest.raises(ValueError, match=says):
        ModalSpec(**keys)
