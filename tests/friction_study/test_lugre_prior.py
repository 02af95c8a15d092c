"""What a law from passes and responses at rest tell of a LuGre law beforehand."""

from __future__ import annotations

import numpy as np
import pytest
from plants.published_friction import drawn, published_levels

from elastid.friction_study.laws import StaticLaw
from elastid.friction_study.lugre_shooting import Prior
from elastid.friction_study.spec import LawSpec
from elastid.simulation.elastic_joint import FRICTION


@pytest.mark.slow
def test_the_law_of_passes_counts_with_its_whole_covariance() -> None:
    """Draws of the law scatter in the logarithm as the information says; bristles are unknown."""
    levels = published_levels(tuple(np.geomspace(1, 280, 30)), (0.0,), (48.0,), 0.002)
    laws = [StaticLaw.of(drawn(levels, seed), LawSpec()) for seed in range(30)]
    prior = Prior.of_law(laws[0])
    names = ("coulomb", "stiction", "stribeck_velocity", "viscous")
    assert set(prior.known) == set(names)
    at = [FRICTION.index(name) for name in names]
    logs = np.log([[law.values[name] for name in names] for law in laws])
    covariance = np.linalg.inv(prior.information[np.ix_(at, at)])
    correlation = np.corrcoef(logs.T)
    std = np.sqrt(np.diag(covariance))
    np.testing.assert_allclose(covariance / np.outer(std, std), correlation, atol=0.4)
    np.testing.assert_allclose(std, logs.std(axis=0), rtol=0.5)
    assert not prior.information[:2].any()


def test_a_damping_that_may_be_nothing_is_not_known() -> None:
    prior = Prior.of({"sigma_0": 300.0, "sigma_1": -0.1}, np.diag([9.0, 0.04]))
    assert prior.known == pytest.approx({"sigma_0": 300.0})
    both = prior.with_other(Prior.of({"viscous": 0.01}, np.array([[1e-8]])))
    assert both.known == pytest.approx({"sigma_0": 300.0, "viscous": 0.01})
    assert both.information[0, 0] == pytest.approx(1 / 0.01**2)
