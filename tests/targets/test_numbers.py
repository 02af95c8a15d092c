"""No export loses the intervals of a fit, and none gives a number that was held a std of 0."""

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
from elastid.targets.numbers import interval_lines

SPRING = "k_1"


@pytest.fixture(scope="module")
def fitted() -> FittedRobot:
    """The bench with one spring that was identified."""
    return fitted_model("bench")


def test_arrays_for_control_and_matlab_have_nan_where_a_number_was_held(fitted: FittedRobot, tmp_path: Path) -> None:
    """And the fitted responses the deviation that is due to the parameters."""
    data, script = write_control(tmp_path, fitted)
    result = fitted.result
    expected = (result.values[SPRING], result.std[SPRING], *result.interval(SPRING))
    with np.load(data) as arrays:
        rows = dict(zip(arrays["parameters"].tolist(), arrays["known"], strict=True))
    assert rows[SPRING][:4].tolist() == pytest.approx(list(expected))
    assert np.isnan(rows[SPRING][4:]).all()  # the file is exact
    assert np.isnan(rows["Jm_1"][1:]).all()
    assert "def parameters(" in script.read_text()
    content = loadmat(write_matlab(tmp_path, fitted)[0])
    found = {row["name"].item(): row for row in content["parameters"][:, 0]}
    assert [found[SPRING][key].item() for key in ("lower_95", "upper_95")] == pytest.approx(list(expected[2:]))
    assert np.isnan([found["Jm_1"][key].item() for key in ("std", "lower_95", "upper_95")]).all()
    covariance = np.moveaxis(content["fitted"][0, 0]["CovarianceData"][..., 0, 0], 2, 0)
    np.testing.assert_allclose(2 * covariance, fitted.models[0].response_std(fitted.measured[0].freq_hz) ** 2)


def test_every_export_parts_the_deviation_by_noise_and_by_file(fitted: FittedRobot, tmp_path: Path) -> None:
    """Of the variance 0.64 by a repetition's noise, 0.36 by the file without end: 0.8 and 0.6 of the deviation."""
    free = fitted.result.parameters.free_names
    doubted = next(name for name in free if name != SPRING)
    parameters = tuple(replace(p, tolerated=p.name == doubted) for p in fitted.result.parameters)
    order = sorted(range(len(free)), key=lambda i: free[i] == doubted)  # what was asked for comes first
    C, one = 1e-4 * np.eye(len(free)), np.ones(len(free))
    named = {p.name: p for p in parameters}
    moved = (*(p for p in parameters if p.name != doubted), named[doubted])
    result = replace(fitted.result, parameters=Parameters(moved), x=fitted.result.x[order], covariance=C)
    result = replace(result, repeated=0.64 * one, lasting=0.36 * one)
    model = replace(fitted, result=result)
    std = 0.01 * result.values[SPRING]
    expected = pytest.approx([0.8 * std, 0.6 * std])
    data, _ = write_control(tmp_path, model)
    with np.load(data) as arrays:
        assert arrays["known"][arrays["parameters"].tolist().index(SPRING), 4:].tolist() == expected
    rows = loadmat(write_matlab(tmp_path, model)[0])["parameters"][:, 0]
    (row,) = [row for row in rows if row["name"].item() == SPRING]
    assert [row[f"std_by_{part}"].item() for part in ("noise", "file")] == expected
    write_csv(tmp_path, model)
    table = np.genfromtxt(tmp_path / "parameters.csv", delimiter=",", names=True, dtype=None, encoding="utf-8")
    (line,) = [line for line in table if line["parameter"] == SPRING]
    assert [line["std_by_noise"], line["std_by_file"]] == expected
    words = f"(noise {0.8 * std:.3g}, file {0.6 * std:.3g})"
    assert any(words in line for line in interval_lines(model))
    if importlib.util.find_spec("mujoco"):
        root = ET.parse(write_mujoco(tmp_path, model)[0])
        numbers = {each.get("name"): each.get("data", "").split() for each in root.iter("numeric")}
        assert [float(part) for part in numbers[SPRING][4:]] == expected
