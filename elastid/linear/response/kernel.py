r"""Kernel: frequency response of a LinearModel and its exact derivatives, for many theta.

Z = -omega^2 M + j omega D + K is symmetric, so the solutions X = Z^-1 B and W = Z^-1 C^T give every derivative without
another solve (plain transposes):

.. math:: dG = -c\, W^T dZ\, X, \qquad dZ = dK + j\omega\, dD - \omega^2\, dM

dG / dT_d = -j omega G. Geometry that moves an output adds c dC X, geometry that moves a force adds c W^T dB. Gains of
channels multiply the elements. Symbols as in `transfer`.

In C (`base/kernels/ldl.c`) Z = L D L^T,

.. math:: Z^{(k+1)}_{ij} = Z^{(k)}_{ij} - \frac{z^{(k)}_{ki} z^{(k)}_{kj}}{z^{(k)}_{kk}}, \qquad i, j > k

with half of the operations of an LU factorisation, in an elimination order with little fill-in, and without entries
that are zero for every theta. There is no pivoting: lines with a small pivot, for example at an undamped resonance, are
solved by LAPACK, as are all lines without compiled kernels.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, IntArray, frozen_value
from elastid.base.kernels import call, is_compiled
from elastid.base.messages import WorkerConstant
from elastid.linear.linear_model import TORQUE_LAG, LinearModel
from elastid.linear.response.closed_loop import GAINS, ClosedLoop, close_loop, open_loops
from elastid.linear.response.transfer import factor, reference_aliases, zoh_aliases
from elastid.parameters import DELAY
from elastid.robot import CHANNEL_NUMBERS, channel_name

BLOCK = 208  # lines of a block, whose matrices fit into the cache; a multiple of the batches in C
MIN_PIVOT = 1e-3  # |pivot| relative to its terms, below which a line is solved by LAPACK


class Products(NamedTuple):
    """Block of lines: s = j omega (F,), gain c (F,), G (F, n_y, n_u), and products with directions Y.

    YX (F, m, n_d): Y^T Z^-1 b for m right-hand sides b, first the columns of B, then others (`Kernel.output_columns`).
    output_slopes (n_m, F, n_y, n_u): c [(dC + dT / s^2) Z^-1 B + (C + T / s^2) Z^-1 dB] for each of
    `Kernel.output_parameters`.
    """

    block: slice
    s: ComplexArray
    gain: ComplexArray
    G: ComplexArray
    YX: ComplexArray
    output_slopes: ComplexArray
    loop: ClosedLoop | None = None


@dataclass(frozen=True)
class Sides:
    """Right-hand sides: columns of B, rows `extra` of C that are not columns of B, and rows `tilted` of T.

    columns (n_y,): index of the right-hand side of each output.  tilts: index of the row of T of each tilted output.
    """

    extra: IntArray
    columns: IntArray
    tilted: IntArray
    tilts: IntArray


@frozen_value(eq=False)
class Kernel(WorkerConstant):
    """G of one LinearModel on lines freq_hz (F,), with factors of its derivatives to P `parameters`, for many theta.

    Without the aliases of ZOH torques (`zoh_aliases`); aliases within loops of references are computed at `aliases_at`
    (n_theta,).  Raises KeyError for a name that the model does not have.
    """

    model: LinearModel
    freq_hz: FloatArray
    parameters: tuple[str, ...]
    aliases_at: FloatArray | None = None

    def __post_init__(self) -> None:
        for name in self.parameters:
            if name not in self.model.parameters:
                raise KeyError(f"the model has no parameter {name}; there are {', '.join(self.model.parameters)}")

    def response(self, theta: FloatArray) -> ComplexArray:
        """Return G (F, n_y, n_u) at theta (n_theta,)."""
        return np.concatenate([products.G for products in self.products(theta, np.zeros((self.model.n, 0)))])

    @cached_property
    def places(self) -> IntArray:
        """Indices of the `parameters` in theta (P,)."""
        return np.array([self.model.parameters.index(name) for name in self.parameters], np.int64)

    @cached_property
    def factors(self) -> tuple[str, ...]:
        """Names of parameters that do not change Z but multiply the response: delay, lag elements, gains."""
        delay = (DELAY,) if self.model.is_delayed else ()
        names = (*delay, *(element.name for element in self.model.chain), *self.model.channel_numbers)
        return tuple(name for name in self.parameters if name in names)

    def factor_slopes(self, theta: FloatArray, band: Products) -> Iterator[ComplexArray]:
        """Yield dG / d theta_p (F, n_y, n_u) of each of the `factors` on a block of lines."""
        elements, s, loop = {element.name: element for element in self.model.chain}, band.s[:, None, None], band.loop
        G = band.G if loop is None else loop.T  # aliases are constant
        of_gains = {f"gain_{role}_": gain for gain, role in enumerate(GAINS)}
        for name in self.factors:
            number = self.model.number(theta, name)
            if loop is not None and name[:8] in of_gains:
                yield loop.of_gain(of_gains[name[:8]], name[8:].replace("_", " ", 1))
            elif name in self.model.channel_numbers:
                yield self._channel_slope(name, number, s) * G
            else:
                slope = -s if name == DELAY else elements[name].log_slope(band.s, number)[:, None, None]
                inside = loop if name in (DELAY, TORQUE_LAG) else None
                yield slope * (G if inside is None else inside.change(inside.plain, inside.motors))

    def _channel_slope(self, name: str, number: float, s: ComplexArray) -> ComplexArray | FloatArray:
        """Return d ln G / d theta_p (n_y, n_u) or (F, n_y, n_u) of a number of one channel, or of all of a role."""
        kind = next(kind for kind in CHANNEL_NUMBERS if name.startswith(kind))
        rows, columns = (
            np.array([name in (channel_name(kind, role), channel_name(kind, role, location)) for location in locations])
            for role, locations in (("y", self.model.outputs), (self.model.input_role, self.model.driven))
        )
        is_in = rows[:, None] * 1.0 + (columns if self.model.controller is not None else -1.0 * columns)
        if kind == "gain":
            return is_in / number
        return is_in * (-s if kind == "delay" else -s / (1 + s * abs(number)))

    @cached_property
    def output_columns(self) -> IntArray:
        """Index in `Products.YX` of the right-hand side of each output, tilt included."""
        sides = self._sides
        columns = sides.columns.copy()
        columns[sides.tilted] = sides.tilts + len(sides.tilts)
        return columns

    @cached_property
    def output_parameters(self) -> tuple[str, ...]:
        """Those `parameters` that change C, T or B: geometry between the springs and a sensor or force."""
        names = self.model.output_parameters
        return tuple(name for name in self.parameters if name in names)

    def products(self, theta: FloatArray, Y: FloatArray) -> Iterator[Products]:
        """Yield the products at theta (n_theta,) with directions Y (n, n_d), one block of lines at a time."""
        model = self.model
        M, D, K = model.matrices(theta)
        (C, T), tilted = model.readout(theta), self._sides.tilted
        right = np.column_stack([*model.input_matrix(theta).T, *C[self._sides.extra], *T[tilted]])
        n_d, n_y, n_u = Y.shape[1], len(C), model.B.shape[1]
        control_inputs = () if model.controller is None else (model.B,)
        sides, n_t = np.hstack([Y, C.T, T[tilted].T, *self._slope_rows, *control_inputs]), n_y + len(tilted)
        for start in range(0, self.freq_hz.size, BLOCK):
            block = slice(start, start + BLOCK)
            omega = 2 * np.pi * self.freq_hz[block]
            s = (1j * omega).astype(complex)
            products = self._elimination.products if self.takes_compiled else solved_products
            solution = products(M, D, K, omega, right, sides)
            gain = factor(model, theta, s)
            by_inputs, YX = solution[:, :n_u, n_d:], solution[:, :, :n_d]
            G = gain[:, None, None] * by_inputs[:, :, :n_y]
            if tilted.size:
                over = 1 / s[:, None, None] ** 2
                G[:, :, tilted] += gain[:, None, None] * over * by_inputs[:, :, n_y:n_t]
                YX = np.concatenate([YX, YX[:, self._sides.columns[tilted]] + over * YX[:, self._sides.tilts]], axis=1)
            output_slopes = np.zeros((len(self.output_parameters), len(s), n_y, n_u), complex)
            if self.output_parameters:
                rows = by_inputs[:, :, n_t : n_t + 2 * n_y * len(output_slopes)]
                dC, dT = rows.reshape(len(s), n_u, -1, 2, n_y).transpose(3, 2, 0, 4, 1)
                by_B = self._slope_columns(solution[:, :, n_d + n_t + rows.shape[2] :], s)
                output_slopes = gain[:, None, None] * (dC + dT / s[:, None, None] ** 2 + by_B)
            G, loop = G.swapaxes(1, 2), None
            if self._open_loops is not None:
                motors = factor(self._open_loops[1], theta, s)[:, None, None] * by_inputs[:, :, -n_u:].swapaxes(1, 2)
                images = (image[block] for image in self._torque_aliases)
                loop = close_loop(model, theta, self.freq_hz[block], G, motors, *images)
                output_slopes = model.channel_factors(theta, s)[0][..., None] * output_slopes @ loop.A
                G = loop.T + self._reference_aliases[block]
            elif model.channel_numbers:
                of_outputs, of_inputs = model.channel_factors(theta, s)
                channels = of_outputs[..., :, None] * of_inputs[..., None, :]
                G, output_slopes = channels * G, channels * output_slopes
            yield Products(block, s, gain, G, YX, output_slopes, loop)

    def sides(self, theta: FloatArray, band: Products) -> tuple[ComplexArray, ComplexArray]:
        """Return Y^T Z^-1 of the outputs (F, n_y, n_d) and of the inputs (F, n_u, n_d): dG = -c left dZ right^T."""
        n_m = self.model.B.shape[1]
        right = band.YX if band.YX.shape[1] == n_m else band.YX[:, :n_m]
        left = band.YX if np.array_equal(self.output_columns, np.arange(n_m)) else band.YX[:, self.output_columns]
        if not self.model.channel_numbers and band.loop is None:
            return left, right
        of_y, of_u = self.model.channel_factors(theta, band.s)
        if band.loop is None or self._open_loops is None:
            return of_y[..., None] * left, of_u[..., None] * right
        ratio = (factor(self._open_loops[1], theta, band.s) / band.gain)[:, None, None]
        return of_y[..., None] * left - ratio * (band.loop.L @ right), band.loop.A.mT @ right

    @cached_property
    def _open_loops(self) -> tuple[LinearModel, LinearModel] | None:
        return None if self.model.controller is None else open_loops(self.model)

    @cached_property
    def _torque_aliases(self) -> list[ComplexArray]:
        """Aliases of the controllers' torques in outputs and motors (F, n, n_m)."""
        return [zoh_aliases(model, self._theta_of_aliases, self.freq_hz) for model in self._open_loops or ()]

    @cached_property
    def _reference_aliases(self) -> ComplexArray:
        """Aliases of the references (F, n_y, n_u)."""
        return reference_aliases(self.model, self._theta_of_aliases, self.freq_hz)

    @property
    def _theta_of_aliases(self) -> FloatArray:
        return self.model.theta_ref if self.aliases_at is None else self.aliases_at

    @cached_property
    def _slope_rows(self) -> tuple[FloatArray, ...]:
        """dC^T and dT^T (n, n_y) of each of `output_parameters`, then dB (n, n_u) if it changes B."""
        zero, slopes = np.zeros(self.model.C.shape), [self.model.slopes[name] for name in self.output_parameters]
        rows = [(zero if matrix is None else matrix).T for slope in slopes for matrix in (slope.C, slope.T)]
        return (*rows, *(slope.B for slope in slopes if slope.B is not None))

    def _slope_columns(self, products: ComplexArray, s: ComplexArray) -> ComplexArray:
        """Return (C + T / s^2) Z^-1 dB (n_m, F, n_y, n_u) from products (F, m, n_dB n_u) with the columns of all dB."""
        model, sides = self.model, self._sides
        moves = [model.slopes[name].B is not None for name in self.output_parameters]
        columns = np.zeros((len(moves), len(s), len(model.outputs), len(model.inputs)), complex)
        if any(moves):
            rows = products[:, sides.columns]
            rows[:, sides.tilted] += products[:, sides.tilts] / s[:, None, None] ** 2
            columns[moves] = rows.reshape(*rows.shape[:2], sum(moves), -1).transpose(2, 0, 1, 3)
        return columns

    @cached_property
    def _elimination(self) -> "Elimination":
        """Elimination of Z X = B for any theta, from the pattern of possibly nonzero entries of Z."""
        model = self.model
        slopes = [matrix for s in model.slopes.values() for matrix in (s.M, s.D, s.K) if matrix is not None]
        return Elimination.of(np.any(np.array([model.M, model.D, model.K, *slopes]) != 0, axis=0))

    @cached_property
    def takes_compiled(self) -> bool:
        """True if Z is factorised, and the sums of a fit are formed, in C."""
        return is_compiled()

    @cached_property
    def _sides(self) -> Sides:
        """Distinct right-hand sides: outputs in the direction of an input or of another output share its solution."""
        model = self.model

        def with_slopes(letter: str) -> FloatArray:
            matrix = getattr(model, letter)
            slopes = (getattr(model.slopes[name], letter) for name in model.output_parameters)
            return np.array([matrix, *(0 * matrix if slope is None else slope for slope in slopes)])

        C, T, B = map(with_slopes, "CTB")
        sides, m = np.concatenate([B.transpose(2, 0, 1), C.transpose(1, 0, 2)]), B.shape[2]
        first = (sides[m:, None] == sides).all(axis=(2, 3)).argmax(axis=1)
        extra = np.flatnonzero(first == m + np.arange(len(first)))
        columns = np.where(first < m, first, m + np.searchsorted(extra, first - m))
        tilted = np.flatnonzero(T.any(axis=(0, 2)))
        return Sides(extra, columns, tilted, m + len(extra) + np.arange(len(tilted)))


@dataclass(frozen=True)
class Elimination:
    """Elimination order (n,), and the pattern (n, n) of nonzeros of L^T above its diagonal in this order."""

    order: IntArray
    pattern: BoolArray

    @classmethod
    def of(cls, coupled: BoolArray) -> "Elimination":
        """Return the elimination order of a pattern (n, n) of coupled coordinates, fewest couplings first."""
        return _elimination(coupled.tobytes(), len(coupled))

    def products(
        self, M: FloatArray, D: FloatArray, K: FloatArray, omega: FloatArray, B: FloatArray, Y: FloatArray
    ) -> ComplexArray:
        """Return B^T Z^-1 Y (F, m, n_d) of Z = K + j omega D - omega^2 M, real B (n, m), Y (n, n_d).

        Raises LinAlgError where Z is singular.
        """
        later, n_columns, indices = self._later
        products = np.empty((Y.shape[1], B.shape[1], len(omega)), complex)
        smallest, sizes = np.empty(len(omega)), (len(omega), *B.shape, Y.shape[1])
        B_ordered, Y_ordered = B.take(self.order, axis=0), Y.take(self.order, axis=0)
        matrices = (matrix.take(indices) for matrix in (M, D, K))
        call("eliminate", *sizes, *matrices, B_ordered, omega, later, n_columns, Y_ordered, products, smallest)
        weak = np.flatnonzero(~(smallest > MIN_PIVOT**2))  # not above: NaN too
        if len(weak):
            products[:, :, weak] = solved_products(M, D, K, omega[weak], B, Y).T
        return products.T

    @cached_property
    def _later(self) -> tuple[IntArray, IntArray, IntArray]:
        """Nonzero columns of each row of L^T, first in the rows (n, n), their numbers (n,), and matrix indices (n, n).

        The indices map entries in elimination order to entries of a matrix.
        """
        later = np.argsort(~self.pattern, axis=1, kind="stable").astype(np.int64)
        return later, self.pattern.sum(axis=1), self.order[:, None] * len(self.order) + self.order


@lru_cache(maxsize=64)
def _elimination(coupled: bytes, n: int) -> Elimination:
    acts = np.frombuffer(coupled, bool).reshape(n, n)
    acts = (acts | acts.T) & ~np.eye(n, dtype=bool)
    pattern, remaining, order = np.zeros_like(acts), np.ones(n, dtype=bool), []
    while remaining.any():
        k = int(np.argmin(np.where(remaining, (acts & remaining).sum(axis=1), n)))
        remaining[k] = False
        pattern[k] = acts[k] & remaining
        acts |= np.outer(pattern[k], pattern[k]) & ~np.eye(n, dtype=bool)
        order.append(k)
    indices = np.array(order, np.int64)
    return Elimination(indices, pattern[np.ix_(indices, indices)])


def solved_products(
    M: FloatArray, D: FloatArray, K: FloatArray, omega: FloatArray, B: FloatArray, Y: FloatArray
) -> ComplexArray:
    """Return B^T Z^-1 Y (F, b, k) by LAPACK; Z = K + j omega D - omega^2 M, omega (F,) in rad/s."""
    Z, of_lines = np.empty((len(omega), *K.shape), complex), omega[:, None, None]
    np.subtract(K, of_lines**2 * M, out=Z.real)
    np.multiply(of_lines, D, out=Z.imag)
    X = np.linalg.solve(Z, B.astype(complex)).transpose(1, 2, 0)
    # One real product, since Y is real and can have thousands of columns.
    real = np.ascontiguousarray(X).reshape(len(Y), -1).view(np.float64)
    return (Y.T @ real).view(np.complex128).reshape(-1, *X.shape[1:]).T
