"""A filter follows friction that warms up, through stops, with bands that hold it."""

import re
from dataclasses import replace

import numpy as np
import pytest
from plants import arm
from plants.lugre_joint import COUNT, FOLLOWED, RATE_HZ, TORQUE_STD, WarmRun, rich, simulate
from plants.refusals import refused

from elastid.base.arrays import FloatArray
from elastid.friction_record import FrictionRecord
from elastid.friction_study import extended_kalman_filter
from elastid.friction_study.constant_velocity import FrictionCurve
from elastid.friction_study.extended_kalman_filter import (
    FilterNoise,
    JointSamples,
    KalmanFilter,
    Track,
    TrackedJoint,
    estimate_noise,
)
from elastid.friction_study.filter_consistency import MAX_CORRELATION, consistency
from elastid.friction_study.friction_tracking import TrackedFriction, track_friction, track_joints, with_tolerances
from elastid.friction_study.result import JointFriction
from elastid.friction_study.spec import FilterSpec
from elastid.robot import Friction


def stops_and_moves(seconds: float) -> FloatArray:
    """Pick and place: moves there and back of 60 rad/s, between stops of two seconds."""
    move = np.concatenate([np.linspace(0, 60, 300), np.full(400, 60.0), np.linspace(60, 0, 300), np.zeros(2000)])
    return np.resize(np.concatenate([move, -move]), int(seconds * RATE_HZ))


DRIFT = {"Fc": 6e-3, "f": 25e-3, "offset": 1e-3}
NOISE = FilterNoise(angle=COUNT / np.sqrt(12), torque=TORQUE_STD, drift=DRIFT)
SETTLED_S = 10.0


@pytest.fixture(scope="module")
def kalman() -> KalmanFilter:
    return KalmanFilter(FOLLOWED, RATE_HZ)


def tracked(kalman: KalmanFilter, run: WarmRun, noise: FilterNoise = NOISE) -> Track:
    return kalman.run([run.samples], noise)


def nees(track: Track, name: str, truth: FloatArray) -> float:
    """Mean squared error of a logarithm over its variance, after settling."""
    i = track.joint.followed.index(name)
    return float(np.mean((((track.x[:, i] - np.log(truth)) / track.std[:, i]) ** 2)[round(SETTLED_S * RATE_HZ) :]))


@pytest.mark.slow
def test_friction_that_warms_up_is_followed_through_stops(kalman: KalmanFilter) -> None:
    """Torque within 0.4 %, NEES at most 1.2, NIS 0.9 to 1.1."""
    run = simulate(stops_and_moves(25), seed=1)
    track = tracked(kalman, run)
    judged = consistency(track, SETTLED_S)
    moves = (np.abs(run.velocity) > 5) & (np.arange(len(run.velocity)) > SETTLED_S * RATE_HZ)
    true = (run.coulomb * np.sign(run.velocity) + run.viscous * run.velocity)[moves]
    found = (track.values("Fc") * np.sign(run.velocity) + track.values("f") * run.velocity)[moves]
    assert np.mean((found - true) ** 2) < 0.004**2 * np.mean(true**2)
    assert nees(track, "Fc", run.coulomb) < 1.2
    assert nees(track, "f", run.viscous) < 1.2
    assert 0.9 < judged.nis < 1.1
    assert abs(judged.autocorrelation[1]) < MAX_CORRELATION


@pytest.mark.slow
def test_a_bristle_taken_for_certain_is_seen() -> None:
    """Without the slip's noise a filter that is sure of all else is many std off: its innovations say so."""
    run, sure = simulate(stops_and_moves(20), seed=1), KalmanFilter(replace(FOLLOWED, tolerances={}), RATE_HZ)
    track = tracked(sure, run, FilterNoise(angle=NOISE.angle, torque=NOISE.torque, drift=DRIFT, slip=0.0))
    judged = consistency(track, SETTLED_S)
    assert nees(track, "Fc", run.coulomb) > 5
    assert judged.nis > 1.5
    assert judged.doubts


@pytest.mark.slow
def test_noise_is_found_from_innovations() -> None:
    """Torque noise within 10 % from a guess of a third; a bristle that is LuGre's slips no more than guessed."""
    kalman = KalmanFilter(FOLLOWED, RATE_HZ)
    run = simulate(rich(5), seed=5)
    found, _ = estimate_noise(kalman, run.samples, replace(NOISE, torque=NOISE.torque / 3), settled_s=2.0)
    assert found.torque == pytest.approx(TORQUE_STD, rel=0.1)
    assert found.slip == pytest.approx(NOISE.slip)


def test_correlated_torque_noise_keeps_its_variance() -> None:
    """w_k+1 = a w_k + e_k, a = exp(-T / tau), has std sigma where var e = sigma^2 (1 - a^2)."""
    joint, noise = replace(FOLLOWED, correlation_s=0.02), replace(NOISE, correlated_torque=0.3)
    driving = noise.vector(joint, RATE_HZ)[2]
    assert driving / (1 - np.exp(-1 / (RATE_HZ * 0.02)) ** 2) == pytest.approx(0.3**2)


def followed(run: WarmRun, joint: TrackedJoint = FOLLOWED) -> TrackedFriction:
    """A run, judged after 5 s."""
    return track_friction("1", False, [joint], [run.samples], RATE_HZ, NOISE, 5.0, find_noise=False)


def codes(found: TrackedFriction) -> set[str]:
    return {note.code for note in found.notes}


def test_constant_speed_says_what_it_cannot_know() -> None:
    """Coulomb friction and an offset are distinguished by reversals."""
    constant = followed(simulate(np.concatenate([np.linspace(0, 40, 500), np.full(6500, 40.0)]), 4))
    assert "filter/not-observable" in codes(constant)
    assert not {"filter/not-observable", "filter/inconsistent"} & codes(followed(simulate(rich(7), 4)))


@pytest.mark.parametrize(("viscous", "noise"), [(1e3, 1.0), (1.0, 20.0)])
def test_filter_that_lost_the_log_diverges_at_a_time(viscous: float, noise: float) -> None:
    """Viscous friction a thousand times too large at the start, noise of 20 times."""
    joint = replace(FOLLOWED, viscous=viscous * FOLLOWED.viscous)
    expected = replace(NOISE, angle=noise * NOISE.angle, torque=noise * NOISE.torque)
    lost = track_friction("1", False, [joint], [simulate(rich(7), 4).samples], RATE_HZ, expected, 5.0, find_noise=False)
    assert codes(lost) == {"filter/diverged"}
    assert 5.0 <= float(re.findall(r"^at (\S+) s:", lost.consistency.divergence)[0]) <= 7.0


def test_filter_in_blocks_continues_its_estimate(monkeypatch: pytest.MonkeyPatch, kalman: KalmanFilter) -> None:
    """Blocks of a fifth of a second bound the memory and change no number."""
    run = simulate(rich(0.5), 4)
    whole = tracked(kalman, run)
    monkeypatch.setattr(extended_kalman_filter, "_BLOCK", 200)
    parts = tracked(KalmanFilter(kalman.joint, kalman.rate_hz), run)
    np.testing.assert_array_equal(np.hstack([parts.x, parts.std]), np.hstack([whole.x, whole.std]))


@pytest.mark.slow
def test_filter_noise_is_estimated_from_longest_motion() -> None:
    """Another motion of half a second, 1 rad away, changes nothing of the noise that is found."""
    run = simulate(rich(1.5), 5).samples
    short = JointSamples(run.torque[:500], run.load[:500], run.angle[:500] + 1.0)
    alone, after = (
        track_friction(
            "1", False, [FOLLOWED], motions, RATE_HZ, replace(NOISE, torque=NOISE.torque / 3), 0.5, find_noise=True
        )
        for motions in ([run], [short, replace(run, start_s=1.0)])
    )
    assert after.noise == alone.noise


def test_a_band_holds_stiction_that_falls_with_warmth() -> None:
    """F_s / F_c of 1.30 for the 1.40 that the filter holds: its band has F_c, that of a filter that is sure has not."""
    run = simulate(stops_and_moves(14), 1, stiction_ratio=1.3)
    held = {}
    for name, joint in {"held": FOLLOWED, "exact": replace(FOLLOWED, tolerances={})}.items():
        found = followed(run, joint)
        i = np.minimum(np.rint(found.time_s * RATE_HZ).astype(int), len(run.coulomb)) - 1
        inside = (found.low[:, 0] < run.coulomb[i]) & (run.coulomb[i] < found.high[:, 0])
        held[name] = float(np.mean(inside[found.time_s > 5]))
    assert held["held"] > 0.95
    assert held["exact"] < 0.5


def test_what_a_study_has_identified_narrows_the_bands() -> None:
    """Inertia to 0.5 % and gravity to 1 % of a rigid joint."""
    one = np.ones(1)
    levels = FrictionCurve("motor 1", one, 0 * one, one, 0.01 * one, 0 * one, 0 * one)
    shared = {"inertia": (2.0, 0.01), "gravity.cos": (3.0, 0.03), "gravity.sin": (4.0, 0.04)}
    identified = JointFriction("1", False, constant_velocity=replace(levels, shared=shared))
    rigid = TrackedJoint(motor_inertia=2.0, coulomb=1.0, viscous=0.1, bristle_stiffness=100.0)
    known = with_tolerances(rigid, identified).tolerances
    assert known["inertia"] == pytest.approx(0.005)
    assert known["gravity"] == pytest.approx(0.01)
    useless = JointFriction("1", False, constant_velocity=replace(levels, shared={"inertia": (2.0, 4.0)}))
    assert with_tolerances(rigid, useless).tolerances["inertia"] == 0.5


@pytest.mark.parametrize("late", [0, 4])  # samples
def test_friction_is_tracked_only_where_joint_moves_alone(late: int) -> None:
    """Beside the inertia and gravity that the study found; a joint that never moves alone has a note, or is refused."""
    rng, t = np.random.default_rng(0), np.arange(3000) / 200.0
    waves = [(0.6, 1.9, 0.0), (0.3, 4.3, 1.0)]
    q, v, a = (sum(A * w**k * np.sin(w * t + p + k * np.pi / 2) for A, w, p in waves) for k in range(3))
    torque = 2.0 * a + 5.0 * np.sign(v) + 3.0 * v + 4.0 * np.cos(q) - 1.5 * np.sin(q) + 0.5
    torque += 0.05 * rng.standard_normal(len(t))
    record = FrictionRecord("alone", "1", "motion", 200.0, np.roll(q, late), torque, torque_delay_s=late / 200)
    both = [replace(record, name="both", joint=joint) for joint in "12"]
    shared = {"inertia": (2.0, 0.01), "gravity.cos": (4.0, 0.04), "gravity.sin": (-1.5, 0.02), "offset": (0.5, 0.01)}
    one = np.ones(1)
    levels = FrictionCurve("joint 1", one, 0 * one, one, 0.01 * one, 0 * one, 0 * one, shared=shared)
    first = JointFriction("1", False, constant_velocity=levels, friction=Friction(6.0), viscous=2.5)
    second, spec = replace(first, joint="2"), FilterSpec(drift=2.0, torque_std=0.1, settle=3.0)
    (found,), (note,) = track_joints(arm.robot(damping=None), [first, second], [record, *both], spec)
    coulomb, viscous, offset = found.values[-1]
    assert (coulomb + 1.2 * viscous, offset) == pytest.approx((5 + 1.2 * 3, 0.0), abs=0.1)
    assert np.all((found.low[-1] < [5.0, 3.0, 0.0]) & (found.high[-1] > [5.0, 3.0, 0.0]))
    assert note.code == "filter/record"
    with refused("filter/start"):
        track_joints(arm.robot(damping=None), [second], both, spec)


@pytest.mark.parametrize("joint", [FOLLOWED, replace(FOLLOWED, stiffness=0.0)])
def test_momentum_grows_by_the_torques_that_act(joint: TrackedJoint) -> None:
    """Of motor and link on their spring, or of a rigid joint, under drive, load, its offset and all but no friction."""
    free = {"coulomb": 1e-12, "viscous": 1e-12, "bristle_stiffness": 1e-12, "bristle_damping": 0.0}
    frictionless = replace(joint, followed=("offset",), **free)
    values = {"q_m": 0.1, "q_l": -0.2, "v_m": 3.0, "v_l": -1.0, "z": 0.0, "offset": 0.2}
    x = np.array([values[name] for name in frictionless.states])
    after = frictionless.step(RATE_HZ)(x, np.zeros(len(frictionless.consider_parameters)), 2.0, 0.7).full()[:, 0]
    inertias = {"v_m": joint.motor_inertia, "v_l": joint.link_inertia if joint.stiffness else 0.0}
    momentum = np.array([inertias.get(name, 0.0) for name in frictionless.states])
    assert (after - x) @ momentum == pytest.approx((2.0 - 0.7 - 0.2) / RATE_HZ, rel=1e-6)
