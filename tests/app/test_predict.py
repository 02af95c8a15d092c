"""Friction of one study on the logs of another."""

import json
from collections.abc import Callable
from pathlib import Path
from textwrap import indent

import numpy as np
import pytest
from plants.cogged_joint import CoggedJoint, simulated
from plants.moving_arm import ARM, motion
from plants.runs import summary_of

from elastid.app import cli
from elastid.app.predict_commands import on_logs
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


@pytest.fixture(scope="module")
def study_of(tmp_path_factory) -> Callable[..., Path]:
    """The study of a log of a rigid axis with J = 6 kg*m^2, f = 20 N*m*s/rad and a Coulomb friction."""

    def made(name: str, seed: int, coulomb: float) -> Path:
        folder = tmp_path_factory.mktemp(name)
        rng, t = np.random.default_rng(seed), np.arange(32000) * 5e-4
        waves = zip(rng.uniform(0.1, 1.5, 5), rng.uniform(0, 2 * np.pi, 5), rng.uniform(0.1, 0.4, 5), strict=True)
        reference = sum(size / f**0.7 * np.sin(2 * np.pi * f * t + phase) for f, phase, size in waves)
        joint = CoggedJoint(6.0, coulomb, coulomb, viscous=20.0, gravity=0.0, cogging=0.0)
        q, u = (signal[::4] for signal in simulated([joint], [reference], 5e-4)[0])
        np.savetxt(folder / "log.csv", np.stack([u + rng.normal(0, 0.5, len(u)), q], axis=1), delimiter=",")
        (folder / "study.yml").write_text(STUDY)
        return folder / "study.yml"

    return made


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


@pytest.mark.slow
def test_friction_explains_same_axis_and_not_higher_friction(study_of: Callable[..., Path], tmp_path: Path) -> None:
    """As well as a regression of that log; where Coulomb friction is 4 Nm more, what is left is that, 0.1 % off."""
    first, second, third = study_of("first", 1, 12.0), study_of("second", 2, 12.0), study_of("third", 2, 16.0)
    assert command("run", first, "--run", tmp_path / "first") == 0
    left = {}
    for name, study in (("second", second), ("third", third)):
        folder = tmp_path / name
        assert command("predict", study, "--with", tmp_path / "first", "--run", folder) == 0
        content = summary_of(folder, "prediction.json")
        (torque,) = content["torque"]
        left[name] = torque["unexplained_fraction"]
        assert content["not_predicted"] == {}
        assert torque["unexplained_fraction"] < torque["unexplained_without_friction"]
        (run,) = content["simulation"]
        (angle,) = (signal for signal in run["signals"] if signal["signal"] == "motor angle")
        assert angle["error"] < 0.2
        u = np.loadtxt(study.parent / "log.csv", delimiter=",")[:, 0]
    assert left["second"] < 1e-4
    assert left["third"] * np.mean(u**2) == pytest.approx(4.0**2, rel=0.15)


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
