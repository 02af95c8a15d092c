"""CSV tables: a study reads the responses, and the parameters are those of the fit."""

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from plants.fitted_models import close, fitted_model, responses_of

from elastid.experiment.specs.channels import ChannelSpec
from elastid.experiment.specs.recorded import ResponseFileSpec, ResponsesSpec
from elastid.fit.fitted_robot import FittedRobot
from elastid.linear.modes import modes
from elastid.recorded.responses.reading import link_side_response, read_table
from elastid.response import Covariance
from elastid.targets.csv import write_csv


def rows(path: Path) -> list[dict[str, str]]:
    with path.open() as file:
        return list(csv.DictReader(file))


def test_csv_responses_are_what_a_study_reads(model: FittedRobot, tmp_path: Path) -> None:
    write_csv(tmp_path, model)
    channels = [ChannelSpec("u", place, channel=place) for place in model.linear[0].inputs]
    channels += [ChannelSpec("y", place, channel=place, quantity="acceleration") for place in model.linear[0].outputs]
    for kind, expected in (("fitted", responses_of(model)), ("measured", model.measured[0].G)):
        file = f"one-{kind}.csv"
        spec = ResponsesSpec((ResponseFileSpec(file, "one"),), tuple(channels), relative_std=0.1)
        table = read_table(tmp_path / file, spec, "")
        G = link_side_response(table, spec, model.measured[0].configuration, model.robot, "acceleration")
        assert close(G.G, expected, 1e-12)


def test_csv_parameters_are_the_fits(serial_model: FittedRobot, tmp_path: Path) -> None:
    write_csv(tmp_path, serial_model)
    table, result = {row["parameter"]: row for row in rows(tmp_path / "parameters.csv")}, serial_model.result
    for name, value in result.values.items():
        assert float(table[name]["value"]) == value
    for name, std in result.std.items():
        assert float(table[name]["std"]) == std
        assert (float(table[name]["lower_95"]), float(table[name]["upper_95"])) == result.interval(name)
    held = [name for name in table if name not in result.std]
    assert held
    assert all(table[name]["std"] == table[name]["lower_95"] == table[name]["upper_95"] == "" for name in held)


def test_csv_modes_are_those_of_every_configuration(serial_model: FittedRobot, tmp_path: Path) -> None:
    """Frequency and damping ratio, numbered from 1."""
    write_csv(tmp_path, serial_model)
    table = rows(tmp_path / "modes.csv")
    for linear in serial_model.linear:
        its = [row for row in table if row["configuration"] == linear.configuration.name]
        found = modes(linear, serial_model.theta)
        assert [int(row["mode"]) for row in its] == list(range(1, len(found.freq_hz) + 1))
        assert [float(row["frequency_hz"]) for row in its] == pytest.approx(np.asarray(found.freq_hz).tolist())
        assert [float(row["damping_ratio"]) for row in its] == pytest.approx(np.asarray(found.zeta).tolist())


def test_csv_responses_have_their_standard_deviations(tmp_path: Path) -> None:
    """A column for each element, the root of its variance."""
    model = fitted_model("bench")
    variance = np.random.default_rng(0).uniform(1, 2, model.measured[0].G.shape)
    first = replace(model.measured[0], total=Covariance(variance, np.inf))
    write_csv(tmp_path, replace(model, measured=(first, model.measured[1])))
    table = rows(tmp_path / "one-measured.csv")
    for i, y in enumerate(first.outputs):
        for j, u in enumerate(first.inputs):
            std = [float(row[f"std_{y}_{u}"]) for row in table]
            assert std == pytest.approx(np.sqrt(variance[:, i, j]).tolist())
