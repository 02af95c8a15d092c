"""LuGre friction of an elastic joint from its motor's angle and torque."""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from elastid.base.arrays import FloatArray
from elastid.base.errors import FitError
from elastid.friction_fit.lugre_prior import Prior
from elastid.friction_fit.shooting import JointLog, fit_lugre
from elastid.simulation.elastic_joint import FRICTION, ElasticJoint

JOINT = ElasticJoint(0.01, 0.02, 800.0, 0.3)
TRUTH = {
    "sigma_0": 300.0, "sigma_1": 0.5, "coulomb": 1.0, "stiction": 1.5, "stribeck_velocity": 8.0, "viscous": 5e-3,
}  # fmt: skip
RATE, COUNT, NOISE = 1000.0, 2 * np.pi / 2**16, 0.05


def torque() -> FloatArray:
    """8 s: 1 Hz up to 0.95 of break-away with a dither of 5 to 60 Hz, then reversals up to 80 rad/s."""
    t = np.arange(8000) / RATE
    rng = np.random.default_rng(5)
    dither = sum(0.03 * np.sin(2 * np.pi * f * t + rng.uniform(0, 6)) for f in range(5, 61, 5))
    slow = np.where(t < 4, 0.95 * 1.5 * t / 4 * np.sin(2 * np.pi * t), 6.0 * np.sin(np.pi * (t - 4)))
    return np.asarray(slow + dither)


@lru_cache(maxsize=4)
def angle(seed: int) -> tuple[FloatArray, FloatArray]:
    """Torque and angle of the motor as logged; a fine step, the torque with noise that is not logged."""
    u, noise = torque(), NOISE * np.random.default_rng(seed).standard_normal(8000)
    step = JOINT.step(RATE, 8)
    p = np.tile(np.array([TRUTH[name] for name in FRICTION])[:, None], 8000)
    states = step.mapaccum("walk", 8000)(np.zeros(5), p, (u + noise)[None]).full()
    return u, np.round(states[0] / COUNT) * COUNT


def log(seed: int) -> JointLog:
    u, y = angle(seed)
    return JointLog("motor 1", RATE, u, y, NOISE, COUNT / np.sqrt(12))


def start(seed: int) -> dict[str, float]:
    """Wrong by up to a factor of two."""
    rng = np.random.default_rng(100 + seed)
    values = {name: value * 2.0 ** rng.uniform(-1, 1) for name, value in TRUTH.items()}
    return values | {"stiction": max(values["stiction"], 1.2 * values["coulomb"])}


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


@pytest.mark.slow
def test_all_six_numbers_from_a_start_wrong_by_two() -> None:
    """sigma_0 to 2 %, sigma_1 to 6 %, the static numbers to 1 %, viscous friction to 3 %."""
    fit = fit_lugre(log(0), JOINT, start(0))
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
    fit = fit_lugre(log(0), JOINT, start(0), known)
    assert abs(fit.values["viscous"] / TRUTH["viscous"] - 1) < 3e-3


@pytest.mark.slow
def test_every_start_wrong_by_two_leads_to_the_same_law() -> None:
    """Six logs and starts: rms errors of 2, 6 and 1 %."""
    fits = [fit_lugre(log(seed), JOINT, start(seed)) for seed in range(6)]
    error = np.array([[fit.values[name] / TRUTH[name] - 1 for name in FRICTION] for fit in fits])
    rms = dict(zip(FRICTION, np.sqrt(np.mean(error**2, axis=0)), strict=True))
    assert rms["sigma_0"] < 0.02
    assert rms["sigma_1"] < 0.06
    assert max(rms[name] for name in ("coulomb", "stiction", "stribeck_velocity")) < 0.012


@pytest.mark.slow
def test_a_joint_of_another_inertia_is_refused() -> None:
    """A motor twice as heavy: no law explains the log, and the message says what to check."""
    with pytest.raises(FitError, match=r"times what the noise explains; .* check inertia and stiffness of the joint"):
        fit_lugre(log(0), ElasticJoint(0.02, 0.02, 800.0, 0.3), TRUTH)
