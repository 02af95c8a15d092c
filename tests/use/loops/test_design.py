"""Designed gains keep their limit everywhere, and no nearby ones are faster."""

from dataclasses import replace
from itertools import islice

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from plants.arm import result
from plants.refusals import refused

from elastid.base.arrays import FloatArray
from elastid.record import Configuration, JointLoop
from elastid.simulation.controller import Filters
from elastid.simulation.spec import ControllerSpec, GainsSpec
from elastid.use.cascade import Cascade
from elastid.use.closed_loops import LIMIT_DB, Closed, Scene
from elastid.use.gain_design import design, design_robust, sensitivity_margin
from elastid.use.loops import design_loops, todays_loops
from elastid.use.plants import Plants, PostureFamily

RATE_HZ = 250.0


def start(family: PostureFamily) -> Cascade:
    plants = family.estimate
    omega = 10.0
    own = Cascade(np.full(2, omega / 4), plants.inertia[0] * omega, np.full(2, 75.0), 1, np.zeros((0, 3)))
    return replace(own, notches=np.array([[14.0, 0.7, 0.6]]), axes=(1,))


def motors(inertia: float | FloatArray) -> Plants:
    J, T = np.atleast_1d(inertia)[:, None], 1 / RATE_HZ
    A, C = (np.broadcast_to(part, (len(J), *np.shape(part))) for part in ([[1.0, T], [0.0, 1.0]], [[1.0, 0.0]]))
    return Plants(RATE_HZ, A, np.array([[T**2 / 2], [T]]) / J[:, :, None], C, J)


@given(inertia=st.floats(0.1, 10.0), delay=st.integers(0, 6))
def test_velocity_loop_is_stable_up_to_delay_gain(inertia: float, delay: int) -> None:
    """K_v T / J < 2 tan(pi / (4 (1 + d))), at which the phase of d + 1 samples and an integrator is 180 degrees."""
    border = 2 * np.tan(np.pi / (4 * (1 + delay))) * inertia * RATE_HZ
    for part in (0.99, 1.01):
        K_v = np.array([part * border])
        loop = Cascade(1e-4 * np.ones(1), K_v, np.ones(1), delay, np.zeros((0, 3)))
        closed = Closed(Scene.of(motors(inertia), 2), loop.gains, Filters(((),), delay))
        assert closed.stable == (part < 1)


def test_slopes_of_peaks_are_exact(family: PostureFamily) -> None:
    scene, own = Scene.of(family.estimate, lines=2000), start(family)
    _, slopes = sensitivity_margin(scene, own, LIMIT_DB)
    for p in range(len(own.vector)):
        step = 1e-4 * np.eye(len(own.vector))[p]
        ahead, behind = (sensitivity_margin(scene, own.at(own.vector + sign * step), LIMIT_DB)[0] for sign in (1, -1))
        np.testing.assert_allclose((ahead - behind) / 2e-4, slopes[:, p], atol=1e-4)


@pytest.mark.slow
def test_motor_gains_are_optimal_for_delay_and_draws(monkeypatch: pytest.MonkeyPatch) -> None:
    """As fast as the fastest of 1271 about it; of 21 inertias one may pass the limit, 5 % faster two do."""
    monkeypatch.setattr("elastid.use.gain_design.MAX_NOTCHES", 0)
    one, draws = motors(3.0), motors(3.0 * np.exp(0.2 * np.random.default_rng(0).standard_normal(21)))
    alone, doubted = (design_robust(one, drawn, 40.0, 1) for drawn in (None, draws))
    gain, ratio = np.meshgrid(np.linspace(0.5, 1.5, 41), np.linspace(0.7, 1.3, 31))
    K_v, K_p = alone.velocity_gain * gain.reshape(-1, 1), alone.position_gain * ratio.reshape(-1, 1)
    about = Closed(Scene.of(motors(np.full(gain.size, 3.0))), JointLoop(K_p * K_v, K_v, K_p), alone.filters(RATE_HZ))
    fastest = about.bandwidth_hz[about.peaks_db <= LIMIT_DB].max()
    assert np.exp(alone.reached(Scene.of(one))) == pytest.approx(fastest, rel=0.01)
    assert np.sum(doubted.on(Scene.of(draws, 400)).peaks_db > LIMIT_DB) <= 1
    assert np.sum(doubted.slower(1.05, 1.05).on(Scene.of(draws, 400)).peaks_db > LIMIT_DB) > 1
    assert design_robust(one, None, 40.0, 3).reached(Scene.of(one)) < alone.reached(Scene.of(one)) - 0.3


@pytest.mark.slow
def test_notches_are_added_while_they_make_a_motor_faster() -> None:
    """By 2 % each and more, all at the limit."""
    scene = Scene.of(motors(3.0), 60)
    found = [*islice(design(scene, 20.0, 1), 3)]
    assert [len(cascade.notches) for cascade in found] == [0, 0, 1]
    assert np.all(np.diff([cascade.reached(scene) for cascade in found]) > 0.02)
    for cascade in found[1:]:
        assert 5.9 < cascade.on(scene).peaks_db[0] <= LIMIT_DB


@pytest.mark.slow
def test_design_reaches_limit_on_postures_and_draws(family: PostureFamily) -> None:
    """Peaks at most 6 dB, those of 95 % of the draws as well; 10 % faster it is broken."""
    found = design_robust(family.estimate, (drawn := family.draws(result(), 40, 1)), 9.0, 1)
    scene, of_draws = Scene.of(family.estimate, lines=800, per_mode=61), Scene.of(drawn, lines=120, per_mode=9)
    assert found.on(scene).peaks_db.max() <= LIMIT_DB + 1e-3
    for cascade, keeps in ((found, True), (found.slower(1.1, 1.05), False)):
        peaks = cascade.on(of_draws).peaks_db.reshape(-1, 2).max(axis=1)
        assert (np.mean(peaks <= LIMIT_DB) >= 0.95) == keeps


def test_todays_loops_keep_their_own_rate(family: PostureFamily, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever the rate of the loops that are designed."""
    spec = ControllerSpec(kind="cascade", gains=GainsSpec(4.5, tuple((8.0 * family.inertia[0]).tolist())))
    monkeypatch.setattr("elastid.use.loops.design_robust", lambda *_: start(family))
    slow = replace(family, rate_hz=100.0)
    loops = design_loops("arm", result(), slow, 1, 0, 1, spec, RATE_HZ)
    assert loops.today.peak_db == pytest.approx(todays_loops(family, None, spec).peak_db)
    assert loops.today.sensitivity_db.max(axis=1) == pytest.approx(loops.today.peak_db)
    assert loops.designed.freq_hz.max() < 50 < loops.today.freq_hz.max()


def test_a_delay_that_leaves_no_gain_is_said() -> None:
    """An arm that stands upright falls over faster than a controller at 4 Hz sees it."""
    upright = PostureFamily.of(result(), [Configuration("up", np.array([-1.5, 0.0]))], 4.0)
    with refused("use/gains"):
        next(design(Scene.of(upright.estimate), 9.0, 3))
