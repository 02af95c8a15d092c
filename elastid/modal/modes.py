r"""Modes of one response: natural frequencies, damping ratios and shapes with standard deviations; state space.

Modal assurance criterion (MAC) and modal phase collinearity (MPC) of shapes:

.. math:: \mathrm{MAC}(\phi, \psi) = \frac{|\phi^H \psi|^2}{\phi^H \phi\; \psi^H \psi}, \qquad
          \mathrm{MPC}(\phi) = \left( \frac{\sigma_1^2 - \sigma_2^2}{\sigma_1^2 + \sigma_2^2} \right)^2,\quad
          \sigma: [\mathrm{Re}\,\phi\;\; \mathrm{Im}\,\phi]

The complex mode indicator functions (CMIF) are the singular values of G at each line.  (Allemang, Sound and Vibration
37, 2003; Pappa, Elliott and Schenk, J. Guidance, Control and Dynamics 16, 1993; Shih, Tsuei, Allemang and Brown, Mech.
Syst. Signal Processing 2, 1988.)
"""

from collections.abc import Sequence
from dataclasses import field
from functools import reduce
from typing import Any, TypeAlias, cast

import numpy as np
from scipy.linalg import block_diag

from elastid.base.arrays import ComplexArray, FloatArray, frozen_value, labelled, laplace_variable
from elastid.base.display import Display, as_html, as_text, digits, number, percent
from elastid.base.errors import Note
from elastid.base.escape import control_labels
from elastid.base.statistics import QUANTILE_95
from elastid.linear.linear_model import StateSpace
from elastid.modal.poles import StabilisationDiagram
from elastid.record import Configuration, Motion
from elastid.response import Response


@frozen_value
class Modes:
    """n modes of one response, by rising frequency.

    freq_hz, zeta (n,) with standard deviations.  shapes (n_y, n): complex, the largest entry 1.  participation (n_u,
    n): residue = shape participation^T, in rad/s times the unit of G.  collinearity (n,): MPC at `places`.
    at_hz (F,), synthesis (F, n_y, n_u): modal model at the lines.  relative_std (F,): standard deviation of G over
    |G|, both rms over elements.  indicators (F, rank): CMIF.  covariance (2 n, 2 n): of f_1, zeta_1, f_2 ...
    """

    configuration: str
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    quantity: Motion
    unit: str
    has_rate: bool
    freq_hz: FloatArray = labelled("natural frequency", "Hz")
    freq_std: FloatArray = labelled("its standard deviation", "Hz")
    zeta: FloatArray = labelled("damping ratio")
    zeta_std: FloatArray = labelled("its standard deviation")
    shapes: ComplexArray = labelled("mode shapes, the largest entry 1", "", "outputs mode")
    shape_std: FloatArray = labelled("standard deviation of shapes", "", "outputs mode")
    participation: ComplexArray = labelled("participation of inputs", "", "inputs mode")
    participation_std: FloatArray = labelled("its standard deviation over its largest entry", "", "inputs mode")
    collinearity: FloatArray = labelled("modal phase collinearity")
    at_hz: FloatArray = labelled("lines", "Hz")
    synthesis: ComplexArray = labelled("response of the modal model", "{unit}", "at_hz outputs inputs")
    relative_std: FloatArray = labelled("relative standard deviation of the response")
    indicators: FloatArray = labelled("complex mode indicator functions", "{unit}", "at_hz rank")
    diagram: StabilisationDiagram
    covariance: FloatArray = labelled("covariance of frequency and damping of each mode", "Hz, 1", "number number")
    notes: tuple[Note, ...] = field(default=())

    __repr__, _repr_html_ = as_text, as_html

    @property
    def most_alike(self) -> list[tuple[int, float]]:
        """For each mode, the mode with the most similar shape and their MAC; empty for one mode or one location."""
        if self.n_modes < 2 or len(self.places) < 2:
            return []
        similarity = mac(self.place_shapes[0], self.place_shapes[0]) - 2 * np.eye(self.n_modes)
        return [(int(k), float(row[k])) for row, k in zip(similarity, similarity.argmax(axis=1), strict=True)]

    @property
    def display(self) -> Display:
        """Frequency and damping of each mode with their intervals."""
        rows = []
        for f, f_std, zeta, zeta_std, mpc in zip(
            self.freq_hz, self.freq_std, self.zeta, self.zeta_std, self.collinearity, strict=True
        ):
            f_digits, zeta_digits = digits(f, f_std), digits(zeta, zeta_std)
            rows.append((number(f, f_digits), number(QUANTILE_95 * f_std, 2), percent(zeta, zeta_digits),
                         percent(QUANTILE_95 * zeta_std, 2), number(mpc, 3)))  # fmt: skip
        head = (f"frequency in {self.frequency_unit}", "+- 95 %", "damping", "+- 95 %", "phase collinearity")
        return Display(f"{len(rows)} modes of {self.configuration}", head, rows)

    @property
    def places(self) -> tuple[str, ...]:
        """Locations of mode shapes: the outputs, or the inputs if there are more (roving hammer, by reciprocity)."""
        return self.inputs if len(self.inputs) > len(self.outputs) else self.outputs

    @property
    def place_shapes(self) -> tuple[ComplexArray, FloatArray]:
        """Shapes (n_places, n) at `places`, the largest entry 1, and their standard deviations."""
        if self.places == self.outputs:
            return self.shapes, self.shape_std
        largest = np.abs(self.participation).argmax(axis=0)
        return self.participation / np.take_along_axis(self.participation, largest[None], 0), self.participation_std

    @property
    def frequency_unit(self) -> str:
        """Unit of frequencies: Hz, or cycles per sample for a response with unknown rate."""
        return "Hz" if self.has_rate else "of the sampling rate"

    @property
    def n_modes(self) -> int:
        """Number of modes n."""
        return len(self.freq_hz)

    @property
    def poles(self) -> ComplexArray:
        """Poles lambda (n,) with positive frequency, in 1/s."""
        return 2 * np.pi * self.freq_hz * (-self.zeta + 1j * np.sqrt(1 - self.zeta**2))

    def state_space(self, residual: bool = True) -> StateSpace:
        r"""Return a real state-space model: two states for each mode, and residual terms of modes outside the band.

        .. math:: A_r = \begin{bmatrix} \sigma & -\omega \\ \omega & \sigma \end{bmatrix}, \quad
                  B_r = \begin{bmatrix} \mathrm{Re}\, L_r^T \\ \mathrm{Im}\, L_r^T \end{bmatrix}, \quad
                  C_r = 2\, [\mathrm{Re}\, \psi_r \;\; -\mathrm{Im}\, \psi_r], \qquad
                  \lambda_r = \sigma + j \omega, \quad R_r = \psi_r L_r^T

        The residual terms are D and three pole pairs outside the band, fitted by relative least squares.
        residual: False for the modes alone.  Time is in samples for a response with unknown rate.
        """
        psi, L, n_u = self.shapes, self.participation, len(self.inputs)
        blocks = [np.array([[pole.real, -pole.imag], [pole.imag, pole.real]]) for pole in self.poles]
        B = np.stack([L.T.real, L.T.imag], axis=1).reshape(-1, n_u)
        C = 2 * np.stack([psi.real, -psi.imag], axis=2).reshape(len(psi), -1)
        D, sections = self._residual() if residual else (np.zeros((len(psi), n_u)), [])
        for (_, damping, stiffness), slope, offset in sections:  # of x'' + damping x' + stiffness x = u
            blocks.append(np.kron([[0.0, 1.0], [-stiffness, -damping]], np.eye(n_u)))
            B = np.vstack([B, np.zeros((n_u, n_u)), np.eye(n_u)])
            C = np.hstack([C, offset, slope])
        A, configuration = block_diag(np.zeros((0, 0)), *blocks), Configuration(self.configuration, np.zeros(0))
        return StateSpace(configuration, A, B, C, D, 0.0, self.inputs, self.outputs, self.quantity)

    def _residual(self) -> tuple[FloatArray, "list[_Section]"]:
        """Fit D (n_y, n_u) and three sections of second order to the synthesis minus the modes."""
        freq_hz, G = self.at_hz, self.synthesis
        s = laplace_variable(freq_hz)
        ends = 2 * np.pi * np.array([freq_hz[0] * _OUTSIDE[0], *(freq_hz[-1] * x for x in _OUTSIDE[1:])])
        polynomials = [(1.0, 2 * _OUTSIDE_DAMPING * w, w**2) for w in ends.tolist()]
        columns = [np.ones(len(s), complex)]
        for w, polynomial in zip(ends, polynomials, strict=True):
            columns += [x / np.polyval(polynomial, s) for x in (w * s, np.full(len(s), w**2))]
        weight = 1 / np.sqrt(np.mean(np.abs(G) ** 2, axis=(1, 2)))
        X = np.stack(columns, axis=1) * weight[:, None]
        remainder = (G - self.state_space(residual=False).response(freq_hz)).reshape(len(s), -1) * weight[:, None]
        a = np.linalg.lstsq(np.vstack([X.real, X.imag]), np.vstack([remainder.real, remainder.imag]), rcond=None)[0]
        D, *blocks = a.reshape(-1, *G.shape[1:])
        triples = zip(ends, polynomials, blocks[::2], blocks[1::2], strict=True)
        return D, [(polynomial, w * slope, w**2 * offset) for w, polynomial, slope, offset in triples]

    def transfer_polynomials(self, residual: bool = True) -> tuple[FloatArray, FloatArray]:
        """Return numerators (n_y, n_u, m) and common denominator (m,) of `state_space`, the highest power of s first.

        With more than about ten modes, double precision does not suffice for the coefficients; prefer `state_space`.
        """
        D, sections = self._residual() if residual else (np.zeros((len(self.outputs), len(self.inputs))), [])
        for pole, residue in zip(self.poles, np.einsum("ir,jr->rij", self.shapes, self.participation), strict=True):
            offset = -2 * (residue * pole.conjugate()).real
            sections = [*sections, ((1.0, -2 * pole.real, abs(pole) ** 2), 2 * residue.real, offset)]
        factors = [np.array(section[0]) for section in sections]
        denominator = _product(factors)
        numerators = D[:, :, None] * denominator
        for k, (_, slope, offset) in enumerate(sections):
            product = _product([*factors[:k], *factors[k + 1 :]])
            numerators[:, :, 1:-1] += slope[:, :, None] * product
            numerators[:, :, 2:] += offset[:, :, None] * product
        return numerators, denominator

    def transfer_function(self, residual: bool = True) -> Any:
        """Return `transfer_polynomials` as `control.TransferFunction`."""
        import control  # takes a second or two

        numerators, denominator = self.transfer_polynomials(residual)
        denominators = [[denominator for _ in self.inputs] for _ in self.outputs]
        labels = control_labels(self.configuration, self.inputs, self.outputs)
        return control.tf([list(row) for row in numerators], denominators, **labels)

    @property
    def state_space_error(self) -> float:
        """Rms difference between `state_space` and the synthesis at the lines, over the rms of the synthesis."""
        difference = self.state_space().response(self.at_hz) - self.synthesis
        return float(np.linalg.norm(difference) / np.linalg.norm(self.synthesis))

    def to_control(self, residual: bool = True) -> Any:
        """Return `state_space` as `control.StateSpace`."""
        return self.state_space(residual).to_control()

    @property
    def freq95(self) -> FloatArray:
        """95 % intervals (n, 2) of the frequencies."""
        return _interval(self.freq_hz, self.freq_std)

    @property
    def zeta95(self) -> FloatArray:
        """95 % intervals (n, 2) of the damping ratios."""
        return _interval(self.zeta, self.zeta_std)


def _product(factors: Sequence[FloatArray]) -> FloatArray:
    """Return the coefficients of a product of polynomials, the highest power first."""
    return reduce(cast(Any, np.polymul), factors, np.ones(1))


# Frequencies of the poles outside the band over the lowest line, and over the highest; their damping ratio.
_OUTSIDE, _OUTSIDE_DAMPING = (0.5, 1.3, 2.0), 0.2
# Denominator (3,) of second order, and the numerator's coefficients (n_y, n_u) of s and of 1.
_Section: TypeAlias = tuple[tuple[float, float, float], FloatArray, FloatArray]


def _interval(value: FloatArray, std: FloatArray) -> FloatArray:
    return np.stack([value - QUANTILE_95 * std, value + QUANTILE_95 * std], axis=1)


def without_modes(response: Response, note: Note) -> Modes:
    """Return `Modes` with no mode and with a note of the reason."""
    n_y, n_u = len(response.outputs), len(response.inputs)
    none, no_lines = np.empty(0), response.lines(np.zeros(response.n_lines, bool))
    diagram = StabilisationDiagram(np.empty(0, int), none, none, np.empty(0, bool))
    return Modes(
        response.configuration.name, response.inputs, response.outputs, response.quantity, response.unit,
        response.has_rate, none, none, none, none, np.empty((n_y, 0), complex), np.empty((n_y, 0)),
        np.empty((n_u, 0), complex), np.empty((n_u, 0)), none, no_lines.freq_hz, no_lines.G, none,
        np.empty((0, min(n_y, n_u))), diagram, np.zeros((0, 0)), (note,),
    )  # fmt: skip


def mac(first: ComplexArray, second: ComplexArray) -> FloatArray:
    """Return MAC (n, m) of shapes (n_y, n) and (n_y, m): 1 for proportional shapes; ValueError for different n_y.

    >>> mac(np.array([[1.0], [2.0]]), np.array([[1j, 2.0], [2j, -1.0]])).round(3).tolist()
    [[1.0, 0.0]]
    """
    a, b = first, second
    if a.ndim != 2 or b.ndim != 2 or len(a) != len(b):
        raise ValueError(f"shapes are {a.shape} and {b.shape}; give (n_y, n) and (n_y, m) of the same outputs")
    norms = np.sum(np.abs(a) ** 2, axis=0)[:, None] * np.sum(np.abs(b) ** 2, axis=0)
    return np.asarray(np.abs(a.conj().T @ b) ** 2 / np.maximum(norms, np.finfo(float).tiny))


def phase_collinearity(shapes: ComplexArray) -> FloatArray:
    """Return MPC (n,) of shapes (n_y, n): 1 if all entries have the same or the opposite phase.

    >>> phase_collinearity(np.array([[1 + 1j, 1.0], [2 + 2j, 1j]])).round(3).tolist()
    [1.0, 0.0]
    """
    s = np.linalg.svd(np.stack([shapes.T.real, shapes.T.imag], axis=1), compute_uv=False)
    if s.shape[1] < 2:
        return np.ones(len(s))
    power = s**2
    return np.asarray(((power[:, 0] - power[:, 1]) / np.maximum(power.sum(axis=1), np.finfo(float).tiny)) ** 2)
