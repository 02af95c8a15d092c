"""Signs turn over the speed that friction has, not over one of those that are tried."""

import numpy as np
import pytest

from elastid.nonlinear.choice import Choice, refined
from elastid.nonlinear.shapes import Shape

PLACES = ("motor 1", "motor 2")


def choice_of(shapes: list[Shape], taken: list[int]) -> Choice:
    """A choice whose covariance tells its shapes apart: i + 1 on the diagonal."""
    motor_of = np.array([PLACES.index(shape.place) for shape in shapes])
    return Choice(tuple(shapes), motor_of, np.ones(2), np.array(taken), np.diag(np.arange(len(shapes)) + 1.0))


def test_two_signs_of_the_grid_become_two_close_ones_about_their_mean() -> None:
    """tanh(v / 1e-3), tried at 0.93e-3 and 1.87e-3: in sliding, these two fitted are off, the close ones by less
    than a quarter of that."""
    v = np.random.default_rng(1).normal(0, 0.05, 20000)
    truth = 90 * np.tanh(v / 1e-3)

    def fitted(shapes: list[Shape]) -> np.ndarray:
        return np.linalg.lstsq(np.stack([shape.sliding(v) for shape in shapes], axis=1), truth)[0]

    tried = [Shape("motor 1", "sign", 0.93e-3), Shape("motor 1", "sign", 1.87e-3)]
    levels = fitted(tried)
    near = refined(choice_of(tried, [0, 1]), levels, PLACES)
    assert near.taken.tolist() == [0, 1]
    assert abs(levels.sum() - 90) > 4 * abs(fitted(list(near.shapes)).sum() - 90)


def test_bristles_and_other_motors_stay_as_they_are() -> None:
    """With the covariance of the choice between them; a sign that was not taken out goes with those that were."""
    shapes = [
        Shape("motor 1", "sign", 1e-3),
        Shape("motor 1", "sign", 2e-3),
        Shape("motor 1", "bristle", 3e-4),
        Shape("motor 2", "sign", 0.0),
    ]
    found = refined(choice_of(shapes, [0, 2, 3]), np.array([5.0, 0.0, 1.0, 2.0]), PLACES)
    assert [shape.kind for shape in found.shapes] == ["sign", "sign", "bristle", "sign"]
    assert found.shapes[2:] == (shapes[2], shapes[3])
    assert found.taken.tolist() == [0, 1, 2, 3]
    assert np.diag(found.covariance).tolist() == [0.0, 0.0, 3.0, 4.0]
    np.testing.assert_allclose([shape.threshold for shape in found.shapes[:2]], 1e-3, rtol=0.11)


@pytest.mark.parametrize("speeds", [(1e-3, 4e-3), (0.0,)])
def test_signs_far_apart_and_ideal_ones_are_left_alone(speeds: tuple[float, ...]) -> None:
    """They turn over more than one speed, or over none."""
    shapes = [Shape("motor 2", "sign", speed) for speed in speeds]
    found = refined(choice_of(shapes, list(range(len(shapes)))), np.ones(len(shapes)), PLACES)
    assert found.shapes == tuple(shapes)
