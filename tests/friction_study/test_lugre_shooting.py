"""LuGre friction of an elastic joint from its motor's angle and torque.

The search starts from a law of passes and of responses at rest.
"""

from __future__ import annotations

from functools import cache

import casadi as ca
import numpy as np
import pytest
from plants.lugre_joint import JOINT, RATE, TRUTH, joint_log, wrong_start
from plants.published_friction import drawn, published_levels
from scipy.integrate import solve_ivp

from elastid.base.arrays import FloatArray
from elastid.base.errors import FitError
from elastid.friction_study.laws import StaticLaw
from elastid.friction_study.lugre_shooting import LuGreFit, Prior, fit_lugre
from elastid.friction_study.spec import LawSpec
from elastid.simulation.elastic_joint import FRICTION, ElasticJoint


def test_the_step_is_that_of_the_differential_equation() -> None:
    """A tenth of a second from rest under a torque, against an integrator of the equations as they stand."""
    x, p, u = ca.SX.sym("x", 5), [TRUTH[name] for name in FRICTION], 1.3
    sigma_0, sigma_1, F_c, F_s, nu_s, viscous = p

    def rates(_: float, s: FloatArray) -> list[float]:
        q_m, v_m, q_l, v_l, z = s
        g = F_c + (F_s - F_c) * np.exp(-((v_m / nu_s) ** 2))
        dz = v_m - sigma_0 * abs(v_m) / g * z
        spring = JOINT.stiffness * (q_m - q_l) + JOINT.damping * (v_m - v_l)
        friction = sigma_0 * z + sigma_1 * dz + viscous * v_m
        return [v_m, (u - friction - spring) / JOINT.motor_inertia, v_l, spring / JOINT.link_inertia, dz]

    exact = solve_ivp(rates, (0, 0.1), np.zeros(5), rtol=1e-10, atol=1e-12).y[:, -1]
    walk = JOINT.step(RATE).mapaccum("walk", 100)
    found = walk(np.zeros(5), np.tile(np.array(p)[:, None], 100), np.full((1, 100), u)).full()[:, -1]
    np.testing.assert_allclose(found, exact, rtol=2e-3, atol=1e-9)
    assert x.numel() == 5


@cache
def fitted(seed: int) -> LuGreFit:
    """From the log of a seed, and a start wrong by up to two."""
    return fit_lugre(joint_log(seed), JOINT, wrong_start(seed))


@pytest.mark.slow
def test_all_six_numbers_from_a_start_wrong_by_two() -> None:
    """sigma_0 to 2 %, sigma_1 to 6 %, the static numbers to 1 %, viscous friction to 3 %."""
    fit = fitted(0)
    error = {name: fit.values[name] / TRUTH[name] - 1 for name in FRICTION}
    assert abs(error["sigma_0"]) < 0.02
    assert abs(error["sigma_1"]) < 0.06
    assert np.sqrt(np.mean([error[name] ** 2 for name in ("coulomb", "stiction", "stribeck_velocity")])) < 0.01
    assert abs(error["viscous"]) < 0.03
    low, high = fit.interval("sigma_1")
    assert low < TRUTH["sigma_1"] < high


@pytest.mark.slow
def test_what_passes_have_told_counts() -> None:
    """A prior of 0.1 % holds viscous friction, which the log alone knows to 0.5 %."""
    known = Prior.of({"viscous": TRUTH["viscous"]}, np.array([[(1e-3 * TRUTH["viscous"]) ** 2]]))
    fit = fit_lugre(joint_log(0), JOINT, wrong_start(0), known)
    assert abs(fit.values["viscous"] / TRUTH["viscous"] - 1) < 3e-3


@pytest.mark.slow
def test_every_start_wrong_by_two_leads_to_the_same_law() -> None:
    """Three logs and starts: rms errors of 2, 6 and 1 %."""
    fits = [fitted(seed) for seed in range(3)]
    error = np.array([[fit.values[name] / TRUTH[name] - 1 for name in FRICTION] for fit in fits])
    rms = dict(zip(FRICTION, np.sqrt(np.mean(error**2, axis=0)), strict=True))
    assert rms["sigma_0"] < 0.02
    assert rms["sigma_1"] < 0.06
    assert max(rms[name] for name in ("coulomb", "stiction", "stribeck_velocity")) < 0.012


@pytest.mark.slow
def test_a_joint_of_another_inertia_is_refused() -> None:
    """A motor twice as heavy: no law explains the log, and the message says what to check."""
    with pytest.raises(FitError, match=r"times what the noise explains; .* check inertia and stiffness of the joint"):
        fit_lugre(joint_log(0), ElasticJoint(0.02, 0.02, 800.0, 0.3), TRUTH)


@pytest.mark.slow
def test_the_law_of_passes_counts_with_its_whole_covariance() -> None:
    """Draws of the law scatter in the logarithm as the information says; bristles are unknown."""
    levels = published_levels(tuple(np.geomspace(1, 280, 30)), (0.0,), (48.0,), 0.002)
    laws = [StaticLaw.of(drawn(levels, seed), LawSpec()) for seed in range(30)]
    prior = Prior.of(laws[0].values, laws[0].covariance)
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
