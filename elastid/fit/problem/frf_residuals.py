r"""FRF residuals: responses and linear models of all configurations as one LeastSquares.

.. math:: V(x) = \sum_i \sum_k \sum_{ab} 2 \frac{|e^{(i)}_{ab}(k; \theta(x))|^2}{\sigma^{(i)}_{ab}(k)^2}
          + \text{priors}

Cost, J^T r and J^T J are summed over configurations, without stacking J. Chunks of neighbouring configurations are
summed in a fixed order, so that the sums are bit-identical for any number of processes.
"""

import math
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import chain
from typing import TYPE_CHECKING, Any

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray, frozen
from elastid.base.errors import DataError
from elastid.base.execution import SERIAL, Execution, Item, Value
from elastid.base.messages import WorkerConstant
from elastid.fit.problem.compressed_residuals import CompressedResiduals, NormalEquations
from elastid.fit.problem.inertia_barrier import BodyInertia, barrier, border_metric
from elastid.fit.problem.least_squares import Evaluation, LeastSquares, ResidualKind, difference, error_gain
from elastid.fit.problem.weights import Weights, Whitening
from elastid.linear.linear_model import LinearModel, is_load
from elastid.linear.linearise import Linearisation
from elastid.linear.ports import Ports, between_ports, port_motion
from elastid.linear.response.derivatives import Columns
from elastid.linear.response.kernel import Kernel
from elastid.linear.response.transfer import zoh_aliases
from elastid.parameters import Parameters
from elastid.record import REFERENCE
from elastid.response import Response

if TYPE_CHECKING:
    from elastid.fit.problem.static_loads import StaticLoads  # of studies with load tests

CHUNK = 4  # configurations
MIN_LINES = 5_000  # least number of lines of all configurations for an evaluation in several processes


@dataclass(frozen=True, eq=False)
class FrfResiduals(WorkerConstant):
    """Residuals of the FRF of one configuration.

    columns: of its linear model.  measured (F, n_y, n_u): without the aliases of ZOH torques, which the model predicts.
    gain (F, n_y, n_u): sqrt(2) / sigma of the residual, 0 for excluded elements.  whitening: of gain e for a line with
    correlated elements; None for uncorrelated ones.  compressed: residuals of the same data and weights with another
    linearisation, if computed.
    """

    columns: Columns
    measured: ComplexArray
    gain: FloatArray
    criterion: ResidualKind
    whitening: Whitening | None = None
    compressed: CompressedResiduals | None = None

    @classmethod
    def of(
        cls, response: Response, model: LinearModel, weights: Weights, parameters: Parameters, criterion: ResidualKind
    ) -> "FrfResiduals":
        """Return the residuals of one configuration; arguments as `elastic_fit`."""
        model = at_measured_places(model, response)
        columns = Columns(kernel_of(model, parameters, response.freq_hz))
        return cls.weighted(
            columns, zoh_aliases(model, model.theta_ref, response.freq_hz), response, weights, criterion
        )

    @classmethod
    def weighted(
        cls, columns: Columns, images: ComplexArray, response: Response, weights: Weights, criterion: ResidualKind
    ) -> "FrfResiduals":
        """Return the residuals with the columns of a model.  images (F, n_y, n_u): aliases of ZOH torques."""
        kernel, is_used = columns.kernel, weights.is_used
        if criterion == "log":
            # The logarithm of a noisy element is biased: elements must exceed their std by 6 dB.
            G = kernel.response(kernel.model.theta_ref)
            is_used = is_used & (np.abs(G) > 1e-12 * np.abs(G).max()) & (np.abs(response.G) > 2.0 * weights.sigma)
        with np.errstate(divide="ignore", invalid="ignore"):
            slope = np.where(is_used, error_gain(criterion, response.G), 1.0)
        gain = np.sqrt(2 * weights.factor) / np.where(is_used, np.abs(slope) * weights.sigma, np.inf)
        whitening = None
        if weights.correlated is not None and criterion == "complex":
            whitening = Whitening(weights.correlated, weights.model_error, response.G, weights.sigma)
        # Without aliases use the array of the response itself, which the workers already have.
        plain = response.G - images if images.any() else response.G
        frf = cls(columns, frozen(plain, np.complex128), frozen(gain), criterion, whitening)
        return replace(frf, compressed=frf.normal.residuals)

    @property
    def kernel(self) -> Kernel:
        """Kernel of the model."""
        return self.columns.kernel

    @property
    def configuration(self) -> str:
        """Name of the configuration."""
        return self.kernel.model.configuration.name

    def theta(self, parameters: Parameters, x: FloatArray) -> FloatArray:
        """Return theta (n_theta,) in this configuration at x (n_x,)."""
        return parameters.expand(x, self.configuration)

    def chain(self, parameters: Parameters, x: FloatArray) -> FloatArray:
        """Return d theta / d x (P, n_x) of the P parameters of the kernel."""
        return parameters.jacobian(x, self.configuration)[self.kernel.places]

    @property
    def error_gain(self) -> ComplexArray:
        """Residual per error of Ghat (F, n_y, n_u) before whitening; 0 for excluded elements."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(self.gain > 0, self.gain * error_gain(self.criterion, self.measured), 0j)

    @property
    def mixing(self) -> ComplexArray | None:
        """Whitening matrix (F, n_y n_u, n_y n_u) of the errors of a line in the order of G, computed at each call."""
        return None if self.whitening is None else self.whitening.matrix

    @cached_property
    def normal(self) -> NormalEquations:
        """Normal equations, computed without the derivatives of every element."""
        form = self.columns.elements, self.columns.entries, self.kernel.takes_compiled
        residuals = CompressedResiduals(*form, self.measured, self.gain, self.criterion, self.whitening)
        data = self.compressed
        return NormalEquations(self.columns, data if data is not None and data.has_data_of(residuals) else residuals)

    @property
    def n_residuals(self) -> int:
        """Number of real residuals, two per used element."""
        return 2 * int(np.count_nonzero(self.gain))

    @property
    def for_sums(self) -> "FrfResiduals":
        """The residuals for `normal` alone, without the covariance of each line, which needs most memory."""
        residuals = self.normal.residuals.without_whitening
        return replace(self, whitening=residuals.whitening, compressed=residuals)

    def linearised(self, model: LinearModel) -> "FrfResiduals":
        """Return the residuals of the same data and weights with another linear model."""
        return replace(self, columns=Columns(replace(self.kernel, model=model, aliases_at=model.theta_ref)))

    def residual(self, G: ComplexArray, mixing: ComplexArray | None) -> ComplexArray:
        """Return r (F, n_y, n_u) at a response G of the model; real and imaginary parts have unit variance each.

        mixing: `FrfResiduals.mixing`.
        """
        e, is_used = difference(self.criterion, self.measured, G), self.gain > 0
        return apply_mixing(mixing, np.where(is_used, self.gain * np.where(is_used, e, 0.0), 0.0))

    def slopes(self, G: ComplexArray, dG: ComplexArray, mixing: ComplexArray | None) -> ComplexArray:
        """Return dr (n, F, n_y, n_u) by changes dG of a response G."""
        # Excluded elements can be zero, where the logarithm has no derivative.
        return apply_mixing(mixing, -self.gain * np.where(self.gain > 0, error_gain(self.criterion, G), 0.0) * dG)


def apply_mixing(mixing: ComplexArray | None, values: ComplexArray) -> ComplexArray:
    """Apply the matrix `mixing`, if not None, to the elements of each line of values (..., F, n_y, n_u)."""
    if mixing is None:
        return values
    flat = values.reshape(-1, len(mixing), mixing.shape[1])
    return (mixing @ flat.transpose(1, 2, 0)).transpose(2, 0, 1).reshape(values.shape)


@dataclass(frozen=True, eq=False)
class Chunk(WorkerConstant):
    """Residuals of neighbouring configurations, evaluated in one process."""

    parameters: Parameters
    frfs: tuple[FrfResiduals, ...]

    def sums(self, x: FloatArray, precision: type[np.floating[Any]]) -> tuple[float, FloatArray, FloatArray]:
        """Return V, J^T r (n_x,) and J^T J (n_x, n_x) at x; precision: of J^T J."""
        V, g, A = 0.0, np.zeros(len(x)), np.zeros((len(x), len(x)))
        numbers: dict[str, tuple[FloatArray, FloatArray]] = {}  # equal for most configurations
        with np.errstate(all="ignore"):
            for frf in self.frfs:
                name = self.parameters.configuration_of_stand_in(frf.configuration)
                if name not in numbers:
                    numbers[name] = self.parameters.expand(x, name), self.parameters.jacobian(x, name)
                theta, slopes = numbers[name]
                T = slopes[frf.kernel.places]
                cost, gradient, normal = frf.normal.at(theta, precision)
                V, g, A = V + cost, g + T.T @ gradient, A + T.T @ normal @ T
        return V, g, A


def chunked(items: Sequence[Item]) -> list[tuple[Item, ...]]:
    """Divide items, one per configuration, into chunks of CHUNK neighbours."""
    return [tuple(items[first : first + CHUNK]) for first in range(0, len(items), CHUNK)]


def chunk_execution(responses: Sequence[Response], execution: Execution) -> Execution:
    """Return the execution of chunks: other processes if there are many chunks; else processes share the starts."""
    is_large = sum(response.n_lines for response in responses) >= MIN_LINES
    is_large &= len(chunked(responses)) >= 2 * execution.jobs
    return Execution(execution.jobs) if is_large and execution.is_shared(len(responses)) else SERIAL


def map_chunks(function: Callable[[Item], Value], items: Sequence[Item], home: Execution) -> Iterator[Value]:
    """Apply a function to each configuration's item, in the process that already has the data of its chunk."""
    return chain.from_iterable(home.with_affinity(partial(_map_chunk, function), chunked(items)))


def _map_chunk(function: Callable[[Item], Value], chunk: Sequence[Item]) -> list[Value]:
    return [function(item) for item in chunk]


@dataclass(frozen=True, eq=False)
class ElasticFit:
    """Residuals of all configurations as functions of one set of parameters; it can be pickled for other processes.

    inertias: bodies whose inertia must stay physically consistent.  loads: static load tests, None without any.
    home: execution of the chunks.
    """

    parameters: Parameters
    frfs: tuple[FrfResiduals, ...]
    inertias: tuple[BodyInertia, ...] = ()
    loads: "StaticLoads | None" = None
    home: Execution = SERIAL

    def evaluated_by(self, execution: Execution) -> Execution:
        """Return the execution of repeated evaluations: sequential if the chunks are distributed over processes."""
        return replace(execution, jobs=0) if self.home.jobs else execution

    @property
    def n_residuals(self) -> int:
        """Number of real residuals."""
        return sum(frf.n_residuals for frf in self.frfs) + (0 if self.loads is None else self.loads.n_residuals)

    @property
    def problem(self) -> LeastSquares:
        """Least-squares problem for a solver."""
        border = partial(border_metric, self.inertias, self.parameters) if self.inertias else None
        return LeastSquares(self.parameters, self.n_residuals, _Rough(self), border)

    def evaluate(self, x: FloatArray, precision: type[np.floating[Any]] = np.float64) -> Evaluation:
        """Return V, its gradient and 2 J^T J at x (n_x,); V is infinite where the model has no response."""
        try:
            chunk_sums = self.home.with_affinity(partial(Chunk.sums, x=x, precision=precision), self.chunks)
            V, g, A = (sum(terms) for terms in zip(*chunk_sums, strict=True))  # in the order of the chunks
            r, J = self.static(x)
        except np.linalg.LinAlgError:
            return Evaluation(math.inf, np.zeros(len(x)), np.eye(len(x)))
        distance, slope = self.parameters.priors(x)
        b, b_slope, b_curvature = barrier(self.inertias, self.parameters, x)
        V, g, A = V + float(r @ r) + float(distance @ distance), g + J.T @ r + slope * distance, A + J.T @ J
        return Evaluation(V + b, 2 * g + b_slope, 2 * (A + np.diag(slope**2)) + b_curvature)

    def rough(self, x: FloatArray) -> Evaluation:
        """Evaluate V at x (n_x,) with J^T J from single precision, enough for a step."""
        return self.evaluate(x, np.float32)

    @cached_property
    def chunks(self) -> tuple[Chunk, ...]:
        """Chunks of neighbouring configurations."""
        return tuple(Chunk(self.parameters, frfs) for frfs in chunked(self.frfs))

    def static(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return r (n,) and dr/dx (n, n_x) of the static load tests; LinAlgError without an equilibrium under them."""
        if self.loads is None:
            return np.zeros(0), np.zeros((0, len(x)))
        return self.loads.residual(self.parameters, x)

    def blocks(self, x: FloatArray) -> Iterator[tuple[ComplexArray, ComplexArray]]:
        """Yield the whitened r (F, n_y, n_u) and dr/dx (n_x, F, n_y, n_u) of each configuration."""
        return (self.block(frf, x, frf.mixing) for frf in self.frfs)

    def block(self, frf: FrfResiduals, x: FloatArray, mixing: ComplexArray | None) -> tuple[ComplexArray, ComplexArray]:
        """Return r (F, n_y, n_u) and dr/dx (n_x, F, n_y, n_u) of one configuration; mixing: `FrfResiduals.mixing`."""
        G, dG = frf.columns.evaluate(frf.theta(self.parameters, x))
        dr = frf.slopes(G, dG, mixing)
        return frf.residual(G, mixing), np.tensordot(frf.chain(self.parameters, x).T, dr, axes=1)


@dataclass(frozen=True, eq=False)
class _Rough:
    """`ElasticFit.rough`, pickled without the data that it does not need."""

    fit: ElasticFit

    def __call__(self, x: FloatArray) -> Evaluation:
        return self.fit.rough(x)

    def __reduce__(self) -> "tuple[type[_Rough], tuple[ElasticFit]]":
        return _Rough, (replace(self.fit, frfs=tuple(frf.for_sums for frf in self.fit.frfs)),)


def elastic_fit(
    responses: Sequence[Response], models: Sequence[LinearModel], weights: Sequence[Weights], parameters: Parameters,
    criterion: ResidualKind,
) -> ElasticFit:  # fmt: skip
    """Return the fit of `models` to `responses`, inputs and outputs matched by name.

    The logarithmic criterion discards elements below twice their sigma or without a response of the model (an axis that
    does not couple), and weights each element alone; the complex criterion weights correlated elements jointly, if the
    weights have their covariance.  Raises StudyError if the model lacks an input or output of a response.
    """
    triples = zip(responses, models, weights, strict=True)
    return ElasticFit(parameters, tuple(FrfResiduals.of(*triple, parameters, criterion) for triple in triples))


def at_measured_places(model: LinearModel, response: Response | LinearModel) -> LinearModel:
    """Return the model with the inputs, outputs, hold and controller of a response or of another model."""
    if all(getattr(model, name) == getattr(response, name) for name in ("inputs", "outputs", "hold", "controller")):
        return model
    loads = {port_motion(name) for name in response.inputs if is_load(name)}
    is_closed = response.controller is not None and model.controller is None
    references = tuple(f"{REFERENCE}{name[6:]}" for name in model.inputs) if is_closed else ()
    known_inputs = (
        *model.inputs,
        *references,
        *(name for name in response.inputs if is_load(name) and port_motion(name) in model.outputs),
    )
    locations = (("input", response.inputs, known_inputs), ("output", response.outputs, model.outputs))
    for kind, names, options in locations:
        if unknown := ", ".join(name for name in names if name not in options):
            text = f"the model has no {kind} {unknown}; there are {', '.join(options) or 'none'}"
            raise DataError("fit/responses", text, f"configuration {response.configuration.name}")
    if loads and model.inputs != response.inputs:
        model = between_ports(model, Ports.at_frames(model, response.inputs), response.motors, response.loop)
    acting_motors = response.controller.motors if response.controller is not None and is_closed else response.inputs
    B = model.B if model.controller is not None else model.B[:, [model.inputs.index(name) for name in acting_motors]]
    model, loop = model.with_outputs([model.outputs.index(name) for name in response.outputs]), response.controller
    return replace(model, B=B, inputs=response.inputs, hold=response.hold, controller=loop)


def linear_model(
    linearisation: Linearisation, response: Response, theta: FloatArray, varied: Collection[str] | None = None
) -> LinearModel:
    """Return the model at theta (n_theta,), which ends with the delay, with the inputs and outputs of a response.

    varied: as of `Linearisation.at`.
    """
    model = linearisation.at(response.configuration, theta[:-1], places_of(response), response.quantity, varied)
    return replace(at_measured_places(model, response), theta_ref=theta)


def places_of(response: Response | LinearModel) -> tuple[str, ...]:
    """Return the outputs of a response, and the motions on which its forces at frames do work."""
    return tuple(dict.fromkeys((*response.outputs, *(port_motion(name) for name in response.inputs if is_load(name)))))


def kernel_of(model: LinearModel, parameters: Parameters, freq_hz: FloatArray) -> Kernel:
    """Return the response of a model at the start on some lines, with derivatives to its parameters in x only."""
    if model.parameters != parameters.names:
        raise ValueError(f"the model has parameters {model.parameters}, the set {parameters.names}")
    name = model.configuration.name
    dependent, theta = parameters.dependent_names(name), parameters.expand(parameters.x, name)
    (M, D, K), (C, T) = model.matrices(theta), model.readout(theta)
    slopes = {p: model.slopes[p] for p in dependent if p in model.slopes}
    at_start = replace(model, theta_ref=theta, M=M, D=D, K=K, B=model.input_matrix(theta), C=C, T=T, slopes=slopes)
    return Kernel(at_start, freq_hz, dependent, model.theta_ref)
