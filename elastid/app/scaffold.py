"""New studies: the templates of `elastid new` and `elastid demo`, and studies that are drafted from logs or robots."""

import json
from collections.abc import Callable, Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from textwrap import indent

import numpy as np

from elastid.app.from_robot import from_robot, is_robot_file
from elastid.base.arrays import FloatArray
from elastid.base.errors import StudyError
from elastid.base.files import open_regular_file
from elastid.store.files import text_file
from elastid.study.reference import SCHEMA_NAME, make_schema

# True parameters in the logs of the template `recorded`, and the torque constant in its study.
TRUTH: Mapping[str, float] = {"k_1": 64.0, "d_1": 0.014, "Jm_1": 1.2e-3, "I_load": 0.8e-3, "fm_1": 2e-3}
TORQUE_CONSTANT = 0.17


def new(folder: Path, template: str) -> Path:
    """Write a new folder with a study, its robot, schema and, if any, small logs; StudyError if it is not empty."""
    _check_new(folder)
    study = _write(folder, _template(template) | _schema())
    if template in EXAMPLE_LOGS:
        EXAMPLE_LOGS[template](folder)
    return study


def new_from_logs(folder: Path, logs: Sequence[Path], more: Sequence[Path] = ()) -> Path:
    """Draft a study of logs, of a robot model, or of both in a new folder; return the path of the study.

    more: further files after the last `--from`.  Raises StudyError for a folder that is not empty or unsuitable files,
    and the errors of `texts_from_logs`.
    """
    if not logs:
        raise StudyError("options/invalid", f"a study has one folder; where {more[0]} is a log write --from before it")
    _check_new(folder)
    robots = [path for path in (*logs, *more) if is_robot_file(path)]
    records = [path for path in (*logs, *more) if not is_robot_file(path)]
    if len(robots) > 1:
        text = f"{robots[0]} and {robots[1]} are two robots, and a study has one; give either"
        raise StudyError("options/invalid", text)
    robot, texts, servos = from_robot(robots[0]) if robots else (None, {}, {})
    if records:
        from elastid.app.from_log import texts_from_logs

        texts = texts_from_logs(folder, records, robot, servos) | {k: v for k, v in texts.items() if k != "study.yml"}
    return _write(folder, {**texts, **_schema()})


def _check_new(folder: Path) -> None:
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        text = f"{folder} exists and is not empty; nothing was written. Give the name of a new folder"
        raise StudyError("options/invalid", text)


def demo(folder: Path) -> Path:
    """Write the study of the demo with its robot, without a schema, into its run folder; existing files are kept."""
    texts = _template("serial")
    _, _, study = texts["study.yml"].partition("\n")
    robot = indent(texts["robot.yml"], "  ")
    return _write(folder, {"study.yml": study.replace("robot: robot.yml\n", f"robot:\n{robot}")})


def _schema() -> dict[str, str]:
    return {SCHEMA_NAME: json.dumps(make_schema(), indent=1) + "\n"}


def _template(name: str) -> dict[str, str]:
    sources = (files("elastid.app") / "templates" / name).iterdir()
    return {source.name: source.read_text(encoding="utf-8") for source in sources}


def _write(folder: Path, texts: Mapping[str, str]) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in texts.items():
        if not (folder / name).exists():
            # The opener rejects a link to a missing file.
            with open(folder / name, "x", encoding="utf-8", newline="\n", opener=open_regular_file) as file:
                file.write(text)
    return folder / "study.yml"


def write_shaken_masses(folder: Path) -> None:
    """Write logs/bench_1.csv to bench_4.csv of three masses and two shakers: two realisations of two experiments."""
    from elastid.experiment.simulated.plant import shake

    columns = ("force_1", "force_3", "acc_1", "acc_2", "acc_3")
    logs = (log for realisation in range(2) for log in shake(256.0, 2048, 4, 1 + realisation))
    for i, log in enumerate(logs, start=1):
        _write_log(folder / "logs" / f"bench_{i}.csv", columns, log)


def write_elastic_joint(folder: Path) -> None:
    """Write logs/bench_1.csv and bench_2.csv of the template's robot with the parameters `TRUTH`."""
    from elastid.api import read_robot, simulate

    rig = {"truth": dict(TRUTH), "outputs": ["motor 1", "joint 1"], "noise": {"torque_std": 1e-4, "angle_std": 2e-6}}
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
