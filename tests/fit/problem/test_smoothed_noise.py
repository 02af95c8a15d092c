"""Covariances of single lines from few degrees of freedom become weights that are nearly those of the true one."""

from dataclasses import replace

import numpy as np
import pytest
from plants.three_mass import FREQ, circular, plant

from elastid.fit.problem.smoothed_noise import smooth_noise
from elastid.fit.problem.weights import weigh
from elastid.fit.spec import FitSpec, WeightSpec
from elastid.linear.response.transfer import frequency_response
from elastid.response import Covariance, Response

MODEL = plant((0, 2), (0, 2))
G = frequency_response(MODEL, MODEL.theta_ref, FREQ)
LEVEL = np.median(np.abs(G)) ** 2
# Half on the outputs, half from torques at the inputs; and a disturbance at a place that is no input.
OUTPUTS = LEVEL * np.eye(2) * np.ones((len(FREQ), 1, 1)) + 0j
TORQUE = 0.3 * G @ G.conj().transpose(0, 2, 1)


def sampled(rng, C, dof):
    z = np.linalg.cholesky(C) @ circular(rng, (*C.shape[:2], int(dof)))
    return z @ z.conj().transpose(0, 2, 1) / dof


def response(rng, C, dof) -> Response:
    """A response with noise C of every column, whose covariance was estimated from so many degrees of freedom."""
    right, left = sampled(rng, C, dof), np.broadcast_to(np.eye(2), G.shape)
    known = Covariance(np.einsum("faa->fa", right).real[:, :, None] * np.ones((1, 1, 2)), dof, left, right)
    noisy = G + 0.01 * np.linalg.cholesky(C) @ circular(rng, G.shape)
    return Response(FREQ, noisy, MODEL.inputs, MODEL.outputs, "velocity", MODEL.configuration, noise=known)


def loss(found, C):
    """tr(C~^-1 C) - ln det(C~^-1 C) - n, mean over the lines: 0 for the true covariance."""
    values = np.linalg.eigvals(np.linalg.solve(found, C)).real
    return float(np.mean(np.sum(values - np.log(values) - 1, axis=1)))


@pytest.mark.parametrize("C", [OUTPUTS, OUTPUTS + TORQUE, 0.01 * OUTPUTS + TORQUE])
@pytest.mark.parametrize("dof", [2, 6])
def test_noise_of_outputs_and_torques_is_known_from_two_degrees_of_freedom_a_line(C, dof):
    """The loss is that of 60 and more degrees of freedom of each line (n^2 / (2 dof) each), weights are unbiased."""
    rng = np.random.default_rng(0)
    found = [smooth_noise(response(rng, C, dof)).covariance[:, :2, :2] for _ in range(10)]
    assert np.mean([loss(one, C) for one in found]) < 4 / (2 * 60) + 0.02
    power = np.mean([np.einsum("fab,fba->f", np.linalg.inv(one), C).real.mean() / 2 for one in found])
    assert power == pytest.approx(1.0, abs=0.03)


def test_a_line_that_is_really_noisier_keeps_its_own_level():
    """Mains, 100 times as noisy on one line: it counts for little, its neighbours as before."""
    rng, C = np.random.default_rng(2), (OUTPUTS + TORQUE).copy()
    C[80] *= 100
    found = smooth_noise(response(rng, C, 4)).covariance[:, :2, :2]
    power = np.einsum("fab,fba->f", np.linalg.inv(found), C).real / 2
    assert power[80] < 4
    assert np.all(power[np.r_[76:80, 81:85]] < 2)
    assert np.all(power[np.r_[76:80, 81:85]] > 0.5)


def test_the_measured_covariance_is_corrected_for_its_part_in_its_own_weight():
    """E[tr(C~^-1 S)] as corrected is that of errors that the weights have not seen, with a floor or without."""
    rng, C = np.random.default_rng(3), OUTPUTS + TORQUE
    for floor in (0.0, 0.3):
        seen, unseen = 0.0, 0.0
        for _ in range(30):
            one = response(rng, C, 2)
            weights = weigh(one, FitSpec(weights=WeightSpec(floor=floor)))
            S = weights.noise_covariance()
            power = np.swapaxes(floor * np.abs(one.G), 1, 2).reshape(-1, 4, 1) ** 2
            total = weights.correlated.full() + power * np.eye(4)
            W = np.linalg.inv(total)
            seen += np.einsum("fab,fba->", W, S).real
            truth = np.einsum("ab,fcd->facbd", np.eye(2), C).reshape(-1, 4, 4)
            unseen += np.einsum("fab,fba->", W, truth).real
        assert seen / unseen == pytest.approx(1.0, abs=0.015)


def test_exact_data_have_a_smooth_covariance_too():
    """A variance of zero everywhere is no division by zero."""
    one = response(np.random.default_rng(4), OUTPUTS, 2)
    right = np.zeros_like(one.noise.right)
    known = replace(one.noise, right=right, variance=np.zeros(G.shape))
    assert np.all(np.isfinite(smooth_noise(replace(one, noise=known)).variance))
    known = replace(known, right=right[:, :1, :1], left=known.left[:, :1, :1], variance=np.zeros((len(G), 1, 1)))
    alone = replace(one, G=one.G[:, :1, :1], outputs=one.outputs[:1], inputs=one.inputs[:1], noise=known)
    assert np.all(smooth_noise(alone).variance > 0)
