"""Studies to start from: the templates of `elastid new` and `elastid demo`, some with a small simulated log."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from textwrap import indent

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import StudyError
from elastid.base.files import unlinked
from elastid.store.files import text_file
from elastid.study import SCHEMA_NAME, make_schema

# Numbers that the fit of the template `recorded` is to identify, and the torque constant in its study.
TRUTH: Mapping[str, float] = {"k_1": 64.0, "d_1": 0.014, "Jm_1": 1.2e-3, "I_load": 0.8e-3, "fm_1": 2e-3}
TORQUE_CONSTANT = 0.17


def new(folder: Path, template: str) -> Path:
    """A new folder with a study, its robot, a small log where it is of logs, and the schema; returns the study's path.

    Raises StudyError where the folder holds anything already.
    """
    _check_new(folder)
    study = _write(folder, _template(template))
    if template in EXAMPLE_LOGS:
        EXAMPLE_LOGS[template](folder)
    return study


def new_from_logs(folder: Path, logs: Sequence[Path], more: Sequence[Path] = ()) -> Path:
    """A new folder with a study of logs, of a URDF or MJCF file, or of both, guessed, with its robot; its path.

    more: those behind the last `--from`.  Raises StudyError where there is none such, or the folder holds anything
    already, and what `texts_from_logs` raises.
    """
    if not logs:
        raise StudyError("options/invalid", f"a study has one folder; where {more[0]} is a log write --from before it")
    _check_new(folder)
    from elastid.app.from_robot import from_robot, is_robot_file

    robots = [path for path in (*logs, *more) if is_robot_file(path)]
    records = [path for path in (*logs, *more) if not is_robot_file(path)]
    if len(robots) > 1:
        raise StudyError(
            "options/invalid", f"{robots[0]} and {robots[1]} are two robots, and a study has one; give either"
        )
    robot, texts = from_robot(robots[0]) if robots else (None, {})
    if records:
        from elastid.app.from_log import texts_from_logs

        texts = texts_from_logs(folder, records, robot) | {k: v for k, v in texts.items() if k != "study.yml"}
    return _write(folder, texts)


def _check_new(folder: Path) -> None:
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise StudyError(
            "files/folder", f"{folder} exists and is not empty; nothing was written. Give the name of a new folder"
        )


def demo(folder: Path) -> Path:
    """The demo's study in its run folder, its robot in it, to copy and edit; existing files are kept."""
    texts = _template("serial")
    robot = indent(texts.pop("robot.yml"), "  ")
    return _write(folder, {"study.yml": texts["study.yml"].replace("robot: robot.yml\n", f"robot:\n{robot}")})


def _template(name: str) -> dict[str, str]:
    """The texts of a template by file."""
    sources = (files("elastid.app") / "templates" / name).iterdir()
    return {source.name: source.read_text(encoding="utf-8") for source in sources}


def _write(folder: Path, texts: Mapping[str, str]) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in ({**texts, SCHEMA_NAME: json.dumps(make_schema(), indent=1) + "\n"}).items():
        if not (folder / name).exists():
            # Not through a link to a file that is yet to be made.
            with open(folder / name, "x", encoding="utf-8", newline="\n", opener=unlinked) as file:
                file.write(text)
    return folder / "study.yml"


def write_shaken_masses(folder: Path) -> None:
    """logs/bench_1.csv to bench_4.csv of three masses with two shakers: two realisations of two experiments."""
    from elastid.experiment.simulated.structure import shake

    columns = ("force_1", "force_3", "acc_1", "acc_2", "acc_3")
    logs = (log for realisation in range(2) for log in shake(256.0, 2048, 4, 1 + realisation))
    for i, log in enumerate(logs, start=1):
        _write_log(folder / "logs" / f"bench_{i}.csv", columns, np.hstack([log.force, log.acceleration]))


def write_elastic_joint(folder: Path) -> None:
    """logs/bench_1.csv and bench_2.csv of the template's robot with other numbers than its file has."""
    from elastid.verbs import read_robot, simulate

    noise = {"torque_std": 1e-4, "angle_std": 2e-6}
    rig = {"truth": dict(TRUTH), "outputs": ["motor 1", "joint 1"], "noise": noise}
    experiment = {"configurations": {"bench": [0]}, "periods": 4, "simulated": rig}
    excitation = {"rate_hz": 1000, "period": 2, "band_hz": [1, 150], "torque_rms": 0.1}
    records = simulate(read_robot(folder / "robot.yml"), excitation=excitation, experiment=experiment, seed=1)
    columns = ("current", "motor_angle", "load_angle")
    for i, record in enumerate(records, start=1):
        _write_log(folder / "logs" / f"bench_{i}.csv", columns, np.hstack([record.u / TORQUE_CONSTANT, record.y]))


EXAMPLE_LOGS: Mapping[str, Callable[[Path], None]] = {"recorded": write_elastic_joint, "frf": write_shaken_masses}


def _write_log(path: Path, columns: Sequence[str], values: FloatArray) -> None:
    path.parent.mkdir(exist_ok=True)
    with text_file(path) as file:
        np.savetxt(file, values, fmt="%.6g", delimiter=",", header=",".join(columns), comments="")
