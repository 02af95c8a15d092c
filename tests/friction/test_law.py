"""The function phi_1 of the exact updates."""

from __future__ import annotations

import casadi as ca
import numpy as np

from elastid.friction.law import Curve, phi_1


def test_the_growing_part_is_quadratic_and_viscous() -> None:
    """alpha_3 v |v| + alpha_T v, odd in v."""
    curve = Curve(1.0, 1.0, 0.0, 0.3, 0.2)
    np.testing.assert_allclose([float(ca.DM(curve.growing(v))) for v in (2.0, -2.0)], [1.6, -1.6])


def test_phi_1_has_the_derivatives_of_its_series() -> None:
    """1, -1/2, 1/3 at 0; no jump where the series hands over."""
    x = ca.SX.sym("x")
    first = ca.jacobian(phi_1(x), x)
    values = ca.Function("phi", [x], [phi_1(x), first, ca.jacobian(first, x)])
    np.testing.assert_allclose([float(part) for part in values(0.0)], [1, -0.5, 1 / 3], rtol=1e-12)
    below, above = float(values(1e-3 * (1 - 1e-9))[0]), float(values(1e-3)[0])
    np.testing.assert_allclose(below, above, rtol=1e-12)
