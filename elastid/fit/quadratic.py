r"""Whether V is quadratic over an interval, as the covariance takes for granted: a parameter known to a few percent is,
a damping known to 40 % is not, nor whatever is correlated with it.

.. math:: \rho_i^\pm = \sqrt{\frac{V(\hat x \pm q v_i) - V(\hat x)}{[V(\hat x \pm h q v_i) - V(\hat x)] / h^2}},
          \qquad v_i = \frac{\sigma_i}{(A^{-1})_{ii}} A^{-1} e_i, \quad q = 1.96

v_i: the way that all parameters go, to first order, while x_i goes by one standard deviation. 1 for a quadratic V; to
first order the end of the interval on that side is 1 / rho as far away.
"""

from __future__ import annotations

import numpy as np

from elastid.arrays import FloatArray
from elastid.fit.problem import LeastSquares
from elastid.fit.result import QUANTILE

# The step h that shows the curvature at the optimum, as a part of the interval: small, but V must rise beyond rounding.
SMALL = 0.1


def bent(problem: LeastSquares, x: FloatArray, variance: FloatArray) -> FloatArray:
    """How much an interval's ends are off for each parameter (n_x,), the larger of |1 - rho|; 0 where none is known.

    variance (n_x,): as the fit states it.
    """
    best = problem.evaluate(x)
    A_inverse = np.linalg.pinv(best.hessian / 2, hermitian=True)
    curvature = np.diag(A_inverse)
    found = np.zeros(len(x))
    lower, upper = problem.parameters.x_bounds
    for i in np.flatnonzero(np.isfinite(variance) & (variance > 0) & (curvature > 0)):
        v = np.sqrt(variance[i]) * A_inverse[:, i] / curvature[i]
        for side in (-QUANTILE, QUANTILE):
            whole, small = (
                problem.evaluate(np.clip(x + step * v, lower, upper)).cost - best.cost for step in (side, SMALL * side)
            )
            if not small > 0 or not np.isfinite(whole):
                found[i] = np.inf
            else:
                found[i] = max(found[i], abs(1 - SMALL * np.sqrt(max(whole, 0.0) / small)))
    return found
