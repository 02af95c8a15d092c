r"""FRF residuals: responses and linear models of all configurations as one LeastSquares.

.. math:: V(x) = \sum_i \sum_k \sum_{ab} 2 \frac{|e^{(i)}_{ab}(k; \theta(x))|^2}{\sigma^{(i)}_{ab}(k)^2}
          + \text{priors}

One configuration after the other: cost, J^T r and J^T J are summed up and J is never stacked. Chunks of
neighbouring configurations are summed in their order: the sums are equal to the last bit wherever a chunk is computed,
here or at a worker that has it.
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
from elastid.base.execution import HERE, Execution, Item, Value
from elastid.base.workers import WorkerConstant
from elastid.fit.problem.compressed_residuals import CompressedResiduals, NormalEquations
from elastid.fit.problem.inertia_barrier import BodyInertia, barrier, border_metric
from elastid.fit.problem.least_squares import Evaluation, LeastSquares, ResidualKind, difference, error_gain
from elastid.fit.problem.weights import Weights, Whitening
from elastid.linear.linear_model import LinearModel, is_load
from elastid.linear.linearise import Linearisation
from elastid.linear.ports import Ports, acted_on, port_motion
from elastid.linear.response.derivatives import Columns
from elastid.linear.response.kernel import Kernel
from elastid.linear.response.transfer import zoh_aliases
from elastid.parameters import Parameters
from elastid.record import REFERENCE
from elastid.response import Response

if TYPE_CHECKING:
    from elastid.fit.problem.static_loads import StaticLoads  # of studies with load tests

# Configurations of a chunk.
CHUNK = 4
# Lines of all configurations from which on an evaluation is worth the work of others.
MIN_LINES = 5_000


@dataclass(frozen=True, eq=False)
class Part(WorkerConstant):
    """One configuration: measured G (F, n_y, n_u), the columns of its model, and the scale of its residuals.

    measured: without the aliases of ZOH torques, by the model where it was linearised.
    gain (F, n_y, n_u): sqrt(2) / sigma of the residual, 0 where an element is left out.  whitening: of
    gain e of a line whose elements err together; None where they count one by one.  compressed: the residuals, where
    they are known of the very same data and weights, from a model linearised elsewhere.
    """

    columns: Columns
    measured: ComplexArray
    gain: FloatArray
    criterion: ResidualKind
    whitening: Whitening | None = None
    compressed: CompressedResiduals | None = None

    @property
    def kernel(self) -> Kernel:
        """The kernel of its model."""
        return self.columns.kernel

    @property
    def configuration(self) -> str:
        """The name of the configuration."""
        return self.kernel.model.configuration.name

    def theta(self, parameters: Parameters, x: FloatArray) -> FloatArray:
        """Return theta (n_theta,) in its configuration."""
        return parameters.expand(x, self.configuration)

    def chain(self, parameters: Parameters, x: FloatArray) -> FloatArray:
        """Return d theta / d x (P, n_x) of the parameters that x moves there: the kernel's order."""
        return parameters.jacobian(x, self.configuration)[self.kernel.places]

    @property
    def error_gain(self) -> ComplexArray:
        """Residual per error of Ghat (F, n_y, n_u), before it is mixed; 0 where an element is left out."""
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.where(self.gain > 0, self.gain * error_gain(self.criterion, self.measured), 0j)

    @property
    def mixing(self) -> ComplexArray | None:
        """Whitening matrix (F, n_y n_u, n_y n_u) of the errors of a line in the order of G, computed at each call."""
        return None if self.whitening is None else self.whitening.matrix

    @cached_property
    def normal(self) -> NormalEquations:
        """Cost, gradient and normal matrix without the derivatives of every element."""
        form = self.columns.elements, self.columns.entries, self.kernel.takes_compiled
        residuals = CompressedResiduals(*form, self.measured, self.gain, self.criterion, self.whitening)
        data = self.compressed
        return NormalEquations(self.columns, data if data is not None and data.has_data_of(residuals) else residuals)

    @property
    def n_residuals(self) -> int:
        """Real residuals, two an element."""
        return 2 * int(np.count_nonzero(self.gain))

    @property
    def for_sums(self) -> "Part":
        """The part for `normal` alone, without the covariances of its lines, most of its numbers."""
        residuals = self.normal.residuals.without_whitening
        return replace(self, whitening=residuals.whitening, compressed=residuals)

    def linearised(self, model: LinearModel) -> "Part":
        """Return the part with the same data and weights, and the columns of another linear model."""
        return replace(self, columns=Columns(replace(self.kernel, model=model, images_at=model.theta_ref)))

    def residual(self, G: ComplexArray, mixing: ComplexArray | None) -> ComplexArray:
        """Return r (F, n_y, n_u) at a response G of the model; real and imaginary parts have unit variance each.

        mixing: `Part.mixing`.
        """
        e, is_used = difference(self.criterion, self.measured, G), self.gain > 0
        return apply_mixing(mixing, np.where(is_used, self.gain * np.where(is_used, e, 0.0), 0.0))

    def slopes(self, G: ComplexArray, dG: ComplexArray, mixing: ComplexArray | None) -> ComplexArray:
        """Return dr (n, F, n_y, n_u) by changes dG of a response G."""
        # A logarithm of an element that is left out because it is zero has no slope.
        return apply_mixing(mixing, -self.gain * np.where(self.gain > 0, error_gain(self.criterion, G), 0.0) * dG)


def apply_mixing(mixing: ComplexArray | None, values: ComplexArray) -> ComplexArray:
    """Apply `mixing`, if there is any, to the elements of each line of values (..., F, n_y, n_u)."""
    if mixing is None:
        return values
    flat = values.reshape(-1, len(mixing), mixing.shape[1])
    return (mixing @ flat.transpose(1, 2, 0)).transpose(2, 0, 1).reshape(values.shape)


@dataclass(frozen=True, eq=False)
class Chunk(WorkerConstant):
    """Some configurations over one set of parameters."""

    parameters: Parameters
    parts: tuple[Part, ...]

    def sums(self, x: FloatArray, precision: type[np.floating[Any]]) -> tuple[float, FloatArray, FloatArray]:
        """Return V, J^T r (n_x,) and J^T J (n_x, n_x) at x; precision: of J^T J."""
        V, g, A = 0.0, np.zeros(len(x)), np.zeros((len(x), len(x)))
        numbers: dict[str, tuple[FloatArray, FloatArray]] = {}  # equal for most configurations
        with np.errstate(all="ignore"):
            for part in self.parts:
                name = self.parameters.configuration_of_stand_in(part.configuration)
                if name not in numbers:
                    numbers[name] = self.parameters.expand(x, name), self.parameters.jacobian(x, name)
                theta, slopes = numbers[name]
                T = slopes[part.kernel.places]
                cost, gradient, normal = part.normal.at(theta, precision)
                V, g, A = V + cost, g + T.T @ gradient, A + T.T @ normal @ T
        return V, g, A


def chunked(items: Sequence[Item]) -> list[tuple[Item, ...]]:
    """Return chunks of neighbours, of items that each belong to a configuration."""
    return [tuple(items[first : first + CHUNK]) for first in range(0, len(items), CHUNK)]


def home_of(responses: Sequence[Response], execution: Execution) -> Execution:
    """Return the execution of the chunks: by other processes if these are many, else the starts are shared."""
    is_large = sum(response.n_lines for response in responses) >= MIN_LINES
    is_large &= len(chunked(responses)) >= 2 * execution.jobs
    return Execution(execution.jobs) if is_large and execution.is_shared(len(responses)) else HERE


def each_at_home(function: Callable[[Item], Value], items: Sequence[Item], home: Execution) -> Iterator[Value]:
    """Apply a function to each item, with configuration-specific data at the worker of its chunk."""
    return chain.from_iterable(home.at_home(partial(_map_chunk, function), chunked(items)))


def _map_chunk(function: Callable[[Item], Value], chunk: Sequence[Item]) -> list[Value]:
    return [function(item) for item in chunk]


@dataclass(frozen=True, eq=False)
class ElasticFit:
    """The parts of all configurations over one set of parameters; it pickles, so that processes can work with it.

    inertias: bodies whose inertia must stay physically possible.  loads: static load tests, if there are any.
    home: who evaluates its chunks.
    """

    parameters: Parameters
    parts: tuple[Part, ...]
    inertias: tuple[BodyInertia, ...] = ()
    loads: "StaticLoads | None" = None
    home: Execution = HERE

    def evaluated_by(self, execution: Execution) -> Execution:
        """Return the execution of work that evaluates it: one item after the other where its chunks are at workers."""
        return replace(execution, jobs=0) if self.home.jobs else execution

    @property
    def n_residuals(self) -> int:
        """Real residuals that count."""
        return sum(part.n_residuals for part in self.parts) + (0 if self.loads is None else self.loads.n_residuals)

    @property
    def problem(self) -> LeastSquares:
        """The problem of a solver."""
        border = partial(border_metric, self.inertias, self.parameters) if self.inertias else None
        return LeastSquares(self.parameters, self.n_residuals, _Rough(self), border)

    def evaluate(self, x: FloatArray, precision: type[np.floating[Any]] = np.float64) -> Evaluation:
        """Return V, its gradient and 2 J^T J at x (n_x,); V is infinite where the model has no response."""
        try:
            chunk_sums = self.home.at_home(partial(Chunk.sums, x=x, precision=precision), self.chunks)
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
        """Configurations, so many neighbours at a time."""
        return tuple(Chunk(self.parameters, parts) for parts in chunked(self.parts))

    def static(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return r (n,) and dr/dx (n, n_x) of the static load tests; LinAlgError without an equilibrium under them."""
        if self.loads is None:
            return np.zeros(0), np.zeros((0, len(x)))
        return self.loads.residual(self.parameters, x)

    def blocks(self, x: FloatArray) -> Iterator[tuple[ComplexArray, ComplexArray]]:
        """Yield the whitened r (F, n_y, n_u) and dr/dx (n_x, F, n_y, n_u) of each configuration."""
        return (self.block(part, x, part.mixing) for part in self.parts)

    def block(self, part: Part, x: FloatArray, mixing: ComplexArray | None) -> tuple[ComplexArray, ComplexArray]:
        """Return residuals (F, n_y, n_u) and slopes (n_x, F, n_y, n_u) of one part; mixing: `Part.mixing`."""
        G, dG = part.columns.evaluate(part.theta(self.parameters, x))
        dr = part.slopes(G, dG, mixing)
        return part.residual(G, mixing), np.tensordot(part.chain(self.parameters, x).T, dr, axes=1)


@dataclass(frozen=True, eq=False)
class _Rough:
    """`ElasticFit.rough`, which goes to other processes with no more than it needs."""

    fit: ElasticFit

    def __call__(self, x: FloatArray) -> Evaluation:
        return self.fit.rough(x)

    def __reduce__(self) -> "tuple[type[_Rough], tuple[ElasticFit]]":
        return _Rough, (replace(self.fit, parts=tuple(part.for_sums for part in self.fit.parts)),)


def elastic_fit(
    responses: Sequence[Response],
    models: Sequence[LinearModel],
    weights: Sequence[Weights],
    parameters: Parameters,
    criterion: ResidualKind,
) -> ElasticFit:
    """Return the fit of `models` to `responses`, inputs and outputs matched by name.

    The logarithmic criterion discards elements below twice their sigma or without a response of the model (an axis that
    does not couple), and weights each element alone; the complex criterion weights correlated elements jointly, if the
    weights have their covariance.  Raises StudyError if the model lacks an input or output of a response.
    """
    triples = zip(responses, models, weights, strict=True)
    return ElasticFit(parameters, tuple(part_of(*triple, parameters, criterion) for triple in triples))


def part_of(
    response: Response, model: LinearModel, weights: Weights, parameters: Parameters, criterion: ResidualKind
) -> Part:
    """Return the part of one configuration; arguments as `elastic_fit`."""
    model = at_measured_places(model, response)
    columns = Columns(kernel_of(model, parameters, response.freq_hz))
    return part_with(columns, zoh_aliases(model, model.theta_ref, response.freq_hz), response, weights, criterion)


def part_with(
    columns: Columns, images: ComplexArray, response: Response, weights: Weights, criterion: ResidualKind
) -> Part:
    """Return the part of one configuration with the columns of its model; images (F, n_y, n_u): aliases."""
    kernel, is_used = columns.kernel, weights.used
    if criterion == "log":
        # The logarithm of noise is noise, and biased: elements must exceed it by 6 dB.
        G = kernel.response(kernel.model.theta_ref)
        is_used = is_used & (np.abs(G) > 1e-12 * np.abs(G).max()) & (np.abs(response.G) > 2.0 * weights.sigma)
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = np.where(is_used, error_gain(criterion, response.G), 1.0)
    gain = np.sqrt(2 * weights.factor) / np.where(is_used, np.abs(slope) * weights.sigma, np.inf)
    whitening = None
    if weights.correlated is not None and criterion == "complex":
        whitening = Whitening(weights.correlated, weights.floor, response.G, weights.sigma)
    # Without any the array of the response, which workers have.
    plain = response.G - images if images.any() else response.G
    part = Part(columns, frozen(plain, np.complex128), frozen(gain), criterion, whitening)
    return replace(part, compressed=part.normal.residuals)


def at_measured_places(model: LinearModel, response: Response | LinearModel) -> LinearModel:
    """Return the model with inputs, outputs, hold and sampling of a response, or of its model."""
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
        model = acted_on(model, Ports.at_frames(model, response.inputs), response.motors, response.loop)
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
    """Return the outputs of a response, and the motions on which its forces at frames work."""
    return tuple(dict.fromkeys((*response.outputs, *(port_motion(name) for name in response.inputs if is_load(name)))))


def kernel_of(model: LinearModel, parameters: Parameters, freq_hz: FloatArray) -> Kernel:
    """Return the response of a model at the start on some lines, with derivatives by its parameters in x alone."""
    if model.parameters != parameters.names:
        raise ValueError(f"the model has parameters {model.parameters}, the set {parameters.names}")
    name = model.configuration.name
    dependent, theta = parameters.dependent_names(name), parameters.expand(parameters.x, name)
    (M, D, K), (C, T) = model.matrices(theta), model.readout(theta)
    slopes = {p: model.slopes[p] for p in dependent if p in model.slopes}
    at_start = replace(model, theta_ref=theta, M=M, D=D, K=K, B=model.acting(theta), C=C, T=T, slopes=slopes)
    return Kernel(at_start, freq_hz, dependent, model.theta_ref)
