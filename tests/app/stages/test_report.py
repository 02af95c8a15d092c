"""A study without a robot: from `new` to the report and the exports, and what it refuses."""

import csv
import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elastid.app.cli import run_command
from elastid.experiment.simulated.plant import true_modes, true_response
from elastid.experiment.specs.logs import ResponsesSpec
from elastid.logs.responses.reading import read_table
from elastid.store.measured import read_responses
from elastid.study import load


@pytest.fixture(scope="module")
def bench(tmp_path_factory) -> Path:
    """The template frf with amplifiers of 20 N/V before both shakers, run to its end."""
    folder = tmp_path_factory.mktemp("frf") / "bench"
    assert run_command(["new", str(folder), "--template", "frf"]) == 0
    for log in (folder / "logs").iterdir():
        table = np.loadtxt(log, delimiter=",", skiprows=1) / [20, 20, 1, 1, 1]
        header = log.read_text().partition("\n")[0]
        np.savetxt(log, table, "%.9g", ",", header=header, comments="")
    study = folder / "study.yml"
    study.write_text(study.read_text().replace("quantity: force, unit: N", "quantity: voltage, unit: V"))
    command = ["run", str(study), "--run", str(folder / "run"), "--jobs", "1", "--set", "report.formats=[png]", "-q"]
    assert run_command(command) == 0
    return folder


def peaks(run: Path) -> list[float]:
    """Frequencies in the table of a run, Hz."""
    return [float(row["frequency"]) for row in csv.DictReader((run / "modes.csv").read_text().splitlines())]


def test_a_structure_that_is_driven_by_a_voltage(bench: Path) -> None:
    """A response per volt in its 95 % regions, P(|error|^2 / variance > x) = (1 + x / dof)^-dof, and its peaks."""
    (found,) = read_responses(bench / "run" / "frf.h5")
    assert found.unit == "(m/s^2)/(V)"
    ratio, dof = np.abs(found.G - 20 * true_response(found.freq_hz)) ** 2 / found.total.variance, found.total.dof
    assert np.mean(ratio < dof * (0.05 ** (-1 / dof) - 1)) > 0.9
    np.testing.assert_allclose(peaks(bench / "run"), true_modes()[0] / (2 * np.pi), rtol=1e-4)


def test_the_page_draws_the_band_of_the_modes(bench: Path) -> None:
    """All lines within modal.band_hz; friction, which was not asked for by name and is not there, has no section."""
    page = (bench / "run" / "report.html").read_text(encoding="utf-8")
    data = map(json.loads, re.findall(r'<script type="application/json".*?>(.*?)</script>', page, re.DOTALL))
    (drawn,) = next(each["responses"] for each in data if "responses" in each)
    (measured,) = read_responses(bench / "run" / "frf.h5")
    low, high = load(bench / "study.yml").study.modal.band_hz or (0, 0)
    of_band = [freq_hz for freq_hz in measured.freq_hz if low <= freq_hz <= high]
    np.testing.assert_allclose(drawn["freq"], of_band, rtol=1e-6)
    assert len(of_band) < measured.n_lines
    assert 'id="friction"' not in page


def exported(bench: Path, target: str) -> Path:
    run = bench / "run"
    arguments = ["export", str(bench / "study.yml"), "--run", str(run), "--set", "report.formats=[png]", "-q"]
    assert run_command([*arguments, "--to", target]) == 0
    return run / "export" / target


@pytest.mark.parametrize(
    ("target", "file"), [("uff", "bench.uff"), ("matlab", "responses.mat"), ("csv", "bench-measured.csv")]
)
def test_exports_are_read_back(bench: Path, target: str, file: str) -> None:
    """By the readers of responses from elsewhere: the same lines and the same G."""
    pytest.importorskip("pyuff")
    (response,) = read_responses(bench / "run" / "frf.h5")
    channels = load(bench / "study.yml").study.experiment.as_recorded().channels
    path = exported(bench, target) / file
    spec = ResponsesSpec(files=({"path": file, "configuration": "bench"},), channels=())
    if target == "csv":
        named = {"u": response.inputs, "y": response.outputs}
        again = [c for c in channels if c.at in named[c.role]]
        spec = replace(spec, channels=tuple(replace(c, channel=c.at) for c in again))
    table = read_table(path, spec, "")
    np.testing.assert_allclose(table.freq, response.freq_hz, rtol=1e-9)
    np.testing.assert_allclose(table.G, response.G, rtol=1e-9)


@pytest.mark.parametrize("count", [1, 2])
def test_universal_files_become_configurations_of_a_study(count: int, bench: Path, tmp_path: Path) -> None:
    pytest.importorskip("pyuff")
    files = [str(exported(bench, "uff") / "bench.uff")] * count
    assert run_command(["new", str(tmp_path), "--from", *files]) == 0
    experiment = load(tmp_path / "study.yml").study.experiment
    assert [file.configuration for file in experiment.responses.files] == [*experiment.configurations]
    assert len(experiment.configurations) == count
