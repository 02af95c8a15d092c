"""Normal equations on few columns, on half of a symmetric response, at workers: the numbers of all elements."""

import pickle
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from plants.elastic_arm import arm
from plants.refusals import refused
from plants.three_mass import FREQ, NO_FLOOR, parameters, plant, stacked, with_covariance
from plants.two_mass import circular

import elastid.fit.problem.frf_residuals as chunks
from elastid.base import large_arrays
from elastid.base.execution import SERIAL, Execution, persistent_workers
from elastid.base.kernels import is_compiled
from elastid.fit.frf_problem import Assembly
from elastid.fit.parameter_selection import choose
from elastid.fit.problem.compressed_residuals import BATCH, Full, LineResiduals, Packed
from elastid.fit.problem.frf_residuals import chunk_execution, elastic_fit, map_chunks
from elastid.fit.problem.weights import weigh
from elastid.fit.spec import FactorSpec, FitSpec, ParameterSpec, WeightSpec
from elastid.linear.linearise import Linearisation
from elastid.linear.response.derivatives import Sensitivity
from elastid.linear.response.transfer import to_response
from elastid.model.formulation import serial
from elastid.record import Configuration, ZohTorque
from elastid.response import Covariance
from elastid.robot import Chain, Frame, Placement
from elastid.store.measured import read_responses, write_responses

NAMES = ("k_*", "d_*", "fm_*", "Jm_*", "m_fore", "c_fore_x", "delay", "torque_lag", "sensor_lag")
TOOL = Frame("tool", "fore", Placement((0.9, 0.0, 0.1), (0.0, 0.3, 0.0)))
needs_compiler = pytest.mark.skipif(not is_compiled(), reason="the kernels in C are not built")


@pytest.fixture(params=[False, pytest.param(True, marks=needs_compiler)], ids=["NumPy", "compiled"])
def loops(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Loops that are compiled, however few lines there are, and none."""
    monkeypatch.setattr("elastid.linear.response.kernel.is_compiled", lambda: request.param)


@pytest.mark.usefixtures("loops")
@pytest.mark.parametrize("covariance", ["diagonal", "auto"])
@pytest.mark.parametrize("criterion", ["complex", "log"])
@pytest.mark.parametrize(
    "outputs",
    [
        ("motor 1", "motor 2"),
        ("motor 2", "motor 1"),
        ("motor 1", "joint 2", "motor 2"),
        ("motor 1", "accelerometer tool x"),
    ],
)
def test_cost_gradient_and_hessian_equal_stacked_residuals(covariance, criterion, outputs):
    """Springs with dampers, rotors with friction, a mass under gravity, a centre of mass, the delay and lags.

    Symmetric responses, outputs in another order, not collocated or an accelerometer that tilts; a mask that
    leaves one of a pair of mirrored elements. Torques are held, lines up to a fifth of their rate.
    """
    robot, rng = replace(arm(), chain=Chain(torque_lag=2e-4, sensor_lag=1e-4), frames=(TOOL,)), np.random.default_rng(0)
    model = serial(robot)
    linear = Linearisation.of(model).at(Configuration("c1", (0.3, -0.5)), model.theta, outputs, "acceleration")
    held = ZohTorque((200.0,) * 2, tuple(place != "accelerometer tool x" for place in outputs))
    linear = replace(linear, hold=held)
    exact = to_response(linear, np.append(model.theta, 1e-4), FREQ[::2])
    std = 0.02 * np.abs(exact.G) + 1e-4 * np.abs(exact.G).max(axis=0)
    G, (F, n_y, n_u) = exact.G + std * circular(rng, std.shape), std.shape
    root = circular(rng, (F, n_y * n_u, 3 * n_y * n_u)) * std.transpose(0, 2, 1).reshape(F, -1, 1)
    C = root @ root.conj().transpose(0, 2, 1) / root.shape[2]  # errors of all pairs of elements
    variance = np.einsum("faa->fa", C).real.reshape(F, n_u, n_y).transpose(0, 2, 1)
    response = replace(exact, G=G, noise=Covariance(variance, np.inf, matrix=C))
    spec = FitSpec(
        criterion=criterion,
        parameters={name: ParameterSpec() for name in NAMES},
        weights=WeightSpec(
            covariance=covariance,
            factors=(
                FactorSpec(0.0, output="motor 1", input="motor 2", band_hz=(8.0, 15.0)),
                FactorSpec(0.0, band_hz=(20.0, 20.5)),
            ),
        ),
    )
    parameters = choose(spec, robot)
    fit = Assembly.of([response], robot, spec, parameters).at(parameters.x, criterion)
    x = parameters.x + 0.02 * rng.standard_normal(len(parameters.x)) * (parameters.x > 0)
    here, (r, J) = fit.evaluate(x), stacked(fit, x)
    scale = 2 * np.linalg.norm(J, axis=0)
    assert here.cost == pytest.approx(r @ r, rel=1e-10)
    np.testing.assert_allclose(here.gradient / scale, 2 * J.T @ r / scale, atol=1e-9 * np.linalg.norm(r))
    expected = 2 * J.T @ J / np.outer(scale, scale)
    np.testing.assert_allclose(here.hessian / np.outer(scale, scale), expected, atol=1e-12)
    assert fit.frfs[0].columns.is_symmetric == (outputs == ("motor 1", "motor 2"))


def random_part(
    rng: np.random.Generator, start: int, F: int, n_y: int, n_u: int, n_1: int, n_2: int, n_3: int
) -> Sensitivity:
    """Random columns of the elements of a response, on and above the diagonal where it is square."""
    rows, columns = np.triu_indices(n_u) if n_y == n_u else np.indices((n_y, n_u)).reshape(2, -1)
    r, omega = 2 * (n_2 > 0) + n_2, rng.uniform(0.1, 1.0, F)
    left = circular(rng, (F, n_y, n_1 + r))
    S = rng.standard_normal((2, n_2, r, r))
    S[0, n_2 // 2 :] = 0.0
    return Sensitivity(
        block=slice(start, start + F),
        s=300j * omega,
        omega=omega,
        gain=circular(rng, (F,)),
        G=circular(rng, (F, len(rows))),
        left=left,
        right=left if n_y == n_u else circular(rng, (F, n_u, n_1 + r)),
        sign=rng.choice([-1.0, 1.0], n_1),
        S=S + S.swapaxes(2, 3),
        whole=circular(rng, (F, len(rows), n_3)),
        outputs=rows.astype(np.int64),
        inputs=columns.astype(np.int64),
    )


@pytest.mark.parametrize("precision", [np.float64, np.float32])
@pytest.mark.parametrize("is_diagonal", [True, False])
@pytest.mark.parametrize(
    ("F", "n_y", "n_u", "n_1", "n_2", "n_3"),
    [
        (1, 1, 1, 1, 0, 0),
        (BATCH, 2, 2, 3, 1, 0),
        (BATCH + 1, 3, 3, 5, 0, 2),
        (37, 3, 2, 7, 5, 4),
        (7, 2, 1, 0, 3, 2),
        (5, 4, 4, 0, 2, 0),
    ],
)
def test_loops_agree_with_numpy(is_diagonal, F, n_y, n_u, n_1, n_2, n_3, precision):
    """One line, whole batches and more; one element, odd numbers of them; columns of any rank, others and none."""
    rng = np.random.default_rng(F)
    start, scale = 2 * BATCH, rng.uniform(0.5, 2.0, n_1 + n_2 + n_3)
    part = random_part(rng, start, F, n_y, n_u, n_1, n_2, n_3)
    n_e = len(part.outputs)
    R = circular(rng, (start + F, n_e, n_e))
    R = np.abs(R[:, 0]) if is_diagonal else np.triu(R)
    R[-1] = 0.0  # a line that is masked
    q, slope = circular(rng, (F, n_e)), circular(rng, (F, n_e))
    upper = np.triu(np.ones((len(scale),) * 2))
    for G, of_e in ((part.G, None), (None, slope)):
        found = Packed.of(R).sums(part, LineResiduals(q, G, of_e), scale, precision)
        expected = Full(R).sums(part, LineResiduals(q, G, of_e), scale, precision)
        assert found.cost == pytest.approx(expected.cost, rel=1e-13)
        size = np.abs(expected.pull).max(initial=1.0)
        np.testing.assert_allclose(found.pull, expected.pull, rtol=0, atol=1e-13 * size)
        tolerance = 1e-12 if precision is np.float64 else 1e-5
        moments = expected.moments * upper
        np.testing.assert_allclose(found.moments * upper, moments, rtol=0, atol=tolerance * np.abs(moments).max())


Q = 18  # five chunks


@pytest.fixture
def responses(tmp_path, monkeypatch):
    """A plant in many configurations on 49 lines: covariances stay in their file, a smoothed one beside it."""
    rng, model = np.random.default_rng(0), plant((0, 1, 2))
    every = []
    for i in range(Q):
        whole = with_covariance(model, rng, np.inf if i else 30.0)
        whole = replace(whole, configuration=Configuration(f"c{i}", [0.0]))
        every.append(whole.lines(np.arange(whole.n_lines) % 4 == 0))
    write_responses(tmp_path / "frf.h5", every)
    monkeypatch.setattr(large_arrays, "MIN_MAPPED_BYTES", 1000)
    monkeypatch.setattr(large_arrays, "MIN_LARGE_FILE", 0)
    monkeypatch.setattr(chunks, "MIN_LINES", 0)
    return read_responses(tmp_path / "frf.h5")


def fit_at(responses, stiffer: float = 1.0):
    model = plant((0, 1, 2))
    models = [replace(model, K=stiffer * model.K, configuration=G.configuration) for G in responses]
    weighed = [weigh(response, NO_FLOOR) for response in responses]
    return elastic_fit(responses, models, weighed, parameters(), "complex")


def same(first, second, x) -> bool:
    return pickle.dumps(first.evaluate(x)) == pickle.dumps(second.evaluate(x))


@pytest.mark.slow
def test_sums_of_workers_equal_one_process_for_other_models(responses):
    """At two points, and after the models have moved on; of fewer configurations, too."""
    here, x = fit_at(responses), parameters().x
    there = replace(here, home=chunk_execution(responses, Execution(2)))
    assert there.home.jobs == 2
    with persistent_workers():
        assert same(here, there, x)
        assert here.evaluate(x + 0.1).hessian.tobytes() == there.evaluate(x + 0.1).hessian.tobytes()
        moved = fit_at(responses, 1.1)
        pairs = list(zip(here.frfs, moved.frfs, strict=True))
        followed = replace(there, frfs=tuple(replace(part, columns=other.columns) for part, other in pairs))
        assert [part.normal.residuals for part in followed.frfs] == [part.normal.residuals for part in here.frfs]
        assert same(moved, followed, x + 0.1)
        assert same(here, there, x)
        assert same(replace(moved, frfs=moved.frfs[:3]), replace(followed, frfs=followed.frfs[:3]), x)


@pytest.mark.slow
def test_weights_of_workers_equal_one_process(responses):
    """The smoothed covariance as well; of a response that cannot be weighed the first in order is named."""
    here, there = (map_chunks(partial(weigh, spec=NO_FLOOR), responses, home) for home in (SERIAL, Execution(2)))
    for one, other in zip(here, there, strict=True):
        assert other.noise.measured is one.noise.measured
        assert (other.noise.smooth is other.noise.measured) == (one.noise.smooth is one.noise.measured)
        for name in ("sigma", "scale", "factor"):
            assert getattr(one, name).tobytes() == getattr(other, name).tobytes()
        assert one.noise.smooth.matrix.tobytes() == other.noise.smooth.matrix.tobytes()
        assert isinstance(other.noise.smooth.matrix, large_arrays.FileArray)
    bare = [replace(response, noise=None) for response in responses]
    with refused("fit/weights", place="configuration c0"):
        list(map_chunks(partial(weigh, spec=NO_FLOOR), bare, Execution(2)))
