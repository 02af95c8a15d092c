"""Fits and comparisons come back to the last bit; a comparison only for its own responses."""

import dataclasses
import json
import math
from dataclasses import replace

import h5py
import numpy as np
import pytest
from plants.artefacts import (
    STAMP,
    same,
    some_fit,
)

from elastid.linear.linear_model import DifferenceElement, LagElement, LinearModel, Slope
from elastid.record import Configuration, HeldTorque
from elastid.store.results import (
    read_comparison,
    read_fit,
    write_comparison,
    write_fit,
)
from elastid.validation.comparison import ComparedModel, Comparison, Trial


@pytest.mark.parametrize("n_starts", [0, 2])
def test_a_fit_comes_back_to_the_last_bit(tmp_path, n_starts):
    """Ties, priors, infinite bounds and variances, every start."""
    write_fit(tmp_path / "fit.h5", some_fit(n_starts), STAMP)
    assert same(read_fit(tmp_path / "fit.h5"), some_fit(n_starts))


def test_intervals_and_information_come_back_to_the_last_bit(tmp_path):
    """With them or without any of them."""
    pairs = np.array([[1.0, math.inf], [math.nan, math.nan]])
    full = dataclasses.replace(
        some_fit(),
        profile95=pairs,
        bootstrap95=2 * pairs,
        configurations=("b", "a"),
        share=np.array([[0.25, 0.5], [0.75, 0.5]]),
        informing_hz=3 * pairs,
    )
    write_fit(tmp_path / "fit.h5", full)
    assert same(read_fit(tmp_path / "fit.h5"), full)


def test_readers_of_hdf5_alone_find_the_parts_of_each_deviation(tmp_path):
    """One number that was asked for, whose variance is by noise to 0.64 and by the file to 0.36."""
    fit = some_fit()
    asked, doubted = fit.parameters.free
    moved = tuple(replace(p, tolerated=True) if p.name == doubted.name else p for p in fit.parameters)
    covariance = 1e-4 * np.array([[1.0, 0.6], [0.6, 1.0]])
    shares = {"repeated": np.array([0.64, 1.0]), "lasting": np.array([0.36, 0.0])}
    write_fit(
        tmp_path / "fit.h5", replace(fit, parameters=type(fit.parameters)(moved), covariance=covariance, **shares)
    )
    with h5py.File(tmp_path / "fit.h5") as file:
        table = {name: column[0] for name, column in file["numbers"].items()}
    std = 0.01 * (fit.values[asked.name] if asked.log else 1.0)
    assert table["name"].decode() == asked.name
    parts = [table[name] for name in ("std", "std_by_noise", "std_by_file")]
    assert parts == pytest.approx([std, 0.8 * std, 0.6 * std])


def test_linear_models_come_back_to_the_last_bit(tmp_path):
    """Slopes of some matrices only, elements of the chain of either kind, a torque that is held."""
    chain = (LagElement("sensor_lag", (1.0, 0.5)), DifferenceElement("differentiator"))
    one = LinearModel(
        configuration=Configuration("a/b", np.array([0.1, 0.2])),
        parameters=("k_1", "d_1", "delay"),
        theta_ref=np.array([1.0, 2.0, 0.0]),
        M=np.eye(2),
        D=2 * np.eye(2),
        K=3 * np.eye(2),
        slopes={"d_1": Slope(D=np.ones((2, 2))), "k_1": Slope(K=np.ones((2, 2)), C=np.ones((1, 2)))},
        B=np.ones((2, 1)),
        C=np.ones((1, 2)),
        inputs=("motor 1",),
        outputs=("motor 1",),
        quantity="acceleration",
        chain=chain,
        hold=HeldTorque((500.0,), (True,)),
    )
    full = dataclasses.replace(some_fit(), linear=(one, dataclasses.replace(one, chain=(), hold=None, slopes={})))
    write_fit(tmp_path / "fit.h5", full)
    assert same(read_fit(tmp_path / "fit.h5"), full)
    assert list(read_fit(tmp_path / "fit.h5").linear[0].slopes) == ["d_1", "k_1"]


MODELS = (
    ComparedModel("own", 3, 1 / 3, 100, 0.0, np.array([0.1, 0.2]), 0.3, 2.0),
    ComparedModel("failed", 0, math.inf, 0, math.inf, np.array([math.nan, 1.0]), math.nan, math.nan, "why"),
)
TRIALS = (
    Trial(1, "free", ("2x",), ("gear 1", "2x"), 4, 2.0, 1.0, -1.0, 0.1, -5.0, True),
    Trial(2, "rigid", ("gear 1",), ("2x",), 3, 1.0, math.inf, math.nan, math.inf, math.nan, False),
)


@pytest.mark.parametrize("trials", [(), TRIALS])
def test_a_comparison_comes_back_to_the_last_bit(tmp_path, trials):
    """With a search and without."""
    written = Comparison(("a", "b"), MODELS, "own predicts best.", trials)
    write_comparison(tmp_path / "compare.json", written, replace(STAMP, software="elastid 0.1.0, Python 3.11"))
    assert same(read_comparison(tmp_path / "compare.json", STAMP), written)
    content = json.loads((tmp_path / "compare.json").read_text())
    assert (content["schema"], content["made by"]) == (1, "elastid 0.1.0, Python 3.11")


def test_a_comparison_of_other_responses_or_a_damaged_one_is_not_there(tmp_path):
    """Nor is a missing file."""
    path = tmp_path / "compare.json"
    assert read_comparison(path, STAMP) is None
    write_comparison(path, Comparison(("a", "b"), MODELS, ""), STAMP)
    assert read_comparison(path, replace(STAMP, inputs="other")) is None
    assert read_comparison(path, replace(STAMP, code="other")) is not None
    for text in ("", "[]", "{}", '{"schema": 0}'):
        path.write_text(text)
        assert read_comparison(path, STAMP) is None
