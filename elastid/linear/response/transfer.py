r"""Transfer function of a LinearModel, with the aliases of zero-order-hold torques.

.. math:: G(j\omega) = c\, C Z^{-1} B, \qquad Z = -\omega^2 M + j\omega D + K, \qquad
          c = (j\omega)^k e^{-j\omega T_d} \prod_i H_i(j\omega T_i)

k = 0, 1, 2 for position, velocity, acceleration; H_i: elements of the measurement chain. Gains of channels multiply
each element by g_y / g_u. An accelerometer has C + T / s^2 instead of C.

A ZOH torque with T = 1 / f_s has the spectrum H_0(f) U(f), U with period f_s and H_0(f + m f_s) = H_0(f) x / (x + m),
x = f / f_s. Samples of the angle, multiplied by (j omega)^2 and divided by H_0 U, contain all aliases of the line:

.. math:: G(\omega) + \sum_{m \ne 0} \Big(\frac{x}{x + m}\Big)^3 G(\omega_m), \qquad \omega_m = \omega + m \omega_s

G: acceleration. A single inertia has G_inf (pi^3 x^3 cos(pi x) / sin^3(pi x) - 1): -0.14 % at x = 0.12, -29 % at 0.4.
At the aliases G is smooth in 1 / omega, with even real and odd imaginary part: it is interpolated by polynomials in
1 / omega^2 through four Chebyshev points between zero and the lowest alias. Errors: aliases beyond the 64th, and
resonances above the lowest alias. A torque delay shifts the phase of each alias; gains and lags of the torque are part
of G; lags of a sensor act on the sampled signal.
"""

from dataclasses import replace
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from elastid.base.arrays import ComplexArray, FloatArray, frozen, laplace_variable
from elastid.linear.linear_model import TORQUE_LAG, LinearModel
from elastid.linear.response.closed_loop import ClosedLoop, close_loop, open_loops
from elastid.parameters import DELAY
from elastid.record import MOTION_ORDER
from elastid.response import Response


def factor(model: LinearModel, theta: FloatArray, s: ComplexArray) -> ComplexArray:
    """Return c = s^k exp(-s T_d) prod H_i(s T_i) in the shape of s = j omega."""
    delay = model.number(theta, DELAY, absent=0.0) if model.is_delayed else 0.0
    c = s ** MOTION_ORDER[model.quantity]
    if delay:
        c = c * np.exp(-s * delay)
    for element in model.chain:
        c = c * element.response(s, model.number(theta, element.name))
    return c


# Orders m of the aliases; others add less than 1e-5 x^4 of G.
ALIASES = np.array([m for m in range(-64, 65) if m])
# Chebyshev points (J,) of the interval from 0 to 1. Error for a two-mass joint with its resonance at a tenth of the
# rate: 1e-8 of G up to an eighth of the rate, 1e-6 up to 0.45.
NODES = (1 + np.cos(np.pi * (np.arange(4) + 0.5) / 4)) / 2


def zoh_aliases(model: LinearModel, theta: FloatArray, freq_hz: FloatArray) -> ComplexArray:
    """Return aliases (F, n_y, n_u) of the zero-order hold `model.hold`; zero on lines above half of its rate."""
    images = np.zeros((len(freq_hz), len(model.outputs), len(model.inputs)), complex)
    if model.hold is None or model.controller is not None or not any(model.hold.sampled):
        return images  # aliases of controllers are computed within their loops
    # Aliases of the acceleration by the acting torque, before any sensor; the delay shifts their phases.
    inner_chain = tuple(element for element in model.chain if element.name == TORQUE_LAG)
    behind = tuple(element for element in model.chain if element.name != TORQUE_LAG)
    plant = replace(model, quantity="acceleration", chain=inner_chain, hold=None, channel_numbers=())
    of_outputs, of_inputs = model.channel_factors(theta, laplace_variable(freq_hz))
    is_delay = np.array([name == DELAY for name in model.parameters])
    s, rates = laplace_variable(freq_hz), np.array(model.hold.rates_hz)
    gain = (factor(replace(model, chain=behind), theta, s) / s**2)[:, None, None]
    for rate in np.unique(rates[rates > 0]).tolist():
        lowest = 1.0 - min(float(freq_hz.max(initial=0.0)) / rate, 0.5)
        G = frequency_response(plant, np.where(is_delay, 0.0, theta), lowest * rate / np.sqrt(NODES))
        even, odd = _alias_sums(freq_hz.tobytes(), rate, lowest, float(theta[is_delay].sum()))
        aliases = np.tensordot(even, G.real, 1) + 1j * np.tensordot(odd, G.imag, 1)
        images += np.outer(model.hold.sampled, rates == rate) * gain * aliases
    return of_outputs[..., :, None] * images * of_inputs[..., None, :]


@lru_cache(maxsize=32)
def _alias_sums(freq_hz: bytes, rate_hz: float, lowest: float, delay: float) -> ComplexArray:
    """Return (2, F, J): sums of all aliases with the phase of the delay, by real (0) and imaginary part (1) of nodes.

    lowest: frequency of the lowest alias over the rate. Equal for all configurations with the same lines.
    """
    lines = np.frombuffer(freq_hz)
    x = np.where(lines < rate_hz / 2, lines / rate_hz, 0.0)[:, None]
    image = x + ALIASES
    t = (lowest / image) ** 2

    def lagrange(j: int) -> FloatArray:
        return np.asarray(np.prod([(t - node) / (NODES[j] - node) for node in np.delete(NODES, j)], axis=0))

    even = (x / image) ** 3 * np.array([lagrange(j) for j in range(len(NODES))])
    odd = even * (lowest / image) / np.sqrt(NODES)[:, None, None]
    turn = np.exp(-2j * np.pi * rate_hz * delay * ALIASES).view(np.float64).reshape(-1, 2)
    return frozen((np.stack([even, odd]) @ turn).view(complex)[..., 0].swapaxes(1, 2), complex)


def frequency_response(model: LinearModel, theta: FloatArray, freq_hz: FloatArray) -> ComplexArray:
    r"""Return the response of an elastic robot in one configuration.

    .. math:: G(j\omega) = (j\omega)^k e^{-j\omega T_d}\, C\, [K - \omega^2 M + j\omega D]^{-1} B

    theta (n_theta,): model.parameters, SI.  freq_hz (F,), or one: positive numbers, ValueError otherwise.
    Returns G (F, n_y, n_u), link side, model.quantity per Nm, with the aliases of the ZOH torques of `model.hold`.
    """
    freq_hz = checked_frequencies(freq_hz)
    if model.controller is not None:
        return closed_loop(model, theta, freq_hz).T + reference_aliases(model, theta, freq_hz)
    M, D, K = model.matrices(theta)
    s = laplace_variable(freq_hz[:, None, None])
    drift = 0.0 if model.integral is None else model.integral / s
    X = np.linalg.solve(s**2 * M + s * D + K + drift, model.input_matrix(theta).astype(complex))
    C, T = model.readout(theta)
    of_outputs, of_inputs = model.channel_factors(theta, s[:, 0, 0])
    G = factor(model, theta, s) * (C @ X + T @ X / s**2)
    G = of_outputs[..., :, None] * G * of_inputs[..., None, :]
    return G + zoh_aliases(model, theta, freq_hz)


def closed_loop(model: LinearModel, theta: FloatArray, freq_hz: FloatArray) -> ClosedLoop:
    """Return the closed loops at freq_hz (F,) of a model whose inputs are references."""
    return close_loop(model, theta, freq_hz, *(frequency_response(loop, theta, freq_hz) for loop in open_loops(model)))


def reference_aliases(model: LinearModel, theta: FloatArray, freq_hz: FloatArray) -> ComplexArray:
    r"""Return the aliases (F, n_y, n_u) of sampled references in sampled positions, both at f_l, `controller.log_hz`.

    .. math:: \sum_{m \ne 0} T(f + m f_l)
    """
    images = np.zeros((len(freq_hz), len(model.outputs), len(model.inputs)), complex)
    if model.controller is None or not model.controller.log_hz or model.hold is None:
        return images
    images_hz = model.controller.images_hz(freq_hz)
    finite = np.isfinite(images_hz)
    f, lines, order = images_hz[finite], np.nonzero(finite)[0], MOTION_ORDER[model.quantity]
    T = closed_loop(model, theta, np.abs(f)).T
    T = np.where(f[:, None, None] < 0, T.conj(), T)
    np.add.at(images, lines, T * ((freq_hz[lines] / f) ** order)[:, None, None])
    return np.asarray(images * np.array(model.hold.sampled)[:, None])


def change_by_angles(model: LinearModel, theta: FloatArray, freq_hz: FloatArray, change: ComplexArray) -> ComplexArray:
    """Return dG by a change (F, n_y, n_u) of the angles per torque; with loops (F, n_y + n_m, n_m), motors last."""
    s = laplace_variable(freq_hz)
    of_outputs, of_inputs = model.channel_factors(theta, s)
    of_y = of_outputs[..., None] * factor(model, theta, s)[:, None, None]
    if model.controller is None:
        return of_y * change * of_inputs[..., None, :]
    motors, n_y = open_loops(model)[1], len(model.outputs)
    of_motors = factor(motors, theta, s)[:, None, None]
    return closed_loop(model, theta, freq_hz).change(of_y * change[:, :n_y], of_motors * change[:, n_y:])


def checked_frequencies(freq_hz: ArrayLike) -> FloatArray:
    """Return one frequency or a row of them as an array (F,); ValueError unless positive and finite."""
    try:
        lines = np.atleast_1d(np.asarray(freq_hz, float))
    except (TypeError, ValueError):
        raise ValueError(f"freq_hz is {freq_hz!r}; give numbers in Hz, such as [10.0, 20.0]") from None
    if lines.ndim != 1 or not np.all((lines > 0) & np.isfinite(lines)):
        raise ValueError(
            "freq_hz must be a row of finite numbers above 0 Hz. Instead of 0 Hz, give a small frequency such as 0.01"
        )
    return lines


def to_response(model: LinearModel, theta: FloatArray, freq_hz: FloatArray) -> Response:
    """Return the modelled response as a `Response`; arguments as `frequency_response`."""
    G, lines = frequency_response(model, theta, freq_hz), np.atleast_1d(freq_hz)
    locations = model.inputs, model.outputs, model.quantity, model.configuration
    return Response(
        lines, G, *locations, sliding=model.sliding, hold=model.hold, motors=model.motors, loop=model.loop,
        controller=model.controller,
    )  # fmt: skip
