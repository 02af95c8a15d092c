"""A hammer at several points, or sensors that move between files: one response matrix, and its mode shapes."""

import csv
import re
from pathlib import Path

import numpy as np
import pytest

from elastid.app.cli import run_command
from elastid.logs.responses.universal_files import geometry_of_files
from elastid.modal.estimate import estimate_modes
from elastid.store.measured import read_responses
from elastid.study import load

RATE, N, PERIODS = 512, 1024, 4
MODES = (18.4, 0.03), (47.1, 0.02), (96.0, 0.03)  # Hz, damping ratio
SHAPES = np.array([[0.4, 0.9, 1.0], [1.0, 0.3, -0.9], [0.8, -1.0, 0.6]])  # points x modes


def hits(folder: Path, name: str, hammer: int, sensors: list[int], noise: int = 0) -> None:
    """A log of hits every two seconds at a point, with accelerometers at others, in a steady state."""
    rng, time = np.random.default_rng(hammer + 10 * sensors[0] + 100 * noise), np.arange(N * PERIODS) / RATE
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


def drafted(folder: Path, names: list[str]) -> Path:
    """The study that `elastid new` writes of logs."""
    study = folder / "s" / "study.yml"
    assert run_command(["new", str(study.parent), "--from", *(str(folder / name) for name in names)]) == 0
    assert run_command(["check", str(study)]) == 0
    return study


def ran(study: Path, code: int = 0) -> Path:
    """The folder of a run that ended with a code."""
    assert run_command(["run", str(study), "-q", "--run", str(study.parent / "run")]) == code
    return study.parent / "run"


@pytest.mark.parametrize("moves", ["hammer", "sensor"])
def test_files_of_several_points_are_one_response_matrix(moves: str, tmp_path: Path) -> None:
    """Points 1 and 3 see three hit points, or one hit point moves three sensors one by one: shapes within 1 %.

    That the hammer moved is known from the responses, that the sensor did from the names of the files.
    """
    places = [f"{'' if moves == 'hammer' else 'sensor'}{k}" for k in range(3)]
    for k, place in enumerate(places):
        hits(tmp_path, f"{place}.csv", *((k, [0, 2]) if moves == "hammer" else (0, [k])))
    run = ran(drafted(tmp_path, [f"{place}.csv" for place in places]))
    assert "frf/records" not in codes(run)
    V = SHAPES / np.linalg.norm(SHAPES, axis=0)
    (response,) = read_responses(run / "frf.h5")
    alike = [value for _, value in estimate_modes(response).most_alike]
    np.testing.assert_allclose(alike, (np.abs(V.T @ V) ** 2 - 2 * np.eye(3)).max(axis=0), atol=0.02)
    with open(run / "modes.csv") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 3
    for row, (f, zeta), shape in zip(rows, MODES, SHAPES.T, strict=True):
        assert float(row["frequency"]) == pytest.approx(f, rel=1e-3)
        assert float(row["damping_ratio"]) == pytest.approx(zeta, rel=1e-2)
        measured = np.array([float(row[f"re_{place}"]) for place in places])
        np.testing.assert_allclose(measured / measured[0], shape / shape[0], atol=0.02 * abs(shape / shape[0]).max())


def test_files_of_several_points_taken_as_repetitions_are_named(tmp_path: Path) -> None:
    for k in range(3):
        hits(tmp_path, f"{k}.csv", k, [0, 2])
    study = drafted(tmp_path, [f"{k}.csv" for k in range(3)])
    study.write_text(re.sub(r"realisation: 0, experiment: (\d), at: {.*?}", r"realisation: \1", study.read_text()))
    assert "frf/records" in codes(ran(study))


@pytest.mark.parametrize(
    ("points", "places"),
    [
        ([("rep_0", 0), ("rep_1", 0)], [{}, {}]),
        ([("p1_0", 0), ("p1_1", 0), ("p2_0", 1)], [{"force": "p1"}, {"force": "p1"}, {"force": "p2"}]),
        ([("left", 0), ("right", 1), ("again", 0)], [{"force": "left"}, {"force": "right"}, {"force": "left"}]),
        ([("p3z_acc1", 0), ("p4z_acc1", 0)], [{"force": "p3 z"}, {"force": "p4 z"}]),
        ([("p3_acc1", 0), ("p3_acc2", 0)], [{"acc_0": "acc1"}, {"acc_0": "acc2"}]),
    ],
)
def test_locations_of_files_are_by_names_or_responses(
    points: list[tuple[str, int]], places: list[dict[str, str]], tmp_path: Path
) -> None:
    """Repetitions at a point have equal responses; a name with point or sensor counts more."""
    for i, (name, hammer) in enumerate(points):
        hits(tmp_path, f"{name}.csv", hammer, [0], noise=i)
    files = load(drafted(tmp_path, [f"{name}.csv" for name, _ in points])).study.experiment.as_recorded().files
    assert [file.at for file in files] == places
    assert len({(file.realisation, file.experiment) for file in files}) == len(files)


def test_headings_of_a_file_are_its_locations(tmp_path: Path) -> None:
    """Hammer at p1 and p2 by the headings of the force; a file without one of the channels is refused."""
    for k in (1, 2):
        hits(tmp_path, f"{k}.csv", k, [0])
        text = (tmp_path / f"{k}.csv").read_text()
        (tmp_path / f"{k}.csv").write_text(text.replace("force [N]", f"force p{k} [N]"))
    recorded = load(drafted(tmp_path, ["1.csv", "2.csv"])).study.experiment.as_recorded()
    assert recorded.places_of("bench", "u") == ("force p1", "force p2")
    hits(tmp_path, "3.csv", 0, [0, 1])
    (tmp_path / "3.csv").write_text((tmp_path / "3.csv").read_text().replace("acc_0", "sensor"))
    assert run_command(["new", str(tmp_path / "n"), "--from", str(tmp_path / "1.csv"), str(tmp_path / "3.csv")]) == 1


def codes(run: Path) -> set[str]:
    """The codes of the notes on the response of a run."""
    return {note.code for response in read_responses(run / "frf.h5") for note in response.notes}


def test_time_histories_of_universal_files_have_hit_points_and_geometry(tmp_path: Path) -> None:
    """Nodes of force and accelerations differ from file to file; a drive point has two functions."""
    pyuff = pytest.importorskip("pyuff")
    nodes = {"type": 15, "node_nums": [1, 2, 3], "x": [0.0, 0.5, 1.0], "y": [0.0] * 3, "z": [0.0] * 3}
    nodes |= {"def_cs": [0] * 3, "disp_cs": [0] * 3, "color": [0] * 3}
    for k in range(3):
        hits(tmp_path, f"{k}.csv", k, [0, 2])
        t, *signals = np.loadtxt(tmp_path / f"{k}.csv", delimiter=",", skiprows=1).T
        sets = [nodes]
        for node, kind, unit, x in zip((k + 1, 1, 3), (13, 12, 12), ("N", *["m/s^2"] * 2), signals, strict=True):
            sets.append({
                "type": 58, "func_type": 1, "rsp_node": node, "rsp_dir": 3, "ref_node": 0, "ref_dir": 0, "data": x,
                "x": t, "id1": "t", "rsp_ent_name": "NONE", "ref_ent_name": "NONE", "abscissa_spacing": 1,
                "abscissa_inc": 1 / RATE, "abscissa_spec_data_type": 17, "ordinate_spec_data_type": kind,
                "orddenom_spec_data_type": 0, "ordinate_axis_units_lab": unit,
            })  # fmt: skip
        pyuff.UFF(str(tmp_path / f"{k}.uff")).write_sets(sets, "overwrite")
    study = drafted(tmp_path, [f"{k}.uff" for k in range(3)])
    experiment = load(study).study.experiment
    assert experiment.as_recorded().places_of("bench", "u") == ("1z", "2z", "3z")
    geometry = geometry_of_files(experiment, study.parent)
    assert geometry.motion == {f"{node}z": (f"{node}", "z") for node in (1, 2, 3)}
    (response,) = read_responses(ran(study) / "frf.h5")
    assert (response.inputs, response.outputs) == (("1z", "2z", "3z"), ("1z", "3z"))


def test_a_sensor_whose_files_miss_a_hit_point_is_refused(tmp_path: Path) -> None:
    for k in range(3):
        hits(tmp_path, f"{k}.csv", k, [0])
    study = drafted(tmp_path, [f"{k}.csv" for k in range(3)])
    places = iter(("{acc_0: a}", "{acc_0: a, force: p1}", "{acc_0: b}"))
    study.write_text(re.sub(r"at: {.*?}}", lambda _: f"at: {next(places)}}}", study.read_text()))
    ran(study, code=1)


def test_first_hit_point_may_keep_channel_location(tmp_path: Path) -> None:
    """Only the files of further points state `at`."""
    for k in range(2):
        hits(tmp_path, f"p{k}.csv", k, [0])
    study = drafted(tmp_path, ["p0.csv", "p1.csv"])
    study.write_text(study.read_text().replace(", at: {force: p0}", ""))
    (response,) = read_responses(ran(study) / "frf.h5")
    assert response.inputs == ("force", "p1")
