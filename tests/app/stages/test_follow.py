"""elastid follow: friction of a log that warms up, followed with bands, drawn, and exported as C."""

from pathlib import Path

import numpy as np
import pytest

from elastid.app.cli import run_command
from elastid.store.friction_study import read_filter
from tests.plants.warm_joint import COULOMB, JOINT, RATE_HZ, VISCOUS, rich, simulate

ROBOT = f"""
name: one axis
gravity: [0, 0, -9.81]
bodies:
  - name: arm
    joints:
      - name: 1
        axis: z
        motor: {{inertia: {JOINT.motor_inertia / 4}, ratio: 2, viscous: {VISCOUS / 4}, coulomb: {COULOMB / 2}}}
        spring: {{stiffness: {JOINT.stiffness}, damping: {JOINT.damping}}}
    inertia: {JOINT.link_inertia}
"""
STUDY = f"""
name: warm_axis
robot: robot.yml
friction: {{joints: [1]}}
filter: {{states: [Fc, f, offset], drift: 2.236, settle: 5 s, torque_std: 0.05, correlation_time: 0}}
experiment:
  recorded:
    rate_hz: {RATE_HZ:g}
    channels:
      - {{role: u, at: motor 1, channel: torque, quantity: torque, unit: N*m}}
      - {{role: y, at: motor 1, channel: angle, quantity: position, unit: rad}}
    files:
      - {{path: log.csv, joint: 1}}
"""


@pytest.fixture(scope="module")
def study(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A study of a log of 20 s."""
    folder = tmp_path_factory.mktemp("follow")
    run = simulate(rich(20), seed=6, offset=0.0, stiction_ratio=1.0)
    samples = run.samples
    read = np.concatenate([[0.0], samples.angle[:-1]])  # when the torque begins that is then held
    rows = np.column_stack([np.arange(len(read)) / RATE_HZ, samples.torque, read])
    np.savetxt(folder / "log.csv", rows, "%.9g", ",", header="t,torque,angle", comments="")
    (folder / "robot.yml").write_text(ROBOT)
    (folder / "study.yml").write_text(STUDY)
    return folder / "study.yml"


@pytest.mark.slow
def test_friction_of_a_log_is_followed(study: Path) -> None:
    """The torque of sliding at the end of a warm-up is within 2 %, drawn, and its filter is exported as C."""
    run = study.parent / "run"
    for stage in ("measure", "levels", "friction", "follow", "report"):
        assert run_command([stage, str(study), "--run", str(run), "-q"]) == 0
    (found,) = read_filter(run / "filter.h5")
    assert 0.6 * VISCOUS < found.filtered.viscous < 1.2 * VISCOUS  # link side, as all of the joint
    end = dict(zip(found.names, found.values[-1].tolist(), strict=True))
    warmth, speed = 1 - np.exp(-1), 30.0
    true = COULOMB * (1 - 0.15 * warmth) + VISCOUS * (1 - 0.5 * warmth) * speed
    assert end["Fc"] + end["f"] * speed == pytest.approx(true, rel=0.02)
    assert list((run / "figures").glob("*filter.png"))
    assert run_command(["export", str(study), "--run", str(run), "--to", "observer", "-q"]) == 0
    assert "joint_1_follow" in (run / "export" / "observer" / "observer.h").read_text()


def test_what_follow_needs_is_said(study: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A study without the section, and a filter of a study of elasticity."""
    plain = tmp_path / "study.yml"
    text = study.read_text().replace("robot.yml", str(study.parent / "robot.yml"))
    plain.write_text("\n".join(line for line in text.splitlines() if not line.startswith("filter")))
    (tmp_path / "log.csv").write_bytes((study.parent / "log.csv").read_bytes())
    assert run_command(["follow", str(plain), "--run", str(tmp_path / "run")]) == 2
    assert "give filter: {}" in capsys.readouterr().err
    plain.write_text("\n".join(line for line in text.splitlines() if not line.startswith("friction")))
    assert run_command(["check", str(plain)]) == 2
    assert "a filter follows friction" in capsys.readouterr().err
