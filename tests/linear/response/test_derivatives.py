"""Derivatives as few columns against those of the kernel, and their sums against the sums of the columns."""

from dataclasses import replace

import numpy as np
import pytest
from plants.oblique_arm import arm, linear
from plants.two_mass import circular

from elastid.linear.response.derivatives import Columns
from elastid.linear.response.kernel import Kernel
from elastid.robot import Chain, ChannelGain


@pytest.mark.parametrize("gravity", [0.0, -9.81])
@pytest.mark.parametrize("gains", [(), (ChannelGain("u", "motor 1", 0.9), ChannelGain("y", "motor 2", 1.2))])
@pytest.mark.parametrize("outputs", [None, ("motor 2", "body fore z")])
def test_columns_are_the_derivatives_of_the_kernel(outputs, gains, gravity) -> None:
    """-dG_p = sum of s^k sigma U_b of all parameters at once, element by element; `pull` sums them over lines."""
    robot = replace(arm((0.0, 0.0, gravity)), chain=Chain(gains=gains, sensor_lag=1e-4))
    model = linear(robot, outputs=outputs)
    rng, theta = np.random.default_rng(0), model.theta_ref.copy()
    theta[-1] = 1e-4
    kernel = Kernel(model, np.geomspace(0.5, 90, 40), model.parameters)
    columns, (G, dG) = Columns(kernel), kernel.evaluate(theta)
    assert columns.is_symmetric == (outputs is None and not gains)
    pieces = columns.pieces
    for part in columns.at(theta):
        at = (part.block, part.outputs, part.inputs)
        np.testing.assert_allclose(part.G, G[at], rtol=1e-10)
        n_b = len(part.sign) + part.S.shape[1] + part.whole.shape[2]
        U = part.columns(np.ones(n_b), np.float64)
        powers = part.s[:, None] ** pieces.power
        found = -np.einsum("ft,tp,fet->pfe", powers, pieces.sigma, U[:, :, pieces.base])
        for p, name in enumerate(kernel.wanted):
            expected = dG[p][at]
            np.testing.assert_allclose(found[p], expected, atol=1e-9 * np.abs(expected).max(), err_msg=name)
        weight = circular(rng, part.G.shape)
        summed = np.einsum("kf,fe,feb->kb", (1j * part.omega) ** np.arange(3)[:, None], weight, U)
        exact = part.pull(weight)
        moved = len(part.sign) + np.flatnonzero(part.S[1].any(axis=(1, 2)))
        exact[1:, moved] = summed[1:, moved]
        np.testing.assert_allclose(exact, summed, atol=1e-10 * np.abs(summed).max())
