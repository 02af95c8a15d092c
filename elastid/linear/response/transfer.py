r"""LinearModel -> frequency response, the formula itself.

.. math:: G(j\omega) = c\, C Z^{-1} B, \qquad Z = -\omega^2 M + j\omega D + K, \qquad
          c = (j\omega)^k e^{-j\omega T_d} \prod_i H_i(j\omega T_i)

with k = 0, 1, 2 for position, velocity, acceleration, H_i the elements of the measurement chain, and each element times
g_y / g_u where channels have gains. An accelerometer has C + T / s^2 instead of C.

A torque held for T = 1 / f_s has the spectrum H_0(f) U(f), U of period f_s and H_0(f + m f_s) = H_0(f) x / (x + m) with
x = f / f_s. Samples of the angle, multiplied by (j omega)^2 and divided by H_0 U, contain all images of the line:

.. math:: G(\omega) + \sum_{m \ne 0} \Big(\frac{x}{x + m}\Big)^3 G(\omega_m), \qquad \omega_m = \omega + m \omega_s

with G the acceleration. An inertia alone has G_inf (pi^3 x^3 cos(pi x) / sin^3(pi x) - 1): -0.14 % at x = 0.12, -29 %
at 0.4. At all images G is smooth in 1 / omega, its real part even and its imaginary part odd: polynomials in
1 / omega^2 through four Chebyshev points between zero and the lowest image, evaluated at every image. What remains
are images beyond the 64th, and resonances above the lowest image. A delay of the torque turns each image by its own
phase; gains and lags of the torque are part of G; lags of a sensor act on what was sampled.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, lru_cache

import numpy as np
from numpy.typing import ArrayLike

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, frozen, frozen_value
from elastid.linear.linear_model import DELAY, TORQUE_LAG, LinearModel
from elastid.record import MOTION_ORDER
from elastid.response import Response


def factor(model: LinearModel, theta: FloatArray, s: ComplexArray) -> ComplexArray:
    """c = s^k exp(-s T_d) times the factors of the chain, of the shape of s = j omega."""
    delay = model.number(theta, DELAY) if DELAY in model.parameters and model.is_delayed else 0.0
    c = s ** MOTION_ORDER[model.quantity]
    if delay:
        c = c * np.exp(-s * delay)
    for element in model.chain:
        c = c * element.response(s, model.number(theta, element.name))
    return c


# Those beyond add less than 1e-5 x^4 of G.
IMAGES = np.array([m for m in range(-64, 65) if m])


@dataclass(frozen=True)
class Folding:
    """Images = even Re G_j + j odd Im G_j of nodes G_j: even, odd (F, J); counts (n_y, n_u) elements that have any."""

    even: ComplexArray
    odd: ComplexArray
    counts: BoolArray

    def images(self, G: ComplexArray) -> ComplexArray:
        """(..., F, n_y, n_u) of G (..., J, n_y, n_u)."""
        flat = G.reshape(*G.shape[:-2], self.counts.size)
        folded = self.even @ flat.real + 1j * (self.odd @ flat.imag)
        return np.asarray(np.where(self.counts, folded.reshape(*folded.shape[:-1], *G.shape[-2:]), 0.0))

    def weight(self, weight: ComplexArray) -> ComplexArray:
        """w (J, n_y, n_u) with Re sum w dG_j = Re sum over lines of weight (F, n_y, n_u) times the images of dG_j."""
        flat = np.where(self.counts, weight, 0.0).reshape(len(weight), self.counts.size)
        at_nodes = (self.even.T @ flat).real + 1j * (self.odd.T @ flat).imag
        return np.asarray(at_nodes.reshape(-1, *weight.shape[1:]))


@frozen_value(eq=False)
class HoldImages:
    """The images of the torques that are held at rate_hz, on lines freq_hz (F,); none of lines above half of it.

    inputs (n_u,): true for these torques.
    """

    model: LinearModel
    freq_hz: FloatArray
    rate_hz: float
    inputs: BoolArray

    @property
    def nodes_hz(self) -> FloatArray:
        """Frequencies (J,) at which G is needed, all above half the rate."""
        return np.asarray(self._lowest * self.rate_hz / np.sqrt(_chebyshev()))

    @cached_property
    def plant(self) -> LinearModel:
        """The model whose response is needed at these: acceleration by the torque that acts, before any sensor."""
        lags = tuple(element for element in self.model.chain if element.name == TORQUE_LAG)
        return replace(self.model, quantity="acceleration", chain=lags, hold=None)

    @cached_property
    def sensors(self) -> LinearModel:
        """Model with the chain behind the sampled motion alone."""
        lags = tuple(element for element in self.model.chain if element.name != TORQUE_LAG)
        return replace(self.model, chain=lags)

    def moves_plant(self, name: str) -> bool:
        """True if a parameter may move the response of `plant`: all but the delay and lags of the sensors."""
        return name != DELAY and name not in [element.name for element in self.sensors.chain]

    def undelayed(self, theta: FloatArray) -> FloatArray:
        """theta (n_theta,) of `plant`, of which the delay is no part."""
        return np.where([name == DELAY for name in self.model.parameters], 0.0, theta)

    def folding(self, theta: FloatArray, order: int = 0) -> Folding:
        """How G at the nodes adds to G at the lines; order 1: the derivative of that to the delay."""
        delay = self.model.number(theta, DELAY) if DELAY in self.model.parameters else 0.0
        s = (2j * np.pi * self.freq_hz).astype(complex)
        even, odd = self._sums(delay, 0) if not order else -s * self._sums(delay, 0) - self._sums(delay, 1)
        gain = factor(self.sensors, theta, s) / s**2
        return Folding((gain * even).T, (gain * odd).T, self._counts)

    def _sums(self, delay: float, order: int) -> ComplexArray:
        return _image_sums(self.freq_hz.tobytes(), self.rate_hz, self._lowest, delay, order)

    @cached_property
    def _counts(self) -> BoolArray:
        sampled = self.model.hold.sampled if self.model.hold is not None else ()
        return np.outer(sampled, self.inputs).astype(bool)

    @property
    def _lowest(self) -> float:
        """The frequency of the lowest image over the rate."""
        return 1.0 - min(float(self.freq_hz.max(initial=0.0)) / self.rate_hz, 0.5)


def hold_images(model: LinearModel, freq_hz: FloatArray) -> tuple[HoldImages, ...]:
    """Images of a model on lines freq_hz (F,), for each rate at which torques are held."""
    if model.hold is None or not any(model.hold.sampled):
        return ()
    rates = np.array(model.hold.rates_hz)
    return tuple(HoldImages(model, freq_hz, rate, rates == rate) for rate in np.unique(rates[rates > 0]).tolist())


@lru_cache(maxsize=32)
def _image_sums(freq_hz: bytes, rate_hz: float, lowest: float, delay: float, order: int) -> ComplexArray:
    """(2, J, F): all images, each turned by the delay and times a power of its distance j m omega_s from the line.

    The same for all configurations on the same lines.
    """
    further = 2j * np.pi * rate_hz * IMAGES
    turn = further**order * np.exp(-further * delay)
    terms = _terms(freq_hz, rate_hz, lowest)
    return frozen(np.ascontiguousarray(terms @ turn.view(np.float64).reshape(-1, 2)).view(complex)[..., 0], complex)


@lru_cache(maxsize=32)
def _terms(freq_hz: bytes, rate_hz: float, lowest: float) -> FloatArray:
    """(2, J, F, n_m): contribution of each image by the real (0) and by the imaginary part (1) of each node.

    lowest: the frequency of the lowest image over the rate.
    """
    lines = np.frombuffer(freq_hz)
    x = np.where(lines < rate_hz / 2, lines / rate_hz, 0.0)[:, None]
    nodes, image = _chebyshev(), x + IMAGES
    t = (lowest / image) ** 2

    def lagrange(j: int) -> FloatArray:
        return np.asarray(np.prod([(t - node) / (nodes[j] - node) for node in np.delete(nodes, j)], axis=0))

    even = (x / image) ** 3 * np.array([lagrange(j) for j in range(len(nodes))])
    return frozen(np.stack([even, even * (lowest / image) / np.sqrt(nodes)[:, None, None]]))


def _chebyshev() -> FloatArray:
    """Chebyshev points (J,) of the interval from 0 to 1.

    Of a joint of two masses, its resonance at a tenth of the rate: 1e-8 of G up to an eighth of the rate, 1e-6 to 0.45.
    """
    return np.asarray((1 + np.cos(np.pi * (np.arange(4) + 0.5) / 4)) / 2)


def frequency_response(model: LinearModel, theta: FloatArray, freq_hz: FloatArray) -> ComplexArray:
    r"""Response of an elastic robot in one configuration, the formula itself.

    .. math:: G(j\omega) = (j\omega)^k e^{-j\omega T_d}\, C\, [K - \omega^2 M + j\omega D]^{-1} B

    theta (n_theta,): model.parameters, SI.  freq_hz (F,), or one: positive numbers, ValueError otherwise.
    Returns G (F, n_y, n_u), link side, model.quantity per Nm; with the images of torques that `model.hold` holds.
    """
    freq_hz = checked_frequencies(freq_hz)
    M, D, K = model.matrices(theta)
    s = (2j * np.pi * freq_hz[:, None, None]).astype(complex)
    drift = 0.0 if model.integral is None else model.integral / s
    X = np.linalg.solve(s**2 * M + s * D + K + drift, model.acting(theta).astype(complex))
    C, T = model.readout(theta)
    G = np.outer(*model.channel_gains(theta)) * factor(model, theta, s) * (C @ X + T @ X / s**2)
    for images in hold_images(model, freq_hz):
        above = frequency_response(images.plant, images.undelayed(theta), images.nodes_hz)
        G = G + images.folding(theta).images(above)
    return np.asarray(G)


def checked_frequencies(freq_hz: ArrayLike) -> FloatArray:
    """Frequencies (F,) as numbers, also of a single one; ValueError for others, and for those that are not positive."""
    try:
        lines = np.atleast_1d(np.asarray(freq_hz, float))
    except (TypeError, ValueError):
        raise ValueError(f"freq_hz is {freq_hz!r}; give numbers in Hz, such as [10.0, 20.0]") from None
    if lines.ndim != 1 or not np.all((lines > 0) & np.isfinite(lines)):
        raise ValueError(
            "freq_hz holds what is no finite number above 0 Hz, or no row of them: a constant torque turns a motor "
            "for ever; leave it out, or give a small frequency such as 0.01"
        )
    return lines


def to_response(model: LinearModel, theta: FloatArray, freq_hz: FloatArray) -> Response:
    """The response as a value like a measured one; arguments as `frequency_response`."""
    G, lines = frequency_response(model, theta, freq_hz), np.atleast_1d(freq_hz)
    places = model.inputs, model.outputs, model.quantity, model.configuration
    return Response(lines, G, *places, sliding=model.sliding, hold=model.hold, motors=model.motors, loop=model.loop)
