"""Presliding friction: bristles from responses at rest, Maxwell slip elements from loops."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import casadi as ca
import numpy as np
import pytest
from plants import lugre_joint as plant
from plants.lugre_joint import moved, multisine
from plants.refusals import refused

from elastid.base.arrays import FloatArray
from elastid.friction_study.presliding import (
    AtRest,
    Elements,
    RestResponse,
    fit_at_rest,
    fit_presliding,
    rest_responses,
)
from elastid.model.formulation import ElasticJoint
from elastid.record import FrictionRecord

JOINT = ElasticJoint(plant.MOTOR, plant.LINK, plant.STIFFNESS, plant.DAMPING)
RATE, PERIOD, COUNT = plant.RATE_HZ, plant.PERIOD, plant.COUNT


def record(name: str, peak: float, seed: int, noise: float, count: float) -> FrictionRecord:
    """From rest, torque held from sample to sample, with noise that is not logged."""
    rng = np.random.default_rng(seed)
    u = multisine(peak, rng)
    q = moved(u + noise * rng.standard_normal(len(u)))
    return FrictionRecord(
        name, "1", "at_rest", RATE, np.round(q / count) * count if count else q, u, resolution=count,
        period_samples=PERIOD, hold="zero-order",
    )  # fmt: skip


def measured(peaks: Sequence[float], seed: int, noise: float = 0.0, count: float = 0.0) -> list[FrictionRecord]:
    return [
        record(f"{peak} {r}", peak, 100 * seed + 10 * i + r, noise, count)
        for i, peak in enumerate(peaks)
        for r in range(2)
    ]


def errors(found: AtRest) -> tuple[float, float]:
    return found.sigma_0 / plant.SIGMA_0 - 1, found.sigma_1 / plant.SIGMA_1 - 1


def test_sigma_0_to_four_thousandths_at_a_tenth_of_break_away() -> None:
    """At half of it and at it, the link on its spring known."""
    found = fit_at_rest("joint 1", rest_responses(measured((0.075, 0.15), 1)), JOINT, (plant.VISCOUS, 0.0))
    sigma_0, sigma_1 = errors(found)
    assert abs(sigma_0) < 0.002
    assert abs(sigma_1) < 0.01
    assert not found.notes


@pytest.mark.parametrize("inertias", [(1.0, 1.0), (1.05, 0.875)])
@pytest.mark.parametrize("factor", [0.8, 1.0, 1.2])
def test_noise_and_counts_leave_the_numbers_inside_their_intervals(
    inertias: tuple[float, float], factor: float
) -> None:
    """16 bit, torque noise of a seventh of the torque, a spring of the file that is off, or inertias as well."""
    of_motor, of_link = inertias
    joint = ElasticJoint(of_motor * plant.MOTOR, of_link * plant.LINK, factor * plant.STIFFNESS, plant.DAMPING)
    found = fit_at_rest("joint 1", noisy_responses(), joint, (plant.VISCOUS, 0.0))
    std = np.sqrt(np.diag(found.covariance)) / [plant.SIGMA_0, plant.SIGMA_1]
    assert np.all(np.abs(errors(found)) < 3 * std)
    assert std[0] < 0.008


@cache
def noisy_responses() -> tuple[RestResponse, ...]:
    return rest_responses(measured((0.15, 0.3), 2, 0.02, COUNT))


def rigid(peak: float, seed: int, thresholds: FloatArray, stiffness: FloatArray, inertia: float) -> FrictionRecord:
    """A rigid joint on stop operators and 0.5 Nms/rad, by small steps."""
    s, v, q, u = ca.SX.sym("s", len(thresholds)), ca.SX.sym("v"), ca.SX.sym("q"), ca.SX.sym("u")
    state = ca.vertcat(q, v, s)
    h = 1 / RATE / 4
    for _ in range(4):
        half, held = state[0] + state[1] * h / 2, state[2:] + state[1] * h / 2
        held = ca.fmax(-thresholds, ca.fmin(thresholds, held))
        v_next = state[1] + (u - ca.dot(ca.DM(stiffness), held) - 0.5 * state[1]) * h / inertia
        held = ca.fmax(-thresholds, ca.fmin(thresholds, held + v_next * h / 2))
        state = ca.vertcat(half + v_next * h / 2, v_next, held)
    step = ca.Function("step", [ca.vertcat(q, v, s), u], [state])
    torque = multisine(peak, np.random.default_rng(seed))
    states = step.mapaccum("walk", len(torque))(np.zeros(2 + len(thresholds)), torque[None]).full()
    return FrictionRecord(
        f"{peak} {seed}", "1", "at_rest", RATE, np.append(0.0, states[0, :-1]), torque, period_samples=PERIOD,
        hold="zero-order",
    )  # fmt: skip


def test_bristles_of_a_rigid_joint_are_found_with_its_inertia() -> None:
    """One element that never slips."""
    records = [rigid(peak, r, np.array([1.0]), np.array([300.0]), 0.03) for peak in (0.05, 0.1) for r in range(2)]
    found = fit_at_rest("joint 1", rest_responses(records))
    assert found.sigma_0 == pytest.approx(300, rel=3e-3)
    assert found.sigma_1 == pytest.approx(0.5, rel=0.02)


RATE_PRESLIDING, COUNT_PRESLIDING = 200.0, 2 * np.pi / 2**16
# Ten elements, 790 Nm/rad, break-away 1.6 Nm.
THRESHOLDS = np.geomspace(6e-4, 8e-3, 10)
STIFFNESS = 1.6 / 10 / THRESHOLDS * 790 / np.sum(1.6 / 10 / THRESHOLDS)
TRUTH_PRESLIDING = Elements(STIFFNESS, THRESHOLDS * 1.6 / float(STIFFNESS @ THRESHOLDS), 0.0)
REACH = 0.012


def growing(seconds: float = 40.0) -> FloatArray:
    """Loops of 0.5 Hz that grow from 2 to 100 % of the reach."""
    t = np.arange(round(seconds * RATE_PRESLIDING)) / RATE_PRESLIDING
    return np.asarray(REACH * np.clip(0.02 + 0.98 * t / seconds, 0, 1) * np.sin(2 * np.pi * 0.5 * t))


def minor_loops() -> FloatArray:
    """Loops in loops, not seen by the fit."""
    t = np.arange(round(20 * RATE_PRESLIDING)) / RATE_PRESLIDING
    return np.asarray(REACH * (0.55 * np.sin(2 * np.pi * 0.3 * t) + 0.25 * np.sin(2 * np.pi * 1.1 * t + 1)))


def loops(q: FloatArray, torque: FloatArray, counts: float = 0.0) -> FrictionRecord:
    return FrictionRecord("loops", "1", "loops", RATE_PRESLIDING, q, torque, resolution=counts)


def log(seed: int, counts: float = COUNT_PRESLIDING) -> FrictionRecord:
    """Measured with torque noise and an encoder."""
    q = growing()
    torque = TRUTH_PRESLIDING.torque(q) + 0.1 + 0.02 * np.random.default_rng(seed).standard_normal(len(q))
    return loops(np.round(q / counts) * counts, torque, counts)


def error(found: Elements) -> float:
    """Rms on the unseen loops, in parts of break-away, after the first half loop."""
    q = minor_loops()
    missed = found.torque(q) - found.offset - TRUTH_PRESLIDING.torque(q)
    return float(np.sqrt(np.mean(missed[400:] ** 2))) / 1.6


@pytest.mark.slow
def test_few_elements_are_chosen_and_nearly_as_good() -> None:
    found = fit_presliding(log(1), 0.5)
    assert 3 <= np.sum(found.stiffness > 0) <= 8
    assert error(found) < 0.025
    assert error(fit_presliding(log(1), 0.5, elements=1)) > 3 * error(found)
    assert found.offset == pytest.approx(0.1, abs=0.01)


def test_one_bristle_is_one_element() -> None:
    """A single stop operator: thresholds elsewhere get nothing, and one element is enough."""
    one = Elements(np.array([300.0]), np.array([4e-3]), 0.0)
    q = growing()
    torque = one.torque(q) + 0.01 * np.random.default_rng(0).standard_normal(len(q))
    found = fit_presliding(loops(q, torque), 0.5)
    assert len(found.stiffness) == 1
    assert found.stiffness[0] == pytest.approx(300, rel=0.01)
    assert found.threshold[0] == pytest.approx(4e-3, rel=0.01)


def test_the_robot_file_has_the_same_shares_and_stiffness() -> None:
    slip = TRUTH_PRESLIDING.to_maxwell_slip()
    assert sum(slip.shares) == pytest.approx(1.0)
    assert sum(slip.stiffness) == pytest.approx(float(STIFFNESS.sum()))
    levels = np.array(slip.shares) * 1.6 / np.array(slip.stiffness)
    np.testing.assert_allclose(levels, TRUTH_PRESLIDING.threshold)


def test_loops_of_a_few_counts_are_refused() -> None:
    with refused("friction/presliding", place="loops of joint 1"):
        fit_presliding(replace(log(0), resolution=5e-3), None)
