"""Stiffness and damping of bristles from responses at rest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import casadi as ca
import numpy as np
import pytest
from plants.lugre_joint import COUNT, JOINT, RATE, TRUTH, angle

from elastid.base.arrays import FloatArray
from elastid.friction.dynamic import Bristle
from elastid.friction.static import Curve
from elastid.friction_study.presliding import AtRest, RestResponse, fit_at_rest, rest_responses
from elastid.model.formulation import ElasticJoint
from elastid.record import FrictionRecord

PERIOD, LINES = 2000, np.arange(10, 161)


def multisine(peak: float, rng: np.random.Generator) -> FloatArray:
    """One period of 5 to 80 Hz."""
    spectrum = np.zeros(PERIOD // 2 + 1, complex)
    spectrum[LINES] = np.exp(2j * np.pi * rng.random(len(LINES)))
    u = np.fft.irfft(spectrum, PERIOD)
    return np.asarray(u * peak / np.abs(u).max())


def record(name: str, peak: float, seed: int, noise: float, count: float, periods: int = 6) -> FrictionRecord:
    """From rest, torque held from sample to sample, with noise that is not logged."""
    rng = np.random.default_rng(seed)
    u = np.tile(multisine(peak, rng), periods)
    q = angle(u + noise * rng.standard_normal(len(u)), 2)
    q = np.append(0.0, q[:-1])
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
    return found.sigma_0 / 300 - 1, found.sigma_1 / 0.5 - 1


def test_sigma_0_to_four_thousandths_at_a_tenth_of_break_away() -> None:
    """At half of it and at it, the link on its spring known."""
    found = fit_at_rest("joint 1", rest_responses(measured((0.075, 0.15), 1)), JOINT, (TRUTH["viscous"], 0.0))
    sigma_0, sigma_1 = errors(found)
    assert abs(sigma_0) < 0.002
    assert abs(sigma_1) < 0.01
    assert not found.notes


@pytest.mark.parametrize("of_file", [JOINT, replace(JOINT, link_inertia=0.0175, motor_inertia=0.0105)])
@pytest.mark.parametrize("stiffness", [640.0, 800.0, 960.0])
def test_noise_and_counts_leave_the_numbers_inside_their_intervals(of_file: ElasticJoint, stiffness: float) -> None:
    """16 bit, torque noise of a seventh of the torque, a spring of the file that is off, or inertias as well."""
    joint = replace(of_file, stiffness=stiffness)
    found = fit_at_rest("joint 1", noisy_responses(), joint, (TRUTH["viscous"], 0.0))
    std = np.sqrt(np.diag(found.covariance)) / [300, 0.5]
    assert np.all(np.abs(errors(found)) < 3 * std)
    assert std[0] < 0.006


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
    torque = np.tile(multisine(peak, np.random.default_rng(seed)), 6)
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


def test_the_slip_of_a_gaussian_motion_is_a_relaxation() -> None:
    """Bristles under a prescribed multisine, against rho of the expansion; a sine has 4 A / (3 pi z_s)."""
    n, z_s = 8000, 1.0
    lines, rng = np.arange(10, 160, 2), np.random.default_rng(0)
    v, z = ca.SX.sym("v"), ca.SX.sym("z")
    step = ca.Function("step", [z, v], [Bristle(1.0).advanced(v, z, Curve(z_s, z_s, 0.0), 1.0)])
    loss, expected = [], []
    for _ in range(6):
        spectrum = np.zeros(n // 2 + 1, complex)
        spectrum[lines] = np.exp(2j * np.pi * rng.random(len(lines)))
        q = np.fft.irfft(spectrum, n)
        q *= 0.05 / q.std()
        dq = np.diff(np.tile(q, 3), append=q[0])
        bend = np.append(0.0, step.mapaccum("walk", 3 * n)(0.0, dq[None]).full()[0, :-1])[-n:]
        ratio = np.fft.rfft(bend)[lines] / np.fft.rfft(q)[lines]
        loss.append(ratio.imag * 2 * np.pi * lines / n)
        expected.append(np.sqrt(2 / np.pi) * dq.std() / z_s)
    assert np.mean(loss) == pytest.approx(float(np.mean(expected)), rel=0.04)
    A = 0.03
    dq = np.diff(A * np.sin(2 * np.pi * np.arange(40 * 400 + 1) / 400))
    bend = np.append(0.0, step.mapaccum("walk", len(dq))(0.0, dq[None]).full()[0, :-1])[-400:]
    sine = np.fft.rfft(bend)[1] / np.fft.rfft(A * np.sin(2 * np.pi * np.arange(400) / 400))[1]
    assert sine.imag == pytest.approx(4 * A / (3 * np.pi), rel=0.02)
    assert 1 - sine.real == pytest.approx(3 / 8 * A**2, rel=0.3)
