r"""Newton's method for the periodic motion of a linear structure with nonlinear elements.

.. math:: x + A\, f(x) = x_0

x (n_x, n): motion of the elements over a period.  f(x): their forces, of each point alone.  A: response of the linear
structure to forces, a product of spectra. Each step solves (1 + A f'(x)) dx = -error by GMRES with two FFTs a product.
(Alternating frequency and time: Cameron and Griffin, J. Appl. Mech. 56, 1989.)
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.fft import irfft, rfft
from scipy.sparse.linalg import LinearOperator, gmres

from elastid.base.arrays import ComplexArray, FloatArray

_STEPS, _HALVINGS = 8, 5  # most steps of Newton's method, and most halvings of a step


@dataclass(frozen=True, eq=False)
class Linear:
    """Map from forces to unknowns: A (n_x, n_x, F) on the lines, softness (n_x,) at zero frequency.

    remainder (n_x, K): factor of the last line's A at the lines above: (s_F / s)^2 of a deflection, s_F / s of a
    velocity.
    """

    A: ComplexArray
    remainder: FloatArray
    softness: FloatArray

    def __call__(self, force: FloatArray) -> FloatArray:
        """Return the unknowns (n_x, n) by forces (n_x, n) on the fine grid of a period."""
        F, spectrum = self.A.shape[2], rfft(force)
        X = np.zeros_like(spectrum)
        X[:, 0] = self.softness * spectrum[:, 0]
        X[:, 1 : F + 1] = (self.A * spectrum[:, 1 : F + 1]).sum(axis=1)
        X[:, F + 1 : -1] = (self.A[:, :, -1] @ spectrum[:, F + 1 : -1]) * self.remainder
        return irfft(X, force.shape[1])


def newton(
    law: Callable[[FloatArray], tuple[FloatArray, FloatArray]], linear: Callable[[FloatArray], FloatArray],
    x_0: FloatArray, x: FloatArray, tolerance: float = 1e-4,
) -> tuple[FloatArray, FloatArray]:  # fmt: skip
    """Solve x + linear(law(x)) = x_0 for x (n_x, n) by Newton's method. Return x and the force at x.

    law: returns force and slope at each point.  x: start, replaced by x_0 if its error exceeds 1 and the error of x_0.
    tolerance: final error over the size of x_0.  Steps are halved until the error decreases; otherwise the last x is
    returned, whose error widens the intervals.
    """
    size = np.std(x_0, axis=1)[:, None] + 1e-300

    def error(x: FloatArray) -> tuple[float, FloatArray, FloatArray, FloatArray]:
        """Return rms error, error (n_x, n), slope of the law, and force."""
        force, slope = law(x)
        e = (x - x_0 + linear(force)) / size
        return float(np.sqrt(np.mean(e**2))), e, slope, force

    state = error(x)
    if state[0] > 1 and (at_0 := error(x_0))[0] < state[0]:
        x, state = x_0, at_0
    for _ in range(_STEPS):
        if state[0] < tolerance:
            break
        step = _newton_step(linear, state[2], size, -state[1] * size, 3e-2)
        trials = ((x + step / 2**halving, error(x + step / 2**halving)) for halving in range(_HALVINGS + 1))
        better = next((trial for trial in trials if trial[1][0] < state[0]), None)
        if better is None:
            break
        x, state = better
    return x, state[3]


def _newton_step(
    linear: Callable[[FloatArray], FloatArray], slope: FloatArray, size: FloatArray, x_0: FloatArray, tolerance: float
) -> FloatArray:
    """Solve x + linear(slope x) = x_0 for x (n_x, n) by GMRES; size (n_x, 1): scale of the unknowns.

    Single precision suffices for the relative tolerance of some percent.
    """
    x_slope, weight = (slope * size).astype(np.float32), (1 / size).astype(np.float32)

    def product(v: FloatArray) -> FloatArray:
        return v + (linear(x_slope * v.reshape(x_0.shape)) * weight).ravel()

    operator = LinearOperator((x_0.size, x_0.size), matvec=product, dtype=np.float32)
    step = gmres(operator, (x_0 / size).astype(np.float32).ravel(), rtol=tolerance, restart=40, maxiter=1)[0]
    return np.asarray(step.reshape(x_0.shape) * size)
