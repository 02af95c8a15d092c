"""The three-mass plant of Wernholt & Gunnarsson (2006): motor, gear and arm with two springs, torque to motor velocity.

1 to 40 Hz in steps of 0.2 Hz; ln k_g, ln d_g, ln k_a, ln d_a are free.
"""

from dataclasses import replace

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.fit.covariance import Uncertainty, estimate_uncertainty
from elastid.fit.problem.frf_residuals import ElasticFit, elastic_fit
from elastid.fit.problem.least_squares import LocalOptimum, as_real
from elastid.fit.problem.weights import weigh
from elastid.fit.solve.solvers import solve
from elastid.fit.spec import FitSpec, WeightSpec
from elastid.linear.linear_model import LinearModel, Slope
from elastid.linear.response.transfer import frequency_response
from elastid.parameters import Parameter, Parameters
from elastid.record import Configuration
from elastid.response import Covariance, Response
from plants.two_mass import drawn

TRUTH = {"k_g": 20.59269827430799, "d_g": 0.06241814047290, "k_a": 20.23072060978318, "d_a": 0.00987527995798}
FREQ = np.arange(1, 40.01, 0.2)
DEFLECTION = np.array([[1.0, -1.0, 0.0], [0.0, 1.0, -1.0]])
ACROSS_GEAR, ACROSS_ARM = (np.outer(e, e) for e in DEFLECTION)
NO_FLOOR = FitSpec(weights=WeightSpec(model_error=0.0))


def plant(outputs: tuple[int, ...] = (0,), inputs: tuple[int, ...] = (0,)) -> LinearModel:
    J, a_m, a_g, viscous = 0.03291699877416, 0.17910964111956, 0.61206166914114, 0.00986346744839
    places = ("motor 1", "joint 1", "joint 2")
    return LinearModel(
        configuration=Configuration("c1", [0.0]),
        parameters=(*TRUTH, "delay"),
        theta_ref=np.array([*TRUTH.values(), 0.0]),
        M=J * np.diag([a_m, a_g, 1 - a_m - a_g]),
        D=np.diag([viscous, 0, 0]) + TRUTH["d_g"] * ACROSS_GEAR + TRUTH["d_a"] * ACROSS_ARM,
        K=TRUTH["k_g"] * ACROSS_GEAR + TRUTH["k_a"] * ACROSS_ARM,
        slopes={
            "k_g": Slope(K=ACROSS_GEAR),
            "d_g": Slope(D=ACROSS_GEAR),
            "k_a": Slope(K=ACROSS_ARM),
            "d_a": Slope(D=ACROSS_ARM),
        },
        B=np.eye(3)[:, inputs],
        C=np.eye(3)[outputs, :],
        inputs=tuple(places[i] for i in inputs),
        outputs=tuple(places[i] for i in outputs),
        quantity="velocity",
    )


def parameters(off: float = 1.0, **changes: Parameter) -> Parameters:
    free = {name: Parameter(name, v * off, "1", v / 1e3, v * 1e3, log=True) for name, v in TRUTH.items()}
    free["delay"] = Parameter("delay", 0.0, "s", free=False)
    return Parameters(tuple((free | changes).values()))


def measured(model: LinearModel, std: FloatArray, rng=None, dof: float = np.inf) -> Response:
    """The exact response, or with noise of std (F, n_y, n_u) whose variance was estimated from so many dof."""
    G = frequency_response(model, model.theta_ref, FREQ)
    std = np.broadcast_to(std, G.shape)
    G, noise = (G, Covariance(std**2, dof)) if rng is None else drawn(G, std, rng, dof)
    return Response(FREQ, G, model.inputs, model.outputs, "velocity", model.configuration, noise=noise)


def with_covariance(model: LinearModel, rng: np.random.Generator, dof: float = np.inf) -> Response:
    """With noise whose covariance between elements is full."""
    bare = measured(model, noise_of(model), rng)
    root = np.sqrt(bare.noise.variance[:, :, 0])[:, :, None] * rng.standard_normal((3, 9)) / 3
    matrix = root @ root.swapaxes(1, 2) + 0j
    return replace(bare, noise=Covariance(np.einsum("faa->fa", matrix).real[:, :, None], dof, matrix=matrix))


def noise_of(model: LinearModel) -> FloatArray:
    """5 % of each element."""
    return 0.05 * np.abs(frequency_response(model, model.theta_ref, FREQ))


def fit_of(response, model, spec=NO_FLOOR, criterion="complex") -> ElasticFit:
    return elastic_fit([response], [model], [weigh(response, spec)], parameters(), criterion)


def stacked(fit: ElasticFit, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """r (n,) and J (n, n_x) of all responses."""
    rows = [(as_real(r).ravel(), as_real(J).reshape(len(J), -1).T) for r, J in fit.blocks(x)]
    r, J = zip(*rows, strict=True)
    return np.concatenate(r), np.concatenate(J)


def estimate(response, model, spec=NO_FLOOR, criterion="complex") -> tuple[LocalOptimum, Uncertainty]:
    weights = weigh(response, spec)
    fit = elastic_fit([response], [model], [weights], parameters(), criterion)
    end = solve(fit.problem, parameters().x)
    assert end.converged
    return end, estimate_uncertainty(fit, [response], [weights], end.x)


def cramer_rao(model: LinearModel, std: FloatArray) -> FloatArray:
    """Smallest possible standard deviations of x under noise of std (F, n_y, n_u)."""
    _, J = stacked(fit_of(measured(model, std), model), parameters().x)
    return np.sqrt(np.diag(np.linalg.inv(J.T @ J)))
