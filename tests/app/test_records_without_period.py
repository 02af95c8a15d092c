"""Records without a period from study files: noise on a structure, sweeps from rest, and inputs in volts."""

from __future__ import annotations

import csv
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from plants.flexible_link import OUTPUTS, PLANT, RATE_HZ, response, sweep

from elastid.app.cli import run_command
from elastid.base.arrays import ComplexArray, FloatArray
from elastid.experiment.simulated.plant import shake, true_modes, true_response
from elastid.linear.modes import modes
from elastid.response import Response
from elastid.store.measured import read_responses

MASSES = ("force_1", "force_3", "acc_1", "acc_2", "acc_3")


def write_log(path: Path, columns: Sequence[str], values: FloatArray) -> None:
    np.savetxt(path, values, delimiter=",", header=",".join(columns), comments="", fmt="%.9g")


def channel(role: str, name: str, quantity: str, unit: str, at: str = "") -> dict[str, str]:
    return {"role": role, "at": at or name, "channel": name, "quantity": quantity, "unit": unit}


def run(folder: Path, recorded: Mapping[str, Any], estimator: Mapping[str, Any] | None = None) -> Response:
    """The response that `elastid run` leaves from a study without a robot, and without an estimator where none is."""
    experiment = {"configurations": {"bench": []}, "recorded": recorded}
    study: dict[str, Any] = {"name": "bench", "experiment": experiment, "report": {"formats": []}}
    study |= {} if estimator is None else {"estimator": estimator}
    (folder / "study.yml").write_text(json.dumps(study))
    assert run_command(["check", str(folder / "study.yml")]) == 0
    assert run_command(["run", str(folder / "study.yml"), "--run", str(folder / "run"), "--jobs", "1", "-q"]) == 0
    (found,) = read_responses(folder / "run" / "frf.h5")
    return found


def peaks(folder: Path) -> FloatArray:
    """Frequencies in the table of the report, Hz."""
    rows = csv.DictReader((folder / "run" / "modes.csv").read_text().splitlines())
    return np.array([float(row["frequency"]) for row in rows])


def errors(found: Response, truth: ComplexArray) -> tuple[float, float]:
    """Mean |error|^2 over stated variance, and the part of the numbers in their 95 % regions.

    P(|error|^2 / variance > x) = (1 + x / dof)^-dof of a variance with so many complex degrees of freedom.
    """
    assert found.total is not None
    ratio, dof = np.abs(found.G - truth) ** 2 / found.total.variance, found.total.dof
    return float(ratio.mean()), float(np.mean(ratio < dof * (0.05 ** (-1 / dof) - 1)))


@pytest.mark.parametrize(("method", "n"), [("auto", 4096), ("h1", 65536)])
def test_one_record_of_noise_gives_responses_whose_intervals_cover_the_truth(
    method: str, n: int, tmp_path: Path
) -> None:
    """Three masses, two shakers, three sensors: a window of noise that neither repeats nor begins at rest."""
    (log, _) = shake(256.0, 4 * n, 1, 21)
    table = log[n : 2 * n]
    write_log(tmp_path / "log.csv", MASSES, table)
    channels = [channel("u", name, "force", "N") for name in MASSES[:2]]
    channels += [channel("y", name, "acceleration", "m/s^2") for name in MASSES[2:]]
    recorded = {"rate_hz": 256, "period": "none", "channels": channels}
    recorded["files"] = [{"path": "log.csv", "configuration": "bench"}]
    found = run(tmp_path, recorded, {"method": method, "band_hz": [5, 95]})
    ratio, coverage = errors(found, true_response(found.freq_hz))
    assert found.quality is not None
    assert np.median(found.quality.multiple_coherence) > 0.99
    assert ratio < 2
    assert coverage > 0.9
    np.testing.assert_allclose(peaks(tmp_path), true_modes()[0] / (2 * np.pi), rtol=2e-3)


def test_three_sweeps_from_rest_are_three_realisations(tmp_path: Path) -> None:
    """A flexible link under a controller of its motor and torque that disturbs it, swept up, down and up again."""
    rng = np.random.default_rng(3)
    columns = ("reference", "torque", *OUTPUTS)
    for i, bounds in enumerate(((0.5, 60.0), (60.0, 0.5), (0.3, 80.0))):
        write_log(tmp_path / f"sweep_{i}.csv", columns, sweep(bounds, rng))
    channels = [channel("u", "torque", "torque", "N*m", "motor")]
    channels.append(channel("r", "reference", "torque", "N*m", "motor"))
    channels.append(channel("y", "motor_speed", "velocity", "rad/s"))
    channels.append(channel("y", "tip", "acceleration", "m/s^2"))
    files = [{"path": f"sweep_{i}.csv", "configuration": "bench", "realisation": i} for i in range(3)]
    recorded = {"rate_hz": RATE_HZ, "period": "none", "channels": channels, "files": files}
    found = run(tmp_path, recorded, {"method": "auto", "band_hz": [1, 55]})
    ratio, coverage = errors(found, response(found.freq_hz))
    assert ratio < 2
    assert coverage > 0.9
    np.testing.assert_allclose(peaks(tmp_path), modes(PLANT, PLANT.theta_ref).freq_hz, rtol=5e-3)


def test_a_structure_that_is_driven_by_a_voltage(tmp_path: Path) -> None:
    """Amplifiers of 20 N/V before both shakers: a response per volt, on its page and in its table of peaks."""
    folder = tmp_path / "bench"
    assert run_command(["new", str(folder), "--template", "frf"]) == 0
    for log in (folder / "logs").iterdir():
        table = np.loadtxt(log, delimiter=",", skiprows=1)
        write_log(log, MASSES, table / [20, 20, 1, 1, 1])
    places = "experiment.recorded.channels"
    options = ["--run", str(folder / "run"), "--jobs", "1", "-q"]
    for i in range(2):
        options += ["--set", f"{places}.{i}.quantity=voltage", "--set", f"{places}.{i}.unit=V"]
    assert run_command(["run", str(folder / "study.yml"), *options]) == 0
    (found,) = read_responses(folder / "run" / "frf.h5")
    assert found.unit == "(m/s^2)/(V)"
    _, coverage = errors(found, 20 * true_response(found.freq_hz))
    assert coverage > 0.9
    assert "(m/s²)/(V)" in (folder / "run" / "report.html").read_text(encoding="utf-8")
    np.testing.assert_allclose(peaks(folder), true_modes()[0] / (2 * np.pi), rtol=1e-4)
