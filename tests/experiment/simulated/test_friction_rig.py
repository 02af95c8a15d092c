"""Motions of a friction study on the simulated rig."""

import math
from dataclasses import replace

import numpy as np
import pytest
from plants.friction_axis import LAW, axis, rig
from plants.refusals import refused

from elastid.experiment.plan.friction import pass_reference
from elastid.experiment.simulated.friction_rig import heating_history
from elastid.experiment.specs.simulated import HeatSpec, NoiseSpec, TorqueRippleSpec
from elastid.friction_study import spec
from elastid.friction_study.constant_velocity import estimate_friction_curve, passes_of
from elastid.friction_study.spec import ConstantVelocitySpec, FrictionSpec, WarmUpSpec
from elastid.robot import TemperatureDependence
from elastid.robot.friction_numbers import friction_numbers

# Six passes from 0.02 to 1.2 rad/s: 20 s of the robot.
PASSES = ConstantVelocitySpec((0.02, 1.2), count=6, spacing="logarithmic", repeat=1)
SHORT = FrictionSpec(rate_hz=500.0, constant_velocity=PASSES)


def test_levels_of_the_rig_are_those_of_the_law() -> None:
    """Within 0.4 % under gravity of three times the friction, ripple of 2 % of it, an offset of 5 %, 16-bit encoder."""
    noise = NoiseSpec(encoder_counts=65536)
    simulated = rig(SHORT, noise=noise, torque_ripple=(TorqueRippleSpec(5e-3, 2),), substeps=4)
    records = [simulated.measure(motion) for motion in simulated.plan.motions]
    limits = simulated.plan.designs[0].limits
    for motion, record in zip(simulated.plan.motions, records, strict=True):
        assert motion.planned is not None
        path = pass_reference(motion.planned, limits, 500.0)
        assert np.abs(record.position - path.position).max() < 0.6 * limits.lag  # friction over the gain is half
        sliding = np.concatenate([path.position[slice(*window)] for window in (path.there, path.back) if window])
        assert record.load_torque == pytest.approx(20 * 9.81 * 0.4 * np.abs(np.sin(sliding)).mean(), rel=0.06)
        assert record.start_s == motion.start_s
    passes = [one for record in records for one in passes_of(replace(record, torque=record.torque + 1.25))]
    found = estimate_friction_curve(passes, True, limits.turn)
    assert found.n_conditions == 8
    exact = 25.0 + 9.0 * np.exp(-((found.speed / 0.08) ** 2)) + 15.0 * found.speed  # Nm, link side
    np.testing.assert_allclose(found.torque, exact, rtol=4e-3)
    assert found.shared["gravity.sin"][0] == pytest.approx(-20 * 9.81 * 0.4, rel=0.02)
    assert not {note for record in records for note in record.notes}
    # In another order, alone: the same bytes.
    again = rig(SHORT, noise=noise, torque_ripple=(TorqueRippleSpec(5e-3, 2),), substeps=4).measure(
        simulated.plan.motions[3]
    )
    np.testing.assert_array_equal(again.torque, records[3].torque)


def test_presliding_loops_stay_stuck_and_act_as_spring() -> None:
    """Small torques bend the bristles by torque over sigma_0; rest records have whole periods without the first."""
    small = FrictionSpec(
        rate_hz=500.0,
        constant_velocity=PASSES,
        presliding_loops=spec.PreslidingLoopsSpec((0.05, 0.8), 4, 1.0),
        presliding_test=spec.PreslidingTestSpec((0.1,), (5, 40)),
    )
    simulated = rig(small, substeps=4)
    loops = simulated.measure(next(m for m in simulated.plan.motions if m.purpose == "presliding_loops"))
    first = slice(0, loops.period_samples)
    secant = np.ptp(loops.torque[first]) / np.ptp(loops.position[first])
    assert secant == pytest.approx(friction_numbers(axis())["s0_m1"][0], rel=0.05)
    assert np.ptp(loops.position) < 1e-3
    motion = next(m for m in simulated.plan.motions if m.purpose == "presliding_test")
    rest = simulated.measure(motion)
    assert rest.start_s == motion.start_s + 1.0
    assert rest.period_samples == 500
    assert len(rest.torque) == 16000
    np.testing.assert_allclose(rest.position[1000:2000], rest.position[2000:3000], atol=2e-3 * np.ptp(rest.position))


WARM = replace(LAW, temperature=TemperatureDependence(20.0, viscous=1.0e-3, decay=15.0))


def test_warm_up_follows_heat_and_lowers_viscous_friction() -> None:
    """T rises towards P / h with C / h, P is the work of the motor; the log has both at each test."""
    heat = HeatSpec(conductance=0.5, time_constant=600.0, ambient=20.0, start=22.0, thermometer_std=0.5)
    spec = FrictionSpec(rate_hz=500.0, constant_velocity=PASSES, warm_up=WarmUpSpec(1.0, time=1800.0, test_every=600.0))
    simulated = rig(spec, axis(law=WARM), heat=heat)
    (log,) = simulated.warm_ups()
    time_s, T, power = heating_history(simulated.plan, axis(law=WARM), heat, "1")
    assert T[0] == 22.0
    fade = np.exp(-np.diff(time_s) / 600.0)
    np.testing.assert_allclose(T[1:], 20.0 + (T[:-1] - 20.0) * fade + power / 0.5 * (1 - fade), rtol=1e-12)
    tests = [motion for motion in simulated.plan.motions if motion.is_warm_up]
    assert np.all(np.isin([round(test.start_s, 6) for test in tests], np.round(log.time_s, 6)))
    assert np.std(log.temperature - np.interp(log.time_s, time_s, T)) == pytest.approx(0.5, rel=0.5)
    fastest = [motion for motion in tests if motion.planned and motion.planned.speed > 1.0]
    cold, warm = (simulated.measure(motion) for motion in (fastest[0], fastest[-1]))
    assert warm.mean_temperature > cold.mean_temperature + 5
    for test, record in zip((fastest[0], fastest[-1]), (cold, warm), strict=True):
        during = (time_s[1:] > test.start_s + 1e-6) & (time_s[1:] < test.start_s + len(record.torque) / 500 + 0.1)
        work = np.sum(record.torque * np.gradient(record.position))
        assert np.sum((power * np.diff(time_s))[during]) == pytest.approx(work, rel=0.01)
        at = record.start_s + np.arange(len(record.torque)) / 500
        assert np.ptp(record.temperature - np.interp(at, time_s, T)) < 1e-9
    levels = estimate_friction_curve([one for record in (cold, warm) for one in passes_of(record)], True)
    theta = levels.temperature - 20.0
    expected = [25.0 + (15.0 + 10.0 * math.expm1(-t / 15.0)) * v for t, v in zip(theta, levels.speed, strict=True)]
    np.testing.assert_allclose(levels.torque, expected, rtol=0.02)
    blind = rig(spec, axis(law=WARM), heat=HeatSpec(conductance=0.5, thermometer_std=None))
    assert blind.measure(tests[0]).temperature is None
    assert np.isnan(blind.warm_ups()[0].temperature).all()
    with refused("experiment/simulated", place="experiment.simulated.heat"):
        rig(spec)
