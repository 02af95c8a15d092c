"""Every export has the numbers of the fit with their intervals, and none gives a number that was held a std of 0."""

import csv
import importlib.util
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from plants.fitted_models import fitted_model
from scipy.io import loadmat

from elastid.fit.fitted_robot import FittedRobot
from elastid.parameters import Parameters
from elastid.targets.control import write_control
from elastid.targets.csv import write_csv
from elastid.targets.matlab import write_matlab
from elastid.targets.mujoco import write_mujoco
from elastid.targets.numbers import exported_numbers

EXACT = fitted_model("bench")


def of_a_data_sheet() -> FittedRobot:
    """Its last number within a tolerance; of the variance 0.64 by noise, 0.27 by the prior, 0.09 systematic."""
    result, free = EXACT.result, EXACT.result.parameters.free_names
    parameters = (replace(p, is_nuisance=p.name == free[-1]) for p in result.parameters)
    asked_first = Parameters(tuple(sorted(parameters, key=lambda p: p.is_nuisance)))
    one = np.ones(len(free))
    parts = {"averaging_fraction": 0.64 * one, "persistent_fraction": 0.27 * one}
    return replace(EXACT, result=replace(result, parameters=asked_first, **parts))


@pytest.mark.parametrize("model", [EXACT, of_a_data_sheet()], ids=["exact", "tolerated"])
def test_every_export_has_the_numbers_of_the_fit(model: FittedRobot, tmp_path: Path) -> None:
    """Value, std and interval, and of an asked number the contributions to std."""
    result, expected = model.result, {}
    for p in model.parameters:
        std = result.std.get(p.name, np.nan)
        low, high = result.interval(p.name) if p.is_free else (np.nan, np.nan)
        parts = np.multiply(
            std, (0.8, 0.27**0.5, 0.3) if result.has_tolerances and not p.is_nuisance else (np.nan,) * 3
        )
        expected[p.name] = [result.values[p.name], std, low, high, *parts.tolist()]
    assert [number.name for number in exported_numbers(model)] == [*expected]
    write_csv(tmp_path, model)
    with (tmp_path / "parameters.csv").open(encoding="utf-8") as file:
        rows = [[*row.values()] for row in csv.DictReader(file)]
    with np.load(write_control(tmp_path, model)[0]) as arrays:
        tables = [dict(zip(arrays["parameters"].tolist(), arrays["known"].tolist(), strict=True))]
    tables.append({name: [float(cell or "nan") for cell in cells] for name, _, *cells in rows})
    of_matlab = loadmat(write_matlab(tmp_path, model)[0])["parameters"][:, 0]
    keys = ("value", "std", "lower_95", "upper_95", "std_noise", "std_prior", "std_systematic")
    tables.append({row["name"].item(): [row[key].item() for key in keys] for row in of_matlab})
    for table in tables:
        assert [*table] == [*expected]
        np.testing.assert_allclose([*table.values()], [*expected.values()], rtol=1e-12)
    if importlib.util.find_spec("mujoco"):
        numeric = ET.parse(write_mujoco(tmp_path, model)[0]).iter("numeric")
        found = {each.get("name"): [float(part) for part in each.get("data", "").split()] for each in numeric}
        free = {name: row for name, row in expected.items() if np.isfinite(row[1])}
        assert found == {name: pytest.approx([part for part in row if np.isfinite(part)]) for name, row in free.items()}


def test_fitted_responses_have_parameter_std(tmp_path: Path) -> None:
    """In MATLAB half of the variance of each real component."""
    content = loadmat(write_matlab(tmp_path, EXACT)[0])
    covariance = np.moveaxis(content["fitted"][0, 0]["CovarianceData"][..., 0, 0], 2, 0)
    np.testing.assert_allclose(2 * covariance, EXACT.models[0].response_std(EXACT.measured[0].freq_hz) ** 2)
