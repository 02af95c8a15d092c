"""The torque of a multisine divided into rigid body, elasticity and viscous friction of a model."""

from dataclasses import replace

import numpy as np
import pytest

from elastid.frf.spec import EstimatorSpec
from elastid.linear.linear_model import DELAY, LinearModel
from elastid.linear.response.transfer import frequency_response
from elastid.record import Configuration, Record
from elastid.validation.elastic_twin import elastic_balances
from elastid.validation.twin import DRY, ELASTICITY, RIGID_BODY, VISCOUS

RATE_HZ, N = 500.0, 1000
J_MOTOR, J_LINK, K, VISCOUS_COEFFICIENT, DRY_SHARE = 3.0, 6.0, 2e4, 40.0, 0.1


def one_joint(viscous: float) -> LinearModel:
    """A motor and a link on a spring."""
    spring = K * np.array([[1.0, -1.0], [-1.0, 1.0]])
    return LinearModel(
        Configuration("c1", np.zeros(1)), (DELAY,), np.zeros(1), np.diag([J_MOTOR, J_LINK]), np.diag([viscous, 0.0]),
        spring, {}, np.eye(2)[:, :1], np.eye(2)[:1], ("motor 1",), ("motor 1",), "acceleration",
    )  # fmt: skip


def test_parts_of_a_known_joint_have_their_torque() -> None:
    """Rigid: (J_m + J_l) a; viscous: f v; elasticity the rest of the model; dry friction what the net record lacks."""
    whole, frictionless = one_joint(VISCOUS_COEFFICIENT), one_joint(0.0)
    alone = replace(
        whole, M=np.array([[J_MOTOR + J_LINK]]), D=np.zeros((1, 1)), K=np.zeros((1, 1)), B=np.eye(1), C=np.eye(1),
        T=None, Z=None,
    )  # fmt: skip
    lines = np.arange(4, 61)
    freq_hz = lines * RATE_HZ / N
    rng = np.random.default_rng(0)
    U = np.exp(2j * np.pi * rng.uniform(size=len(lines)))
    Y = frequency_response(whole, np.zeros(1), freq_hz)[:, 0, 0] * U

    def periods(X):
        spectrum = np.zeros(N // 2 + 1, dtype=complex)
        spectrum[lines] = X * N / 2
        return np.tile(np.fft.irfft(spectrum, n=N), 3)[:, None]

    net = Record("r", whole.configuration, 0, 0, RATE_HZ, N, ("motor 1",), ("motor 1",), ("acceleration",),
                 periods(U), periods(Y))  # fmt: skip
    record = replace(net, u=(1 + DRY_SHARE) * net.u)
    theta = np.zeros(1)
    parts = (whole, theta), (frictionless, theta), (alone, theta)
    (found,) = elastic_balances(record, net, parts, freq_hz, EstimatorSpec(transient_periods=1))
    assert found.parts == (RIGID_BODY, ELASTICITY, VISCOUS, DRY)
    velocity = Y / (2j * np.pi * freq_hz)
    np.testing.assert_allclose(found.torques[0], (J_MOTOR + J_LINK) * periods(Y)[:N, 0], atol=1e-9)
    np.testing.assert_allclose(found.torques[2], VISCOUS_COEFFICIENT * periods(velocity)[:N, 0], atol=1e-9)
    np.testing.assert_allclose(found.torques[3], DRY_SHARE * net.u[:N, 0], atol=1e-9)
    assert sum(found.shares) == pytest.approx(1.0)
    assert found.left == pytest.approx(0.0, abs=1e-12)
    assert elastic_balances(record, net, parts, freq_hz, EstimatorSpec(transient_periods=2)) == ()
