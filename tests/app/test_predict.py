"""Friction of one study on the logs of another."""

import json
from pathlib import Path
from textwrap import indent

import numpy as np
import pytest
from plants.moving_arm import ARM, motion
from plants.runs import summary_of

from elastid.app import cli
from elastid.app.predict_logs import on_logs
from elastid.study.robots import yaml_text

STUDY = """
name: axis
robot:
  name: axis
  gravity: [0, 0, 0]
  bodies: [{name: arm, joints: [{name: "1", axis: z, motor: {inertia: 6, ratio: 1}}]}]
friction: {constant_velocity: detect}
experiment:
  recorded:
    rate_hz: 500
    channels:
      - {role: u, at: motor 1, channel: column 1, unit: N*m}
      - {role: y, at: motor 1, channel: column 2, quantity: position, unit: rad}
    files: [{path: log.csv}]
"""


def test_command_line_logs_keep_keys_of_replaced_files(tmp_path: Path) -> None:
    """The last of the first where there are more; not those of one log alone."""
    files = "{path: a.csv, configuration: a}, {path: b.csv, configuration: b, samples: [0, 9]}"
    (tmp_path / "study.yml").write_text(STUDY.replace("{path: log.csv}", files))
    logs = [tmp_path / f"{name}.csv" for name in "xyz"]
    (override,) = on_logs(tmp_path / "study.yml", logs, {"overrides": (), "folder": None})["overrides"]
    expected = [{"path": str(log), "configuration": name} for log, name in zip(logs, "abb", strict=True)]
    assert json.loads(override.partition("experiment.recorded.files=")[2]) == expected


def command(*words: str | Path) -> int:
    return cli.run_command([*map(str, words), "-q"])


OTHER = ARM.with_parameters({"m_upper": 3.0, "m_fore": 2.0, "Jm_1": 1e-3})
TWO_AXES = f"""
name: arm
robot:
{indent(yaml_text(OTHER), "  ")}friction: {{constant_velocity: detect}}
experiment:
  recorded:
    rate_hz: 250
    channels:
      - {{role: u, at: motor 1, channel: column 1}}
      - {{role: u, at: motor 2, channel: column 2}}
      - {{role: y, at: motor 1, channel: column 3, quantity: position}}
      - {{role: y, at: motor 2, channel: column 4, quantity: position}}
    files: [{{path: first.csv}}, {{path: second.csv}}]
validation: {{configurations: [second]}}
"""


def two_axes(folder: Path, name: str, seed: int, missing: float = 0.0) -> Path:
    """A log of two axes under gravity whose masses are others than those of the study."""
    motions = motion(seed, missing=missing)
    columns = [each.torque for each in motions.values()] + [each.position for each in motions.values()]
    np.savetxt(folder / name, np.stack(columns, axis=1), delimiter=",")
    return folder / name


@pytest.mark.slow
def test_rigid_body_and_friction_explain_other_joint_logs(tmp_path: Path) -> None:
    """A log that was left out, and one of the command line, nearly as well as a regression of it; a spring is seen."""
    study, run = tmp_path / "study.yml", tmp_path / "run"
    study.write_text(TWO_AXES)
    two_axes(tmp_path, "first.csv", 1)
    two_axes(tmp_path, "second.csv", 2)
    assert command("run", study, "--run", run, "--jobs", "1") == 0
    summary = summary_of(run)
    assert {row["log"] for row in summary["torque"]} == {"first"}
    (body,) = summary["rigid_bodies"]
    assert body["joints"] == ["1", "2"]
    assert body["base_parameters"]["mcx_2"]["unit"] == "kg*m"
    assert 'id="left-out"' in (run / "report.html").read_text(encoding="utf-8")
    logs = two_axes(tmp_path, "third.csv", 3), two_axes(tmp_path, "sprung.csv", 4, missing=40.0)
    words = [word for log in logs for word in ("--log", log)]
    assert command("predict", study, "--with", run, *words, "--run", tmp_path / "other", "--jobs", "1") == 0
    prediction = summary_of(tmp_path / "other", "prediction.json")
    left = {(row["log"], row["place"]): row for row in (*summary["validation"]["torque"], *prediction["torque"])}
    assert len(left) == 6
    for (log, _), row in left.items():
        assert set(row["fractions"]) == {"rigid body", "viscous friction", "dry friction"}
        assert row["unexplained_fraction"] < row["unexplained_without_friction"]
        if log == "sprung":
            assert row["unexplained_fraction"] > 5e-3
        else:
            assert row["unexplained_fraction"] < 1e-3
    assert (tmp_path / "other" / "prediction.png").is_file()
    assert command("export", study, "--to", "csv", "--run", run) == 0
    table = (run / "export" / "csv" / "base_parameters.csv").read_text(encoding="utf-8").splitlines()
    assert len(table) == 1 + len(body["base_parameters"])
