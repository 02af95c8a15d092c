"""`elastid new DIR --from LOG` writes a study that is accepted and runs, every guess marked."""

import json
from pathlib import Path

import numpy as np
import pytest
from plants.measured import BENCH, EMPS, KUKA, measured

from elastid.app import cli
from elastid.study import load_with_logs

REAL = {
    EMPS: ("friction-recorded", "qm", "rate_hz: 1000"),
    KUKA: ("friction-recorded", "rec.act_pos_mot_deg", "rate_hz: 250"),
    BENCH: ("frf", "theta_mx", "period_samples: 2500"),
}


@pytest.fixture
def motion(tmp_path: Path) -> Path:
    """A semicolon-separated log of two joints that move slowly, with times in ms and angles in deg."""
    rate, t = 200.0, np.arange(6000) / 200.0
    columns = {"time": 1000 * t}
    for k in range(2):
        omega = np.array([0.9, 2.1, 3.3]) * (1 + 0.31 * k)
        q, v, a = (sum(0.2 * w**m * np.sin(w * t + m * np.pi / 2) for w in omega) for m in range(3))
        noise = 0.1 * np.random.default_rng(k).standard_normal(len(t))
        columns |= {f"Torque{k + 1} [Nm]": 3 * a + 5 * v + 4 * np.sign(v) + noise, f"Angle{k + 1} [deg]": np.rad2deg(q)}
    assert len(t) == 30 * rate
    rows = np.stack(list(columns.values()), axis=1)
    np.savetxt(tmp_path / "motion.csv", rows, "%.8g", ";", header=";".join(columns), comments="")
    return tmp_path / "motion.csv"


@pytest.mark.slow
def test_a_motion_becomes_a_study_of_friction_that_runs(motion: Path, tmp_path: Path) -> None:
    """Coulomb and viscous friction of both joints within 1 %."""
    folder = tmp_path / "new"
    assert cli.run_command(["new", str(folder), "--from", str(motion)]) == 0
    text = (folder / "study.yml").read_text()
    assert text.count("# guessed: ") >= 6
    assert cli.run_command(["check", str(folder / "study.yml")]) == 0
    assert cli.run_command(["run", str(folder / "study.yml"), "--run", str(folder / "run"), "-q"]) in (0, 3)
    summary = json.loads((folder / "run" / "summary.json").read_text())
    numbers = {name: number["value"] for name, number in summary["parameters"].items()}
    for k in (1, 2):
        assert numbers[f"Fc_m{k}"] == pytest.approx(4, rel=0.01)
        assert numbers[f"f_m{k}"] == pytest.approx(5, rel=0.01)


def test_a_hammer_test_without_its_force_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Two accelerometers alone; with the hammer's column the same log becomes a study."""
    a = np.random.default_rng(0).normal(size=(400, 3))
    columns = "a1 (m/s^2),a2 (g),Impact (N)"
    for n, code in ((2, 1), (3, 0)):
        log = tmp_path / f"{n}.csv"
        np.savetxt(log, a[:, :n], delimiter=",", header=",".join(columns.split(",")[:n]), comments="")
        assert cli.run_command(["new", str(tmp_path / f"s{n}"), "--from", str(log)]) == code
    assert "no names and units say which signals are torques" in capsys.readouterr().err
    assert "# Not used" not in (tmp_path / "s3" / "study.yml").read_text()


def test_a_path_that_is_none_and_a_robot_among_logs_are_said(
    motion: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for paths, said in (
        ((motion, "lost.csv"), "lost.csv: there is no such file"),
        (("arm.urdf", "other.xml", motion), "arm.urdf and"),
    ):
        wanted = [str(tmp_path / path) for path in paths]
        assert cli.run_command(["new", str(tmp_path / "new"), "--from", *wanted]) in (1, 2)
        assert said in capsys.readouterr().err


@pytest.mark.parametrize("name", REAL)
def test_real_logs_become_studies_that_check_accepts(name: str, tmp_path: Path) -> None:
    kind, motion, line = REAL[name]
    assert cli.run_command(["new", str(tmp_path / "new"), "--from", str(measured(name))]) == 0
    assert line in (tmp_path / "new" / "study.yml").read_text()
    study = load_with_logs(tmp_path / "new" / "study.yml").study
    assert study.kind == kind
    assert motion in [c.channel for c in study.experiment.channels if c.role == "y"]
