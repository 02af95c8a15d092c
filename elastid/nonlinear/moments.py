r"""A torque that jumps between its samples, by its moments in each of them: its spectrum, and samples of its integrals.

.. math:: \mu_{kl} = \int_0^1 f(k + \tau)\, P_l(2 \tau - 1)\, d\tau, \qquad
          F(\omega) = \sum_l (2 l + 1)\, DFT\{\mu_l\} \int_0^1 P_l(2 \tau - 1)\, e^{-j \omega \tau}\, d\tau

Time is in samples, P_l are Legendre's polynomials. Eight moments give F up to half the rate to 1e-6 of a jump. The
integrals of f have exact samples, with all images; their DFT X_p follows from that of the integrals over one sample,

.. math:: (z - 1)\, X_p = \sum_{i=1}^{p-1} \frac{X_{p-i}}{i!} + DFT \Big\{ \int_0^1 \frac{(1 - \tau)^{p-1}}{(p-1)!}
          f(k + \tau)\, d\tau \Big\}, \qquad z = e^{j \omega}

f is known by its means in cells of a sample. F is divided by the transform of two cells: one by which the mean is more
than the value, and one by which a cell is wider than a point.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from numpy.fft import rfft
from numpy.polynomial import legendre

from elastid.base.arrays import ComplexArray, FloatArray, IntArray, frozen

DEGREES = 8


@dataclass(frozen=True, eq=False)
class Moments:
    """mu (DEGREES, n), or (1, n), of a signal that repeats after n samples, constant in each of `cells` of a sample.

    cells: infinite where the signal is so in truth; otherwise its values there are the means of another one.
    """

    mu: FloatArray
    cells: float

    @classmethod
    def held(cls, torque: FloatArray) -> Moments:
        """Of a torque (n,) that is held for one sample each."""
        return cls(np.asarray(torque)[None], math.inf)

    @classmethod
    def of_means(cls, means: FloatArray) -> Moments:
        """Of a signal by its means (n, cells) in the cells of all samples."""
        return cls(np.asarray(_by_cells(means.shape[1]).T @ means.T), means.shape[1])

    @classmethod
    def of_steady(cls, steady: FloatArray, changing: IntArray, means: FloatArray) -> Moments:
        """Of a signal that is `steady` (n,) but for some samples (m,), by its means (m, cells) in their cells."""
        mu = np.zeros((DEGREES, len(steady)))
        mu[0] = steady
        mu[:, changing] = (means @ _by_cells(means.shape[1])).T
        return cls(mu, means.shape[1])

    @cached_property
    def dft(self) -> ComplexArray:
        """DFT (l, n // 2 + 1) of each moment."""
        return np.asarray(rfft(self.mu, axis=1))

    @cached_property
    def of_cells(self) -> ComplexArray:
        """F (n // 2 + 1,) of the signal that is constant in each cell."""
        return np.asarray(
            np.einsum("lk,lk->k", _weights(self.mu.shape[1], self.dft.shape[1])[: len(self.mu)], self.dft)
        )

    def spectrum(self, lines: int) -> ComplexArray:
        """F (lines,) from 0 on, up to half the rate, or up to lines between the rate and 3 / 2 of it."""
        n, low, half = self.mu.shape[1], self.of_cells[:lines], len(self.of_cells)
        if lines > half:  # the DFT repeats, mirrored up to the rate
            W = _weights(n, lines)[: len(self.mu)]
            above = np.einsum("lk,lk->k", W[:, half:n], self.dft[:, n - half : 0 : -1].conj())
            low = np.concatenate([low, above, np.einsum("lk,lk->k", W[:, n:], self.dft[:, : lines - n])])
        return low if math.isinf(self.cells) else low / _of_two_cells(n, lines, self.cells)

    def integral(self, order: int) -> ComplexArray:
        """X_p (n // 2 + 1,) of the integral of an order p of 1 to 6 that has no mean, times in samples."""
        X, (s, _) = self.images(order), _steps(self.mu.shape[1])
        X[1:] += (self.spectrum(len(X)) / s**order)[1:]
        return X

    def images(self, order: int) -> ComplexArray:
        """DFT (n // 2 + 1,) of that integral's part above half the rate, as its samples show it; order: from 2 on."""
        step = _steps(self.mu.shape[1])[1]
        X = [self._samples()]
        for p in range(1, order + 1):
            known = self._over_sample(p)
            for i in range(1, p):
                known += X[p - i] / math.factorial(i)
            known /= step
            # What the mean of the integral is more than that of its samples.
            within = self._over_sample(p + 1, 1)[0] + sum(X[p - i + 1][0] / math.factorial(i) for i in range(2, p + 1))
            known[0] = -within
            X.append(known)
        # By two cells, as the spectrum: 1 / sinc^2 is 1 - s^2 / 12 in cells.
        images: ComplexArray = X[order] - X[order - 2] / (12 * self.cells**2)
        images -= _below(self.mu.shape[1], order, self.cells) * self.of_cells
        return images

    def second_images(self) -> ComplexArray:
        """`images(2)`, by factors that are the same for all signals of n samples, in a fifth of the time."""
        return np.asarray(np.einsum("lk,lk->k", _of_images(*self.mu.shape, self.cells), self.dft))

    def _samples(self) -> ComplexArray:
        """DFT (n // 2 + 1,) of the signal at the samples, between both sides, about; without its mean."""
        degrees = np.arange(len(self.mu))
        before, after = degrees + 0.5, (degrees + 0.5) * (-1.0) ** degrees
        X = (before @ self.dft) / (_steps(self.mu.shape[1])[1] + 1) + after @ self.dft
        X[0] = 0.0
        return np.asarray(X)

    def _over_sample(self, order: int, lines: int | None = None) -> ComplexArray:
        """DFT (n // 2 + 1,) of the integral of (1 - tau)^(p - 1) / (p - 1)! f, without its mean, over each sample."""
        factors = _of_power(order)
        X = np.asarray(factors[: len(self.mu)] @ self.dft[:order, :lines])
        X[0] -= factors[0] * self.dft[0, 0]
        return X


def spectra_at(mu: FloatArray, cells: int, lines: IntArray) -> ComplexArray:
    """F (K, F) at some lines up to half the rate, as of `Moments.spectrum`, of K signals by their moments (K, l, n)."""
    n, top = mu.shape[2], int(lines.max()) + 1
    weights = _weights(n, top)[:, lines] / _of_two_cells(n, top, cells)[lines]
    return np.asarray(np.einsum("lf,klf->kf", weights[: mu.shape[1]], rfft(mu)[..., lines]))


@lru_cache(maxsize=4)
def _by_cells(cells: int) -> FloatArray:
    """Moments (cells, DEGREES) of the cells of one sample."""
    edges, unit = np.linspace(-1, 1, cells + 1), np.eye(DEGREES)
    integrals = [legendre.legval(edges, legendre.legint(row)) for row in unit]
    return frozen(np.diff(np.array(integrals), axis=1).T / 2)


@lru_cache(maxsize=8)
def _of_power(order: int) -> FloatArray:
    """Factors (order,) of the moments in the integral of (1 - tau)^(p - 1) / (p - 1)! f over a sample."""
    p = order - 1
    powers = np.polynomial.polynomial.polypow([0.5, -0.5], p) if p else np.ones(1)
    return frozen(legendre.poly2leg(powers) / math.factorial(p))


@lru_cache(maxsize=8)
def _weights(n: int, lines: int) -> ComplexArray:
    """(2 l + 1) times the transform (DEGREES, lines) of P_l over a sample, at lines of n samples, by Gauss."""
    x, w = legendre.leggauss(24)
    of_degrees = legendre.legvander(x, DEGREES - 1) * (w / 2)[:, None] * (2 * np.arange(DEGREES) + 1)
    turns = np.exp(-1j * np.pi / n * np.outer(np.arange(lines), x + 1))
    return frozen((turns @ of_degrees).T, np.complex128)


@lru_cache(maxsize=8)
def _of_two_cells(n: int, lines: int, cells: float) -> FloatArray:
    """sinc^2 (lines,) of a cell at lines of n samples."""
    return frozen(np.sinc(np.arange(lines) / (n * cells)) ** 2)


@lru_cache(maxsize=4)
def _of_images(degrees: int, n: int, cells: float) -> ComplexArray:
    """Factors (degrees, n // 2 + 1) of the DFT of each moment in the images of the second integral."""
    factors = []
    for degree in range(degrees):
        mu = np.zeros((degrees, n))
        mu[degree, 0] = 1.0  # its DFT is 1 at all lines
        factors.append(Moments(mu, cells).images(2))
    return frozen(factors, np.complex128)


@lru_cache(maxsize=8)
def _below(n: int, order: int, cells: float) -> ComplexArray:
    """The integral (n // 2 + 1,) below half the rate of a signal that is constant in each cell, over its F."""
    s, _ = _steps(n)
    factors = (1 - s**2 / (12 * cells**2)) / s**order
    factors[0] = 0.0
    return frozen(factors, np.complex128)


@lru_cache(maxsize=8)
def _steps(n: int) -> tuple[ComplexArray, ComplexArray]:
    """j omega and z - 1 (n // 2 + 1,) at lines of n samples; 1 at the first, where they are 0."""
    s = 2j * np.pi / n * np.arange(n // 2 + 1)
    step = np.exp(s) - 1
    s[0] = step[0] = 1.0
    return frozen(s, np.complex128), frozen(step, np.complex128)
