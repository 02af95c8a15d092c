"""The kernel against the formula, its derivatives against differences, with loops in C and without."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from plants.template_arm import arm, linear
from plants.two_mass import circular

from elastid.base.kernels import is_compiled
from elastid.linear.response.derivatives import Columns
from elastid.linear.response.kernel import Elimination, Kernel, solved_products
from elastid.linear.response.transfer import frequency_response
from elastid.parameters import DELAY
from elastid.robot import Chain, Channel

FREQ_HZ = np.geomspace(0.5, 90, 130)
needs_compiler = pytest.mark.skipif(not is_compiled(), reason="the kernels in C are not built")


@pytest.fixture(params=[False, pytest.param(True, marks=needs_compiler)], ids=["NumPy", "compiled"])
def loops(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Kernels whose loops are compiled, however few lines they have, and kernels without."""
    monkeypatch.setattr("elastid.linear.response.kernel.is_compiled", lambda: request.param)


@pytest.mark.usefixtures("loops")
def test_kernel_equals_the_formula():
    """Kernel and formula agree to rounding, for outputs on motors, joints and bodies, away from theta_ref."""
    outputs = ("motor 3", "body fore_arm z", "motor 1", "joint 3z")
    for quantity in ("position", "velocity", "acceleration"):
        model = linear(arm(), outputs=outputs, quantity=quantity)
        theta = model.theta_ref * 1.1
        theta[-1] = 2e-3
        kernel = Kernel(model, FREQ_HZ, ("k_1", DELAY))
        G = frequency_response(model, theta, FREQ_HZ)
        tolerance = 1e-12 * np.abs(G).max()
        np.testing.assert_allclose(kernel.response(theta), G, atol=tolerance)
        np.testing.assert_allclose(Columns(kernel).evaluate(theta)[0], G, atol=tolerance)


@pytest.mark.usefixtures("loops")
@pytest.mark.parametrize("outputs", [None, ("body fore_arm z", "motor 2", "joint 3", "motor 1")])
def test_derivatives_equal_central_differences_for_every_parameter(outputs):
    """dG of stiffness, damping, friction, rotors, masses, centres, inertias, channels, delay: to 1e-6."""
    gains = (
        Channel("y", "body fore_arm z", 1.3, 1e-3), Channel("y", "motor 1", 0.9),
        Channel("u", "motor 2", 1.1, low_pass=2e-3),
        Channel("u", "", delay=-2e-3), Channel("y", "", low_pass=-1e-3),
    )  # fmt: skip
    model = linear(replace(arm(), chain=Chain(channels=gains)), outputs=outputs)
    typical = [5.0 if name.startswith("f_") else 1e-3 for name in model.parameters]  # sets the step where theta is 0
    theta = np.where(model.theta_ref == 0, typical, model.theta_ref)
    _, dG = Columns(Kernel(model, FREQ_HZ, model.parameters)).evaluate(theta)
    assert dG.shape[0] == len(model.parameters)
    for place, name in enumerate(model.parameters):
        h = 3e-5 * abs(theta[place])
        shift = h * (np.arange(theta.size) == place)
        numeric = (
            frequency_response(model, theta + shift, FREQ_HZ) - frequency_response(model, theta - shift, FREQ_HZ)
        ) / (2 * h)
        np.testing.assert_allclose(dG[place], numeric, atol=1e-6 * np.abs(numeric).max(), err_msg=name)


def test_pull_is_adjoint_of_columns():
    """Also times j omega and its square, for columns with several powers; columns are proportional to scales."""
    model = linear(arm(), outputs=("body fore_arm z", "motor 2"))
    columns, rng = Columns(Kernel(model, FREQ_HZ, model.parameters)), np.random.default_rng(0)
    for band in columns.at(model.theta_ref):
        scale = rng.uniform(1, 2, columns.pieces.base.max() + 1)
        U, weight = band.columns(np.ones_like(scale), np.float64), circular(rng, band.G.shape)
        np.testing.assert_allclose(band.columns(scale, np.float64), U * scale, rtol=1e-12)
        powers = (1j * band.omega) ** np.arange(3)[:, None]
        expected = np.einsum("pf,fe,feb->pb", powers, weight, U)
        error = np.abs(band.pull(weight) - expected) / np.abs(expected).max(axis=0)
        error[1:, len(band.sign) : len(band.sign) + band.S.shape[1]] = 0
        assert error.max() < 1e-10


pytestmark = pytest.mark.skipif(not is_compiled(), reason="the kernels in C are not built")
OMEGA = 2 * np.pi * np.linspace(1, 60, 150)


def system(rng, hangs_on, n_rest, damping=1e-3):
    """Random links, with one motor behind a spring for each entry of hangs_on, in a random order of coordinates."""
    n = n_rest + len(hangs_on)
    M, K = np.zeros((n, n)), np.zeros((n, n))
    for matrix, size in ((M, 1.0), (K, 1e4)):
        A = rng.standard_normal((n_rest, n_rest))
        matrix[:n_rest, :n_rest] = size * (A @ A.T + np.eye(n_rest))
    for motor, link in enumerate(hangs_on, start=n_rest):
        k = 1e4 * rng.uniform(0.5, 2)
        K[np.ix_([motor, link], [motor, link])] += k * np.array([[1, -1], [-1, 1]])
        M[motor, motor] = rng.uniform(0.5, 2)
    order = rng.permutation(n)
    M, K = M[np.ix_(order, order)], K[np.ix_(order, order)]
    return M, damping * K, K


def products_over_size(M, D, K, B, Y):
    """B^T Z^-1 Y by elimination, and by LAPACK, over the size of X at each line."""
    X = np.linalg.solve(K + 1j * OMEGA[:, None, None] * D - OMEGA[:, None, None] ** 2 * M, B.astype(complex))
    size = np.abs(X).max(axis=(1, 2), keepdims=True)
    expected = X.swapaxes(1, 2) @ Y
    np.testing.assert_allclose(solved_products(M, D, K, OMEGA, B, Y) / size, expected / size, atol=1e-13)
    return Elimination.of((M != 0) | (K != 0)).products(M, D, K, OMEGA, B, Y) / size, expected / size


@settings(max_examples=40, deadline=None)
@given(
    hangs_on=st.lists(st.integers(0, 3), max_size=6),
    n_rest=st.integers(4, 6),
    seed=st.integers(0, 99),
    damping=st.sampled_from([1e-2, 1e-3, 1e-5]),
)
def test_the_solution_is_that_of_the_whole_matrix(hangs_on, n_rest, seed, damping):
    """Any number of motors, several on one link too, right sides and directions that reach all coordinates."""
    rng = np.random.default_rng(seed)
    M, D, K = system(rng, hangs_on, n_rest, damping)
    B, Y = rng.standard_normal((len(M), 3)), rng.standard_normal((len(M), 4)) * rng.integers(0, 2, (len(M), 4))
    found, expected = products_over_size(M, D, K, B, Y)
    np.testing.assert_allclose(found, expected, atol=1e-10 if damping < 1e-3 else 1e-11)


@pytest.mark.parametrize("off", [0.0, 1e-14, 1e-9, 1e-4])
def test_line_on_undamped_resonance_loses_no_digits(off):
    """The motor alone resonates at a line, the robot does not."""
    rng = np.random.default_rng(1)
    M, D, K = system(rng, [0, 1], 4, damping=0.0)
    motor = Elimination.of((M != 0) | (K != 0)).order[0]
    M[motor, motor] = K[motor, motor] / OMEGA[70] ** 2 * (1 + off)
    found, expected = products_over_size(M, D, K, np.eye(6)[:, :2], np.eye(6))
    np.testing.assert_allclose(found[70], expected[70], rtol=0, atol=1e-11)
