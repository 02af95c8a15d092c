"""Inertia and friction of one axis from any motion."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from plants.cogged_joint import RATIO, CoggedJoint, logged, simulated
from plants.marks import slow
from plants.measured import EMPS, measured
from plants.refusals import refused
from scipy.io import loadmat

from elastid.base.arrays import FloatArray
from elastid.friction_study.inverse_dynamics_regression import (
    MotionFriction,
    assess_motion,
    regress_motion,
    torque_components,
)
from elastid.friction_study.motion_signals import Motion, MotionSignals
from elastid.friction_study.regressor import change_of, columns_of
from elastid.friction_study.static_model_fit import identified_names
from elastid.model.formulation import ElasticJoint

J, F_C, VISCOUS, COS, SIN = 12.0, 8.0, 30.0, 25.0, 4.0


def three_sines(t: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Angle, velocity and acceleration (3, n) of a motion of three sines."""
    a, f, p = np.transpose([(0.6, 0.25, 0.3), (0.25, 0.7, 1.0), (0.08, 1.9, 2.0)])
    w, phase = 2 * np.pi * f, p + rng.uniform(0, 6, 3)
    return np.array([a * w**k @ np.sin(np.outer(w, t) + (phase + k * np.pi / 2)[:, None]) for k in range(3)])


def swing(seed: int = 0, uneven: float = 0.0, noise: float = 1.0) -> Motion:
    """An axis under gravity in a motion of three sines, with torque noise that is correlated over 0.1 s."""
    rng, rate = np.random.default_rng(seed), 500.0
    t = np.arange(round(40.0 * rate)) / rate
    q, v, acceleration = three_sines(t, rng)
    slow = np.convolve(rng.standard_normal(len(t)), np.exp(-np.arange(200) / 50), "same") / 5
    friction = (F_C + VISCOUS * np.abs(v)) * np.sign(v) + uneven * np.abs(v)
    u = J * acceleration + friction + COS * np.cos(q) + SIN * np.sin(q) + noise * slow
    q = np.round(q / 2e-5) * 2e-5
    return Motion("joint 1", rate, q, u, turns_against_gravity=True)


@pytest.mark.slow
def test_inertia_friction_and_gravity_are_found_and_covered() -> None:
    """30 logs with noise correlated over 0.1 s: unbiased, and 95 % intervals hold the truth."""
    truth = {"inertia": J, "coulomb": F_C, "viscous": VISCOUS, "gravity.cos": COS, "gravity.sin": SIN}
    found = [regress_motion(swing(seed)).regression for seed in range(30)]
    held = []
    for name, value in truth.items():
        error = np.array([fit[name] - value for fit in found])
        assert abs(error.mean()) < 3 * error.std() / np.sqrt(len(found))
        held += [abs(fit[name] - value) < 1.96 * fit.std(name) for fit in found]
    assert np.mean(held) >= 0.9
    white = [fit.std("viscous") for fit in (regress_motion(swing(0, noise=0.0)).regression, found[0])]
    assert white[0] < white[1]


def with_noise(motion: Motion, std: float, seed: int = 0) -> Motion:
    """The motion with white noise of its position."""
    noise = std * np.random.default_rng(seed).standard_normal(len(motion.position))
    return replace(motion, position=motion.position + noise)


@pytest.mark.slow
@pytest.mark.parametrize("std", [2e-4, 5e-4])
def test_position_noise_neither_biases_inertia_nor_causes_misfit(std: float) -> None:
    """8 logs; in a band of 20 Hz the noise lowers the inertia by 4 to 16 %."""
    fits = [regress_motion(with_noise(swing(seed), std, seed)) for seed in range(8)]
    errors = np.array([(fit.regression["inertia"] - J) / fit.regression.std("inertia") for fit in fits])
    assert np.sum(np.abs(errors) > 1.96) <= 1
    assert all(fit.regression.std("inertia") < 0.003 * J and not fit.misfit for fit in fits)


@pytest.mark.slow
@pytest.mark.parametrize("turn", [0.0, 2 * np.pi / RATIO])
def test_errors_periodic_in_motor_angle_are_in_intervals(turn: float) -> None:
    """6 logs over half a radian under cogging and Coulomb friction by the motor's turn, whose ratio is known or not."""
    step_s, t = 5e-4, np.arange(60_000) * 5e-4
    joints, references = [], []
    for seed in range(6):
        f, p = np.random.default_rng(seed).uniform([[0.2], [0.0]], [[1.0], [6.28]], (2, 5))
        wave = np.sum(np.sin(2 * np.pi * np.outer(t, f) + p) / f, axis=1)
        references.append(0.5 * wave / np.abs(wave).max())
        joints.append(CoggedJoint(stiction=114.6, cogging=8.0, dry=10.0, phase=seed))
    held, errors = [], []
    truth = {"inertia": 20.0, "coulomb": 114.6, "viscous": 60.0, "gravity.cos": 80.0, "gravity.sin": 0.0, "offset": 0.0}
    for seed, (q, u) in enumerate(simulated(joints, references, step_s)):
        log = logged(q, u, step_s, seed)
        fit = regress_motion(Motion("joint 1", log.rate_hz, log.position, log.torque, False, True, turn)).regression
        held += [abs(fit[name] - value) < 1.96 * fit.std(name) for name, value in truth.items()]
        errors.append([fit[name] / truth[name] - 1 for name in ("inertia", "coulomb", "viscous")])
    assert np.mean(held) > 0.9
    assert np.all(np.abs(np.mean(errors, axis=0)) < (1e-3 if turn else 0.02))


def test_parts_of_the_torque_are_those_of_the_axis():
    fit = regress_motion(swing(3, noise=0.0))
    signals = MotionSignals.of(fit.motion, fit.passband_hz)
    parts = torque_components(fit.regression, columns_of(signals, fit.terms))
    velocity, torque, q = signals.filtered(signals.velocity), signals.filtered(fit.motion.torque), fit.motion.position
    np.testing.assert_allclose(parts["viscous"], VISCOUS * velocity, atol=0.005 * VISCOUS * np.abs(velocity).max())
    assert np.std(parts["gravity"]) == pytest.approx(np.std(COS * np.cos(q) + SIN * np.sin(q)), rel=0.02)
    assert np.std(torque - sum(parts.values())) < 0.05 * F_C


def test_band_change_widens_interval_or_causes_misfit():
    """Of this joint, by more than three std: shift and std add as variances."""
    fit = regress_motion(swing(3))
    std = fit.regression.std("viscous")
    for joint, change, widened in (("", 100 * std, math.hypot(std, 100 * std)), ("", std, std), ("2", 100 * std, std)):
        found = assess_motion(fit, "", {(joint, "viscous"): (change, std)}, 20.0)
        assert found.regression.std("viscous") == pytest.approx(widened)
        assert ("viscous" in found.misfit) == (widened > std)


def test_directions_are_told_apart_only_where_they_are() -> None:
    assert not any(regress_motion(swing(seed)).terms.by_direction for seed in range(3))
    fit = regress_motion(swing(1, uneven=6.0))
    assert fit.terms.by_direction
    assert fit.regression["directions.viscous"] == pytest.approx(6.0, rel=0.1)
    even = regress_motion(swing(1)).regression
    assert change_of(fit.regression, even)[fit.regression.names.index("directions.viscous")] == 0


def test_friction_over_the_angle_is_a_part_where_it_matters() -> None:
    """From 3 % of Coulomb friction on, however well it shows."""
    log = swing(3, noise=0.05)
    wave = np.sign(np.gradient(log.position)) * (log.position - log.position.mean()) / np.ptp(log.position)
    little, much = (regress_motion(replace(log, torque=log.torque + share * F_C * wave)) for share in (0.015, 0.2))
    assert not little.terms.angles
    assert much.terms.angles


def test_ripple_and_a_stribeck_effect_are_parts_where_they_are() -> None:
    log = swing(3)
    v = np.gradient(log.position) * log.rate_hz
    more = 3 * np.cos(2 * np.pi * 40 / (2 * np.pi) * log.position) + 4 * np.sign(v) * np.exp(-((v / 0.15) ** 2))
    plain, fit = (
        regress_motion(replace(log, turn=2 * np.pi / 40)),
        regress_motion(replace(log, torque=log.torque + more, turn=2 * np.pi / 40)),
    )
    assert not {"ripple.1c", "stiction"} & set(plain.regression.names)
    assert fit.regression["ripple.1c"] == pytest.approx(3, abs=0.5)
    assert abs(fit.regression["stiction"] - F_C - 4) < 3 * fit.regression.std("stiction")
    assert abs(fit.regression["coulomb"] - F_C) < 3 * fit.regression.std("coulomb")


@pytest.mark.parametrize(
    "wrong",
    [
        lambda m: replace(m, position=m.position[:200], torque=m.torque[:200]),
        lambda m: replace(m, torque=-m.torque),
        lambda m: replace(m, position=np.abs(np.cumsum(np.abs(m.position)))),
        lambda m: replace(m, rate_hz=50.0),
    ],
    ids=["too short", "turned", "one way", "too slow"],
)
def test_motions_that_tell_nothing_are_refused(wrong) -> None:
    with refused("friction/motion", place="motion of joint 1"):
        regress_motion(wrong(swing()))


@pytest.fixture(scope="module")
def axis() -> MotionFriction:
    data = loadmat(measured(EMPS))
    return regress_motion(Motion("joint 1", 1e3, data["qm"].ravel(), 35.1507 * data["vir"].ravel(), slides=True))


def test_a_real_axis_has_the_published_mass_and_two_slopes(axis: MotionFriction) -> None:
    """Janot, Gautier and Brunot (2019): 95.11 kg, 203.50 N s/m, 20.39 N with both directions alike.

    From all samples; without those near a reversal, where friction is lower, the numbers are others, and the intervals,
    which hold what changes with band and angle, hold the published ones.
    """
    fit = axis.regression
    published = {"inertia": 95.11, "viscous": 203.5, "coulomb": 20.39}
    for name, value in published.items():
        assert abs(fit[name] - value) < 1.96 * fit.std(name), name
    assert fit.std("inertia") < 0.5
    assert axis.terms.by_direction
    assert not axis.misfit
    assert fit["directions.viscous"] == pytest.approx(-37, abs=3)
    assert fit["delay"] == pytest.approx(0.8e-3, abs=0.2e-3)
    assert fit.relative_error < 0.02
    assert sum(axis.seconds.values()) == pytest.approx(24.841)
    assert axis.seconds["used"] > 20
    assert axis.time_summary.startswith(f"{axis.seconds['used']:.3g} of 24.8 s")
    assert all(name in axis.time_summary for name, seconds in axis.seconds.items() if seconds and name != "used")


def test_a_held_command_acts_half_a_sample_later() -> None:
    """The delay that a regression finds where angles were read as a torque began is gone where the log says so."""
    rate, T = 200.0, 1 / 200
    t = np.arange(8000) / rate
    # The mean of a sample is that of its middle.
    (q, *_), (_, v, a) = (three_sines(at, np.random.default_rng(0)) for at in (t, t + T / 2))
    u = J * a + VISCOUS * v + F_C * np.sign(v) + 0.05 * np.random.default_rng(0).standard_normal(len(t))
    read = Motion("joint 1", rate, q, u)
    held = regress_motion(replace(read, torque_delay_s=T / 2)).regression
    assert held["inertia"] == pytest.approx(J, rel=5e-4)
    assert "delay" not in held.names
    assert abs(regress_motion(read).regression["delay"]) == pytest.approx(T / 2, rel=0.1)


def test_delay_of_several_samples_is_noted_and_corrected() -> None:
    """The note states the delay; with this delay, the parameters are correct."""
    t, delay_s = np.arange(8000) / 200, 17e-3
    (q, *_), (_, v, a) = (three_sines(at, np.random.default_rng(0)) for at in (t, t - delay_s))
    u = J * a + VISCOUS * v + F_C * np.sign(v) + 0.05 * np.random.default_rng(0).standard_normal(len(t))
    read = Motion("joint 1", 200.0, q, u)
    wide = regress_motion(read)
    (late,) = (note for note in wide.notes if note.code == "friction/delay")
    assert abs(wide.regression["inertia"] - J) < 2 * wide.regression.std("inertia")
    assert float(late.text.split(" ms late")[0].split()[-1]) == pytest.approx(17, rel=0.1)
    corrected = regress_motion(replace(read, torque_delay_s=-delay_s))
    assert corrected.regression["inertia"] == pytest.approx(J, rel=1e-3)
    assert "friction/delay" not in {note.code for note in corrected.notes}


INERTIA, SLOPE, COULOMB = 12.0, 30.0, 40.0


def with_link(resonance_hz: float, share: float = 0.5) -> Motion:
    """A motor that moves a share of its inertia by a spring; resonance of the link with the motor held.

    Of a link's angle sum a sin(w t) the motor's is sum a (1 - w^2 / w_0^2) sin(w t).
    """
    rng, rate, w_0 = np.random.default_rng(0), 500.0, 2 * np.pi * resonance_hz
    t = np.arange(20_000) / rate
    a, w = np.array([[0.5], [0.15], [0.05]]), np.array([[0.8], [3.1], [7.5]])
    phase, motor = w * t + rng.uniform(0, 6, (3, 1)), 1 - (w / w_0) ** 2
    q, v = (a * motor * np.sin(phase)).sum(axis=0), (a * motor * w * np.cos(phase)).sum(axis=0)
    torque = -INERTIA * (a * w**2 * ((1 - share) * motor + share) * np.sin(phase)).sum(axis=0)
    torque += (COULOMB + SLOPE * np.abs(v)) * np.sign(v) + 0.5 * rng.standard_normal(len(t))
    return Motion("joint 1", rate, np.round(q / 6e-6) * 6e-6, torque)


def test_soft_gear_is_misfit_and_stiff_gear_is_none() -> None:
    """A link at 6 to 15 Hz; one at 1 kHz is rigid, though the noise of its angle is in acceleration and torque."""
    for resonance_hz in (6.0, 15.0):
        fit = regress_motion(with_link(resonance_hz))
        highest = float(re.findall(r"swings below ([0-9.]+) Hz", fit.misfit)[0])
        assert resonance_hz < highest < 1.6 * resonance_hz
        assert abs(fit.regression["inertia"] - INERTIA) < 1.96 * fit.regression.std("inertia")
    fit = regress_motion(with_link(1000.0))
    assert not fit.misfit
    assert abs(fit.regression["inertia"] - INERTIA) < 3 * fit.regression.std("inertia")


@pytest.mark.parametrize(
    ("at_hz", "stiffer", "inertia"), [(10, 1, 1), slow(10, 1.1, 1), slow(10, 1, 0.8), (1000, 1, 1)]
)
def test_spring_of_the_robot_model_is_in_the_regression(at_hz: float, stiffer: float, inertia: float) -> None:
    """A link at 10 Hz, of a model whose stiffness or inertia is off, too, and a rigid one: J in its interval of 2 %."""
    link = 0.5 * INERTIA
    spring = ElasticJoint(0.5 * INERTIA, inertia * link, stiffer * link * (2 * np.pi * 10.0) ** 2, 0.0)
    fit = regress_motion(replace(with_link(at_hz), spring=spring)).regression
    assert abs(fit["inertia"] - INERTIA) < 1.96 * fit.std("inertia") < 0.02 * INERTIA
    assert abs(fit["coulomb"] - COULOMB) < 1.96 * fit.std("coulomb")


RATE = 500.0


def warming(seed: int = 0, slope: float = 0.0, share: float = 0.0) -> Motion:
    """An axis at 25 to 45 degC in 60 s: F_c + slope (T - 35), f (1 + share (e^{-(T - 35) / decay} - 1))."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(60 * RATE)) / RATE
    q, v, acceleration = three_sines(t, rng)
    warmth = 45 - 20 * np.exp(-t / 25)
    theta = warmth - 35
    u = J * acceleration + (F_C + slope * theta) * np.sign(v)
    u = u + VISCOUS * (1 + share * np.expm1(-theta / 20.0)) * v + 0.3 * rng.standard_normal(len(t))
    return Motion("joint 1", RATE, np.round(q / 2e-5) * 2e-5, u, temperature=warmth)


def held(fit: MotionFriction, part: str) -> str:
    return next((each.reason for each in fit.unidentified if each.term == part), "")


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
        assert abs(fit.regression[name] - value) < 3 * fit.regression.std(name), name
    assert not held(fit, "temperature")
    by_heat = fit.to_friction()[0].temperature
    assert by_heat.coulomb == fit.regression["temperature.coulomb"]
    assert by_heat.reference == pytest.approx(T_0)


def test_irrelevant_temperature_is_excluded_with_reason() -> None:
    fits = [regress_motion(warming(seed)) for seed in range(2)]
    fits += [regress_motion(replace(warming(), temperature=none)) for none in (np.full(30000, 25.0), None)]
    assert not any(fit.terms.heat for fit in fits)
    assert [held(fit, "temperature").startswith("the motions show no such effect") for fit in fits] == [True] * 2 + [
        False
    ] * 2


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
    assert "stiction" in fit.regression.names
    assert {"stiction", "stribeck_velocity"}.isdisjoint(identified_names(fit.regression.names, fit.unidentified))
    assert "0.03" in held(fit, "stribeck")
    assert abs(fit.regression["coulomb"] - F_C) < 3 * fit.regression.std("coulomb")
