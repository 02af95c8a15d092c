"""The kernel against the formula, its derivatives against differences, with loops in C and without."""

import numpy as np
import pytest
from plants.oblique_arm import arm, linear

from elastid.base.kernels import is_compiled
from elastid.linear.linear_model import DELAY
from elastid.linear.response.kernel import Kernel
from elastid.linear.response.transfer import frequency_response

FREQ_HZ = np.geomspace(0.5, 90, 130)
needs_compiler = pytest.mark.skipif(not is_compiled(), reason="the kernels in C are not built")


@pytest.fixture(params=[False, pytest.param(True, marks=needs_compiler)], ids=["NumPy", "compiled"])
def loops(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Kernels whose loops are compiled, however few lines they have, and kernels without."""
    monkeypatch.setattr("elastid.linear.response.kernel.is_compiled", lambda: request.param)


@pytest.mark.usefixtures("loops")
def test_kernel_equals_the_formula():
    """Kernel and formula agree to rounding, for outputs on motors, joints and bodies, away from theta_ref."""
    outputs = ("motor 3", "body fore z", "motor 1", "joint 3z")
    for quantity in ("position", "velocity", "acceleration"):
        model = linear(arm(), outputs=outputs, quantity=quantity)
        theta = model.theta_ref * 1.1
        theta[-1] = 2e-3
        kernel = Kernel(model, FREQ_HZ, ("k_1", DELAY))
        G = frequency_response(model, theta, FREQ_HZ)
        tolerance = 1e-12 * np.abs(G).max()
        np.testing.assert_allclose(kernel.response(theta), G, atol=tolerance)
        np.testing.assert_allclose(kernel.evaluate(theta)[0], G, atol=tolerance)


@pytest.mark.usefixtures("loops")
@pytest.mark.parametrize("outputs", [None, ("body fore z", "motor 2", "joint 3", "motor 1")])
def test_derivatives_equal_central_differences_for_every_parameter(outputs):
    """dG of stiffness, damping, friction, rotors, masses, centres of mass, inertias, delay: to 1e-6 of the largest."""
    model = linear(arm(), outputs=outputs)
    typical = [5.0 if name.startswith("f_") else 1e-3 for name in model.parameters]  # sets the step where theta is 0
    theta = np.where(model.theta_ref == 0, typical, model.theta_ref)
    _, dG = Kernel(model, FREQ_HZ, model.parameters).evaluate(theta)
    assert dG.shape[0] == len(model.parameters)
    for place, name in enumerate(model.parameters):
        h = 3e-5 * abs(theta[place])
        shift = h * (np.arange(theta.size) == place)
        numeric = (
            frequency_response(model, theta + shift, FREQ_HZ) - frequency_response(model, theta - shift, FREQ_HZ)
        ) / (2 * h)
        np.testing.assert_allclose(dG[place], numeric, atol=1e-6 * np.abs(numeric).max(), err_msg=name)
