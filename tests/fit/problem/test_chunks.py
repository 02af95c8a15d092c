"""A fit whose configurations are at workers: the sums of one process, to the last bit, for a few bytes each."""

import pickle
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from plants.refusals import refused
from plants.three_mass import NO_FLOOR, measured, noise_of, parameters, plant

import elastid.base.arrays as base_arrays
import elastid.fit.problem.elastic as chunks
from elastid.base.execution import HERE, Execution
from elastid.base.workers import lasting_workers
from elastid.fit.problem.elastic import each_at_home, elastic_fit, home_of
from elastid.fit.problem.weights import weigh
from elastid.record import Configuration
from elastid.response import Covariance
from elastid.store.measured import read_responses, write_responses

Q = 18  # five chunks


@pytest.fixture
def responses(tmp_path, monkeypatch):
    """A plant in many configurations on 49 lines: covariances stay in their file, a smoothed one beside it."""
    rng, model = np.random.default_rng(0), plant((0, 1, 2))
    every = []
    for i in range(Q):
        bare = measured(model, noise_of("relative", model), rng)
        root = np.sqrt(bare.noise.variance[:, :, 0])[:, :, None] * rng.standard_normal((3, 9)) / 3
        matrix = root @ root.swapaxes(1, 2) + 0j
        noise = Covariance(np.einsum("faa->fa", matrix).real[:, :, None], np.inf if i else 30.0, matrix=matrix)
        whole = replace(bare, noise=noise, configuration=Configuration(f"c{i}", [0.0]))
        every.append(whole.lines(np.arange(whole.n_lines) % 4 == 0))
    write_responses(tmp_path / "frf.h5", every)
    monkeypatch.setattr(base_arrays, "MIN_PART_BYTES", 1000)
    monkeypatch.setattr(base_arrays, "MIN_LARGE_FILE", 0)
    monkeypatch.setattr(chunks, "MIN_LINES", 0)
    return read_responses(tmp_path / "frf.h5")


def fit_at(responses, stiffer: float = 1.0):
    model = plant((0, 1, 2))
    models = [replace(model, K=stiffer * model.K, configuration=G.configuration) for G in responses]
    weighed = [weigh(response, NO_FLOOR) for response in responses]
    return elastic_fit(responses, models, weighed, parameters(), "complex")


def same(first, second, x) -> bool:
    return pickle.dumps(first.evaluate(x)) == pickle.dumps(second.evaluate(x))


def test_sums_of_workers_are_those_of_one_process_also_by_other_models(responses):
    """At two points, and after the models have moved on; of fewer configurations, too."""
    here, x = fit_at(responses), parameters().x
    there = replace(here, home=home_of(responses, Execution(2)))
    assert there.home.jobs == 2
    with lasting_workers():
        assert same(here, there, x)
        assert here.evaluate(x + 0.1).hessian.tobytes() == there.evaluate(x + 0.1).hessian.tobytes()
        moved = fit_at(responses, 1.1)
        followed = replace(moved.with_residuals_of(here), home=there.home)
        assert same(moved, followed, x + 0.1)
        assert same(here, there, x)
        assert same(replace(moved, parts=moved.parts[:3]), replace(followed, parts=followed.parts[:3]), x)


def test_weights_of_several_processes_are_those_of_one_and_know_their_responses(responses):
    """The smoothed covariance as well; of a response that cannot be weighed the first in order is named."""
    here, there = (each_at_home(partial(weigh, spec=NO_FLOOR), responses, home) for home in (HERE, Execution(2)))
    for one, other, response in zip(here, there, responses, strict=True):
        assert other.noise.is_of(response)
        assert (other.noise.smooth is other.noise.measured) == (one.noise.smooth is one.noise.measured)
        for name in ("sigma", "scale", "factor"):
            assert getattr(one, name).tobytes() == getattr(other, name).tobytes()
        assert one.noise.smooth.matrix.tobytes() == other.noise.smooth.matrix.tobytes()
        assert isinstance(other.noise.smooth.matrix, base_arrays.FileArray)
    bare = [replace(response, noise=None) for response in responses]
    with refused("fit/weights", place="configuration c0"):
        list(each_at_home(partial(weigh, spec=NO_FLOOR), bare, Execution(2)))


def test_one_process_or_few_lines_keep_configurations_here(responses, monkeypatch):
    """The work of others is then worth less than what it takes to ask them."""
    assert home_of(responses, Execution(1)) == HERE
    monkeypatch.setattr(chunks, "MIN_LINES", 20_000)
    assert home_of(responses, Execution(2)) == HERE
