"""Fits and comparisons come back to the last bit; a comparison only for its own responses."""

import math
from dataclasses import replace

import h5py
import numpy as np
import pytest
from plants.artefacts import STAMP, same, some_fit

from elastid.linear.linear_model import DifferenceElement, LagElement, LinearModel, Slope
from elastid.record import Configuration, ZohTorque
from elastid.store.results import read_comparison, read_fit, write_comparison, write_fit
from elastid.validation.comparison import ComparedModel, Comparison


def test_readers_of_hdf5_alone_find_the_parts_of_each_deviation(tmp_path):
    """One parameter: 0.64 of the variance by noise, 0.27 by the prior, 0.09 systematic."""
    fit = some_fit()
    asked, *doubted = fit.parameters.free
    moved = tuple(replace(p, is_nuisance=True) if p in doubted else p for p in fit.parameters)
    covariance, first = 1e-4 * (0.4 * np.eye(4) + 0.6), np.eye(4)[0]
    shares = {"averaging_fraction": 1 - 0.36 * first, "persistent_fraction": 0.27 * first}
    write_fit(
        tmp_path / "fit.h5", replace(fit, parameters=type(fit.parameters)(moved), covariance=covariance, **shares)
    )
    with h5py.File(tmp_path / "fit.h5") as file:
        table = {name: column[0] for name, column in file["numbers"].items()}
    std = 0.01 * (fit.values[asked.name] if asked.log else 1.0)
    assert table["name"].decode() == asked.name
    parts = [table[name] for name in ("std", "std_noise", "std_prior", "std_systematic")]
    assert parts == pytest.approx([std, 0.8 * std, 0.27**0.5 * std, 0.3 * std])


PAIRS = np.array([[1.0, math.inf], [math.nan, math.nan], [2.0, 3.0], [-math.inf, 0.0]])
LINEAR = LinearModel(
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
    chain=(LagElement("sensor_lag", (1.0, 0.5)), DifferenceElement("differentiator")),
    hold=ZohTorque((500.0,), (True,)),
)
FULL = replace(
    some_fit(),
    profile95=PAIRS,
    bootstrap95=2 * PAIRS,
    configurations=("b", "a"),
    information_fraction=np.array([[0.25, 0.5, 0.0, 1.0], [0.75, 0.5, 1.0, 0.0]]),
    information_band_hz=3 * PAIRS,
    linear=(LINEAR, replace(LINEAR, chain=(), hold=None, slopes={})),
)


@pytest.mark.parametrize("fit", [some_fit(0), FULL], ids=["bare", "full"])
def test_a_fit_comes_back_to_the_last_bit(tmp_path, fit):
    """Ties, priors, infinite bounds and variances, starts; intervals, information and linear models or none of them."""
    write_fit(tmp_path / "fit.h5", fit, STAMP)
    found = read_fit(tmp_path / "fit.h5")
    assert same(found, fit)
    assert [list(one.slopes) for one in found.linear] == [list(one.slopes) for one in fit.linear]


MODELS = (
    ComparedModel("own", 3, 1 / 3, 100, 0.0, np.array([0.1, 0.2]), 0.3, 2.0),
    ComparedModel("failed", 0, math.inf, 0, math.inf, np.array([math.nan, 1.0]), math.nan, math.nan, "why"),
)


def test_foreign_or_damaged_comparison_is_none(tmp_path):
    path = tmp_path / "compare.json"
    assert read_comparison(path, STAMP) is None
    write_comparison(path, Comparison(("a", "b"), MODELS, ""), STAMP)
    assert read_comparison(path, replace(STAMP, inputs="other")) is None
    assert read_comparison(path, replace(STAMP, code="other")) is not None
    for text in ("", "[]", "{}", '{"schema": 0}'):
        path.write_text(text)
        assert read_comparison(path, STAMP) is None
