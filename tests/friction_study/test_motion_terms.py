"""Parts of the regression of a motion that its data show: temperature, and a Stribeck effect as far as it is seen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from elastid.friction_study.identify import BeforeSliding, joint_law
from elastid.friction_study.motion import MotionFriction, regress_motion
from elastid.friction_study.motion_terms import Motion
from elastid.friction_study.spec import LawSpec

J, F_C, VISCOUS, RATE = 12.0, 8.0, 30.0, 500.0


def warming(seed: int = 0, slope: float = 0.0, decay: float = 20.0, share: float = 0.0, degc: float = 25.0) -> Motion:
    """An axis at 25 to 45 degC in 60 s: F_c + slope (T - 35), f (1 + share (e^{-(T - 35) / decay} - 1))."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(60 * RATE)) / RATE
    waves = [(0.6, 0.25, 0.3), (0.25, 0.7, 1.0), (0.08, 1.9, 2.0)]
    phases = [(a, 2 * np.pi * f, p + rng.uniform(0, 6)) for a, f, p in waves]
    q = sum(a * np.sin(w * t + p) for a, w, p in phases)
    v = sum(a * w * np.cos(w * t + p) for a, w, p in phases)
    acceleration = sum(-a * w**2 * np.sin(w * t + p) for a, w, p in phases)
    warmth = 45 - (45 - degc) * np.exp(-t / 25)
    theta = warmth - 35
    u = J * acceleration + (F_C + slope * theta) * np.sign(v)
    u = u + VISCOUS * (1 + share * np.expm1(-theta / decay)) * v + 0.3 * rng.standard_normal(len(t))
    return Motion("joint 1", RATE, np.round(np.asarray(q) / 2e-5) * 2e-5, u, temperature=warmth)


def held(fit: MotionFriction, part: str) -> str:
    return next((each.reason for each in fit.held if each.part == part), "")


def test_friction_that_changes_with_temperature_has_numbers_for_it() -> None:
    """F_c falls by 0.06 N*m/K, viscous friction by a factor e in 20 K; both numbers hold at the mean temperature."""
    fit = regress_motion(warming(slope=-0.06, share=0.4))
    T_0 = fit.terms.reference
    truth = {
        "temperature.coulomb": -0.06,
        "coulomb": F_C - 0.06 * (T_0 - 35),
        "temperature.viscous": 0.4 * VISCOUS * np.exp(-(T_0 - 35) / 20),
        "viscous": VISCOUS * (1 + 0.4 * np.expm1(-(T_0 - 35) / 20)),
        "inertia": J,
    }
    for name, value in truth.items():
        assert abs(fit.chosen[name] - value) < 3 * fit.chosen.std(name), name
    assert not held(fit, "temperature")
    law = joint_law(None, fit, BeforeSliding(), LawSpec())
    assert law is not None
    assert law[0].temperature is not None
    assert law[0].temperature.coulomb == fit.chosen["temperature.coulomb"]
    assert law[0].temperature.reference == pytest.approx(T_0)


def test_another_decay_than_that_assumed_is_found_where_temperatures_show_it() -> None:
    """Over 6 K in 20: the intervals of friction hold the truth, as that of the decay does."""
    fit = regress_motion(warming(share=0.3, decay=6.0))
    T_V, T_0 = fit.chosen["temperature.decay"], fit.terms.reference
    assert abs(T_V - 6) < 3 * fit.chosen.std("temperature.decay")
    viscous = VISCOUS * (1 + 0.3 * np.expm1(-(T_0 - 35) / 6))
    assert abs(fit.chosen["viscous"] - viscous) < 3 * fit.chosen.std("viscous")


def test_temperature_is_no_part_where_it_does_not_matter_or_vary_and_the_reason_says_so() -> None:
    fits = {seed: regress_motion(warming(seed)) for seed in range(2)}
    assert not any(fit.terms.heat for fit in fits.values())
    assert held(fits[0], "temperature").startswith("the motions do not show it from 25 to 4")
    assert "25 to 25 degC only" in held(
        regress_motion(replace(warming(), temperature=np.full(30000, 25.0))), "temperature"
    )
    assert "no temperature was logged" in held(regress_motion(replace(warming(), temperature=None)), "temperature")


def test_a_stribeck_effect_below_all_speeds_has_no_numbers() -> None:
    """Ways at 0.1 rad/s and faster, F_s over 0.05 rad/s: F_c is right, and stiction no number."""
    rng, n = np.random.default_rng(0), round(60 * RATE)
    speed = np.concatenate([
        s * np.minimum(v, 1.5 * np.minimum(t, 1.6 - t))
        for v in (0.1, 0.14, 0.2, 0.3, 0.45, 0.7, 0.12, 0.17, 0.25, 0.36, 0.55, 0.8, 0.1, 0.15, 0.3, 0.6, 0.13, 0.9)
        for s in (1.0, -1.0)
        for t in [np.arange(round(1.6 * RATE)) / RATE]
    ])[:n]  # fmt: skip
    q = np.cumsum(speed) / RATE
    v = np.gradient(q) * RATE
    u = J * np.gradient(v) * RATE + np.sign(v) * (F_C + 6 * np.exp(-((v / 0.09) ** 2))) + VISCOUS * v
    fit = regress_motion(Motion("joint 1", RATE, q, u + 0.1 * rng.standard_normal(len(u))))
    assert "stiction" in fit.chosen.names
    assert not {"stiction", "stribeck_velocity"} & set(fit.known)
    assert "a third of the Stribeck velocity is 0.03; record slower motions" in held(fit, "stribeck")
    assert abs(fit.chosen["coulomb"] - F_C) < 3 * fit.chosen.std("coulomb")
