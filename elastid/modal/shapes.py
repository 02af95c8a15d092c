r"""Mode shapes: modal assurance criterion, phase collinearity, the nearest real shape, complex mode indicator function.

.. math:: \mathrm{MAC}(\phi, \psi) = \frac{|\phi^H \psi|^2}{\phi^H \phi\; \psi^H \psi}, \qquad
          \mathrm{MPC}(\phi) = \left( \frac{\sigma_1^2 - \sigma_2^2}{\sigma_1^2 + \sigma_2^2} \right)^2,\quad
          \sigma: [\mathrm{Re}\,\phi\;\; \mathrm{Im}\,\phi]

CMIF: the singular values of G line by line.  (Allemang, Sound and Vibration 37, 2003; Pappa, Elliott and Schenk, J.
Guidance, Control and Dynamics 16, 1993; Shih, Tsuei, Allemang and Brown, Mech. Syst. Signal Processing 2, 1988.)
"""

from __future__ import annotations

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray


def mac(first: ComplexArray, second: ComplexArray) -> FloatArray:
    """MAC (n, m) of shapes (n_y, n) and (n_y, m), 1 for shapes that differ by a factor; ValueError for other places.

    >>> mac(np.array([[1.0], [2.0]]), np.array([[1j, 2.0], [2j, -1.0]])).round(3).tolist()
    [[1.0, 0.0]]
    """
    a, b = np.asarray(first), np.asarray(second)
    if a.ndim != 2 or b.ndim != 2 or len(a) != len(b):
        raise ValueError(f"shapes are {a.shape} and {b.shape}; give (n_y, n) and (n_y, m) of the same outputs")
    norms = np.sum(np.abs(a) ** 2, axis=0)[:, None] * np.sum(np.abs(b) ** 2, axis=0)
    return np.asarray(np.abs(a.conj().T @ b) ** 2 / np.maximum(norms, np.finfo(float).tiny))


def phase_collinearity(shapes: ComplexArray) -> FloatArray:
    """MPC (n,) of shapes (n_y, n): 1 where all entries have one phase or its opposite.

    >>> phase_collinearity(np.array([[1 + 1j, 1.0], [2 + 2j, 1j]])).round(3).tolist()
    [1.0, 0.0]
    """
    s = np.stack([np.linalg.svd(np.stack([phi.real, phi.imag]), compute_uv=False) for phi in np.asarray(shapes).T])
    if s.shape[1] < 2:
        return np.ones(len(s))
    power = s**2
    return np.asarray(((power[:, 0] - power[:, 1]) / np.maximum(power.sum(axis=1), np.finfo(float).tiny)) ** 2)


def turned(shapes: ComplexArray) -> ComplexArray:
    """Shapes (n_y, n) with their common phase taken out and the largest entry of modulus 1, its real part positive."""
    shapes = np.asarray(shapes, complex)
    shapes = shapes * np.exp(-0.5j * np.angle(np.sum(shapes**2, axis=0)))
    largest = np.take_along_axis(shapes, np.abs(shapes).argmax(axis=0)[None], axis=0)
    size = np.where(np.abs(largest) > 0, np.abs(largest), 1.0)
    return np.asarray(shapes * np.where(largest.real < 0, -1.0, 1.0) / size)


def real_shapes(shapes: ComplexArray) -> FloatArray:
    """The real shapes (n_y, n) nearest to complex ones: real parts after the common phase, the largest entry 1."""
    real = turned(shapes).real
    largest = np.take_along_axis(real, np.abs(real).argmax(axis=0)[None], axis=0)
    return np.asarray(real / np.where(largest != 0, largest, 1.0))


def mode_indicators(G: ComplexArray) -> FloatArray:
    """CMIF (F, min(n_y, n_u)): singular values of G (F, n_y, n_u), largest first."""
    return np.asarray(np.linalg.svd(G, compute_uv=False), dtype=float)
