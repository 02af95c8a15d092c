"""elastid.run: a study from Python, its results as values, and what is done with them."""

from __future__ import annotations

import csv
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from plants import held_torque
from plants.refusals import refused

import elastid
from elastid.app.cli import run_command
from elastid.app.finished_run import FinishedRun
from elastid.base.errors import UnknownNameError
from elastid.response import Response

KEYS = ["report.formats=[]", "compare={variants: [{name: undamped, set: [fit.parameters.d_1.fixed=true]}]}"]


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> FinishedRun:
    folder = tmp_path_factory.mktemp("run") / "bench"
    assert run_command(["new", str(folder), "--template", "recorded"]) == 0
    return elastid.run(folder / "study.yml", folder / "run", set=KEYS, verbosity=-2)


def test_a_run_gives_its_values(done: FinishedRun) -> None:
    low, high = done.result["k_1"].interval
    assert low < 64.0 < high  # the truth of the template's logs
    response = done.responses["bench"]
    assert response["joint 1", "motor 1"].G.shape == (response.n_lines, 1, 1)
    assert np.all(response.coherence <= 1.0)
    assert "fit.h5" in repr(done)
    with refused("export/target"):
        elastid.export(done, "matlb")
    assert {row.name for row in elastid.compare(done).rows} == {"recorded", "undamped"}


def test_other_numbers_are_those_of_another_robot(done: FinishedRun) -> None:
    """The modes of a result with another spring are those of two inertias with it, motor free."""
    result = done.result
    other = result.with_parameters(k_1=50.0, fm_1=1e-9, d_1=1e-9)
    values = other.values
    inertia = values["Jm_1"] * result.robot.driven[0].motor.ratio ** 2
    load = values["I_load"]
    free = other.at([0.0], motors="free", inputs=["motor 1"], outputs=["motor 1"]).modes()
    omega = np.sqrt(50.0 * (1 / inertia + 1 / load))
    np.testing.assert_allclose(free.freq_hz[-1], omega / (2 * np.pi), rtol=1e-9)
    assert other.std["k_1"] == 0.0
    assert other.std["I_load"] == result.std["I_load"]
    assert "by hand: k_1 = 50" in other.message
    for wrong in ({"k_1": "1e5"}, {"k_1": None}):
        with pytest.raises(TypeError, match="is no number with a name; give with_parameters"):
            result.with_parameters(**wrong)
    with pytest.raises(TypeError, match="'text' is no number"):
        result.with_parameters("text")
    with pytest.raises(UnknownNameError, match="no parameter k_9"):
        result.with_parameters(k_9=1.0)
    with pytest.raises(ValueError, match="k_1 = -1: give a finite positive number in N"):
        result.with_parameters(k_1=-1.0)


TRUTH = {"k_1": 100.0, "d_1": 0.02, "Jm_1": 1e-3, "fm_1": 2e-3, "I_load": 2e-3}


def _write_responses(folder: Path, found: Response) -> None:
    """A CSV with the columns of the template `responses`, and standard deviations."""
    assert found.noise is not None
    names, columns = ["freq_hz"], [found.freq_hz]
    for i, at in enumerate(("motor", "load")):
        G, std = found.G[:, i, 0], np.sqrt(found.noise.variance[:, i, 0])
        names += [f"{part}_{at}_torque" for part in ("re", "im", "std")]
        columns += [G.real, G.imag, std]
    with (folder / "bench.csv").open("w", newline="") as file:
        csv.writer(file).writerows([names, *np.stack(columns, axis=1).tolist()])


def _fitted(folder: Path, name: str, *overrides: str) -> tuple[int, dict[str, Any]]:
    """Exit code and summary of a run."""
    overrides = ("experiment.responses.columns.std='std_{y}_torque'", "fit.starts=2", "report.formats=[]", *overrides)
    options = [part for each in overrides for part in ("--set", each)]
    run = folder / name
    code = run_command(["run", str(folder / "study.yml"), "--run", str(run), "--jobs", "1", "-q", *options])
    return code, json.loads((run / "summary.json").read_text())


def test_a_fit_to_responses_of_held_commands_needs_their_hold(tmp_path: Path) -> None:
    """G H of commands at 1 kHz in a CSV.

    With the key every number is right. Without it the half sample takes as much damping from the inertia as friction
    gives it: the motor's is lost, its inertia is off by 3 %, and a note says which torque is late, and by how much.
    """
    folder = tmp_path / "held"
    assert run_command(["new", str(folder), "--template", "responses"]) == 0
    _write_responses(folder, held_torque.measured(tmp_path, 1, "band-limited", noise=3e-4))
    hold = ("experiment.responses.hold=zero-order", "experiment.responses.rate_hz=1000")
    code, right = _fitted(folder, "with", *hold)
    assert (code, right["status"]) == (0, "converged")
    for name, expected in TRUTH.items():
        found = right["parameters"][name]
        assert found["value"] == pytest.approx(expected, abs=4 * found["std"])
        assert found["std"] < (0.15 if name == "fm_1" else 0.01) * expected
    code, wrong = _fitted(folder, "without")
    assert (code, wrong["status"]) == (3, "misfit")
    assert wrong["parameters"]["fm_1"]["value"] < 0.1 * TRUTH["fm_1"]
    assert wrong["parameters"]["Jm_1"]["value"] > 1.02 * TRUTH["Jm_1"]
    (late,) = (note for note in wrong["warnings"] if "hold: zero-order" in note)
    found = re.search(r"acts ([0-9.]+) ms late", late)
    assert found is not None
    assert float(found[1]) == pytest.approx(0.5, rel=0.05)
