"""A hammer at several points, or sensors that move between files: one response matrix, and its mode shapes."""

import csv
import re
from pathlib import Path

import numpy as np
import pytest

from elastid.app.cli import run_command
from elastid.modal.estimate import estimate_modes
from elastid.store.measured import read_responses

RATE, N, PERIODS = 512, 1024, 4
MODES = (18.4, 0.03), (47.1, 0.02), (96.0, 0.03)  # Hz, damping ratio
SHAPES = np.array([[0.4, 0.9, 1.0], [1.0, 0.3, -0.9], [0.8, -1.0, 0.6]])  # points x modes


def hits(folder: Path, name: str, hammer: int, sensors: list[int]) -> None:
    """A log of hits every two seconds at a point, with accelerometers at others, in a steady state."""
    rng, time = np.random.default_rng(hammer + 10 * sensors[0]), np.arange(N * PERIODS) / RATE
    force = 900 * np.exp(-0.5 * (((time - 0.1 * hammer) % 2 - 0.4) / 2e-3) ** 2)
    s = 2j * np.pi * np.fft.rfftfreq(len(time), 1 / RATE)
    columns = [time, force + rng.normal(0, 0.2, len(time))]
    for sensor in sensors:
        G = sum(
            SHAPES[hammer, i] * SHAPES[sensor, i] * s**2 / (s**2 + 2 * zeta * w * s + w**2) / 50
            for i, (w, zeta) in enumerate((2 * np.pi * f, zeta) for f, zeta in MODES)
        )
        columns.append(np.fft.irfft(G * np.fft.rfft(force), len(time)) + rng.normal(0, 0.01, len(time)))
    names = ["time [s]", "force [N]", *(f"acc_{k} [m/s^2]" for k in range(len(sensors)))]
    np.savetxt(folder / name, np.stack(columns, 1), delimiter=",", header=",".join(names), comments="", fmt="%.9g")


@pytest.mark.parametrize("moves", ["hammer", "sensor"])
def test_files_of_several_points_are_one_response_matrix(moves: str, tmp_path: Path) -> None:
    """Points 1 and 3 see three hit points, or one hit point moves three sensors one by one: shapes within 1 %."""
    for k in range(3):
        hits(tmp_path, f"{k}.csv", *((k, [0, 2]) if moves == "hammer" else (0, [k])))
    study, logs = tmp_path / "s" / "study.yml", [str(tmp_path / f"{k}.csv") for k in range(3)]
    assert run_command(["new", str(study.parent), "--from", *logs]) == 0
    text, key = study.read_text(), "force" if moves == "hammer" else "acc_0"
    if moves == "hammer":
        assert run_command(["run", str(study), "-q", "--run", str(tmp_path / "mixed")]) == 0
        assert "frf/records" in codes(tmp_path / "mixed")
    text = re.sub(r"realisation: (\d)}", lambda m: f"at: {{{key}: p{m[1]}}}, experiment: {m[1]}}}", text)
    study.write_text(text.replace("at: acc_0,", "at: p0,").replace("at: acc_1,", "at: p2,") if key == "force" else text)
    assert run_command(["run", str(study), "-q", "--run", str(tmp_path / "run")]) == 0
    assert "frf/records" not in codes(tmp_path / "run")
    V = SHAPES / np.linalg.norm(SHAPES, axis=0)
    (response,) = read_responses(tmp_path / "run" / "frf.h5")
    alike = [value for _, value in estimate_modes(response).most_alike]
    np.testing.assert_allclose(alike, (np.abs(V.T @ V) ** 2 - 2 * np.eye(3)).max(axis=0), atol=0.02)
    with open(tmp_path / "run" / "modes.csv") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 3
    for row, (f, zeta), shape in zip(rows, MODES, SHAPES.T, strict=True):
        assert float(row["frequency"]) == pytest.approx(f, rel=1e-3)
        assert float(row["damping_ratio"]) == pytest.approx(zeta, rel=1e-2)
        measured = np.array([float(row[f"re_p{k}"]) for k in range(3)])
        np.testing.assert_allclose(measured / measured[0], shape / shape[0], atol=0.02 * abs(shape / shape[0]).max())


def codes(run: Path) -> set[str]:
    """The codes of the notes on the response of a run."""
    return {note.code for response in read_responses(run / "frf.h5") for note in response.notes}


def test_a_sensor_whose_files_miss_a_hit_point_is_refused(tmp_path: Path) -> None:
    for k in range(3):
        hits(tmp_path, f"{k}.csv", k, [0])
    study = tmp_path / "s" / "study.yml"
    assert run_command(["new", str(study.parent), "--from", *(str(tmp_path / f"{k}.csv") for k in range(3))]) == 0
    places = iter(("{acc_0: a}", "{acc_0: a, force: p1}", "{acc_0: b}"))
    text = re.sub(r"realisation: (\d)}", lambda m: f"at: {next(places)}, experiment: {m[1]}}}", study.read_text())
    study.write_text(text)
    assert run_command(["run", str(study), "-q", "--run", str(tmp_path / "run")]) == 1


def test_the_first_hit_point_may_keep_the_location_of_its_channel(tmp_path: Path) -> None:
    """As the drafted study says: only the files of further points state `at`."""
    for k in range(2):
        hits(tmp_path, f"{k}.csv", k, [0])
    study = tmp_path / "s" / "study.yml"
    assert run_command(["new", str(study.parent), "--from", *(str(tmp_path / f"{k}.csv") for k in range(2))]) == 0
    study.write_text(study.read_text().replace("realisation: 1}", "at: {force: p1}, experiment: 1}"))
    assert run_command(["run", str(study), "-q", "--run", str(tmp_path / "run")]) == 0
    (response,) = read_responses(tmp_path / "run" / "frf.h5")
    assert response.inputs == ("force", "p1")
