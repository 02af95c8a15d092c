"""Robots drawn from what a fit knows."""

from dataclasses import replace

import numpy as np
import pytest
from plants.arm import STD, result

from elastid.fit.result import Result
from elastid.linear.fitted_model import ModelErrorFactor
from elastid.use.draws import draw_robots


def test_draws_scatter_as_the_fit_says() -> None:
    draws = draw_robots(result(), 80, seed=2)
    np.testing.assert_allclose(np.std(np.log(draws.values), axis=0), STD, rtol=0.25)


def test_sampled_robot_has_numbers_of_draw() -> None:
    """A mass, which takes the parameters with it; besides, they scatter as the fit says."""
    factor = ModelErrorFactor(np.array([0.3, -0.2, 0.0, 0.1]), ("m_fore",), (0.1,), (True,))
    estimated = replace(result().at(np.array([0.4, -0.9])).estimated, model_error_factors=(factor,))
    draws = draw_robots(type("Doubted", (Result,), {"model_error_factors": (factor,)})(**vars(result())), 20)
    assert np.std(draws.x[:, :-1], axis=0).max() < 2 * STD
    for x, robot in zip(draws.x, draws.robots, strict=True):
        numbers = dict(zip(estimated.names, estimated.theta(x).tolist(), strict=True))
        for name in ("k_1", "d_2", "m_fore"):
            assert robot.parameters()[name][0] == pytest.approx(numbers[name])


def test_same_seed_gives_same_robots_and_fixed_rest() -> None:
    """An infinite variance is no draw."""
    own = result()
    C = own.covariance.copy()
    C[0, 0] = np.inf
    draws = draw_robots(replace(own, covariance=C), 5, seed=1)
    assert draws.fixed == (own.parameters.free_names[0],)
    assert np.ptp(draws.values[:, draws.names.index(draws.fixed[0])]) == 0
    np.testing.assert_array_equal(draws.values, draw_robots(replace(own, covariance=C), 5, seed=1).values)


def test_no_draw_is_beyond_the_bounds_that_the_fit_searched() -> None:
    """A damping of which nearly nothing is known, at its lower bound: as small, or larger up to the upper one."""
    own = result()
    C, i = own.covariance.copy(), own.parameters.free_names.index("d_1")
    C[i], C[:, i] = 0.0, 0.0
    C[i, i] = 20.0**2
    p = own.parameters["d_1"]
    draws = draw_robots(replace(own, covariance=C), 200, seed=1)
    values = draws.values[:, draws.names.index("d_1")]
    assert values.min() == pytest.approx(p.lower)
    assert values.max() == pytest.approx(p.upper)
