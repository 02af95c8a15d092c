"""A friction study is run, resumed, refused and exported as every other one."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from plants import runs
from plants.friction_records import TEMPLATE
from plants.lugre_joint import COULOMB, RATE_HZ, ROBOT, VISCOUS, rich, simulate
from plants.refusals import refused
from plants.runs import summary_of
from scipy.signal import butter, sosfiltfilt

from elastid.app.cli import run_command
from elastid.app.export import export
from elastid.app.run import Run, run_all
from elastid.robot.friction_numbers import friction_numbers
from elastid.store.friction_study import read_filter, read_friction_records, read_friction_result
from elastid.study import load_robot

# Few and short passes: the least that distinguishes Coulomb and viscous friction.
SMALL = (
    "friction.rate_hz=500",
    "friction.constant_velocity={count: 5, repeat: 1, speeds: [10 deg/s, 60 deg/s], window: [-30 deg, 30 deg]}",
    "friction.law={stribeck: no, directions: no, load: no, temperature: no}",
    "report.formats=[]",
)


def run_of(folder: Path) -> Run:
    return runs.run_of(folder / "study.yml", folder / "run", *SMALL)


@pytest.fixture(scope="module")
def finished(tmp_path_factory) -> Path:
    """The folder of a small study that was run."""
    folder = tmp_path_factory.mktemp("friction")
    shutil.copytree(TEMPLATE, folder, dirs_exist_ok=True)
    run_all(run_of(folder))
    return folder


def test_a_study_leaves_its_artefacts_and_keeps_them(finished: Path) -> None:
    """plan, references, records, levels, law, summary, robot and page; nothing is done twice."""
    names = {path.name for path in (finished / "run").iterdir()}
    assert {"plan.h5", "references", "records.h5", "constant_velocity.h5", "friction.h5", "summary.json"} <= names
    assert {"identified_robot.yml", "report.html", "run.log"} <= names
    run = run_of(finished)
    assert list(run.stages) == ["design", "measure", "constant_velocity", "friction", "report"]
    assert all(run.is_current(name) for name in run.stages)
    records = read_friction_records(finished / "run" / "records.h5").records
    assert len(list((finished / "run" / "references").iterdir())) == len(records)
    summary = summary_of(finished / "run")
    assert summary["status"] == "identified"
    assert {"value", "std", "interval95", "unit", "learnt_from", "truth"} <= set(summary["parameters"]["Fc_m1"])


def test_the_identified_robot_is_exported_and_read(finished: Path) -> None:
    """Its friction is that of the table; other tools take an elastic fit."""
    run = run_of(finished)
    (path,) = export(run, "robot")
    numbers = friction_numbers(load_robot(path))
    for number in read_friction_result(run.path("friction")).numbers:
        if number.name in numbers:
            assert numbers[number.name][0] == pytest.approx(number.value, rel=1e-9)
    assert path.read_text() == (finished / "run" / "identified_robot.yml").read_text()
    with refused("study/stage"):
        export(run, "matlab")


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
def study(tmp_path_factory) -> Path:
    """A study of a log of 20 s."""
    folder = tmp_path_factory.mktemp("follow")
    samples = simulate(rich(20), seed=6, offset=0.0, stiction_ratio=1.0).samples
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
    stages = ("measure", "constant_velocity", "friction", "follow", "report")  # friction falls: a misfit
    assert run_command(["run", str(study), *stages, "--png", "--run", str(run), "-q"]) in (0, 3)
    (found,) = read_filter(run / "filter.h5")
    assert 0.6 * VISCOUS < found.filtered.viscous < 1.2 * VISCOUS  # link side, as all of the joint
    end = dict(zip(found.names, found.values[-1].tolist(), strict=True))
    warmth, speed = 1 - np.exp(-1), 30.0
    true = COULOMB * (1 - 0.15 * warmth) + VISCOUS * (1 - 0.5 * warmth) * speed
    assert end["Fc"] + end["f"] * speed == pytest.approx(true, rel=0.02)
    assert list((run / "figures").glob("*filter.png"))
    assert run_command(["export", str(study), "--run", str(run), "--to", "observer", "-q"]) == 0
    assert "joint_1_follow" in (run / "export" / "observer" / "observer.h").read_text()


CARRIAGE = """
name: carriage
robot:
  name: carriage
  gravity: [0, 0, 0]
  bodies: [{name: slide, joints: [{name: 1, motion: translation, axis: x, motor: {inertia: 95, ratio: 1}}]}]
friction: {constant_velocity: detect}
filter: {states: [Fc, f+, f-, offset]}
experiment:
  recorded:
    rate_hz: 1000
    channels:
      - {role: u, at: motor 1, channel: force, quantity: force}
      - {role: y, at: motor 1, channel: position, quantity: position}
    files: [{path: log.csv}]
"""


@pytest.mark.slow
def test_coulomb_friction_without_presliding_is_followed_through_many_reversals(tmp_path: Path) -> None:
    """A reversal every second and a half: Coulomb and viscous friction of both directions stay in their bands."""
    rng, n = np.random.default_rng(0), 90_000
    position = sosfiltfilt(butter(2, 0.3, fs=1000, output="sos"), rng.standard_normal(n))
    position *= 0.1 / position.std()
    velocity = np.gradient(position, 1e-3)
    force = 95.0 * np.gradient(velocity, 1e-3) + 20.6 * np.tanh(velocity / 1e-4) + 203.0 * velocity
    signals = np.stack([force + 0.5 * rng.standard_normal(n), position + 1e-6 * rng.standard_normal(n)], axis=1)
    np.savetxt(tmp_path / "log.csv", signals, "%.9g", ",", header="force,position", comments="")
    (tmp_path / "study.yml").write_text(CARRIAGE)
    assert run_command(["run", str(tmp_path / "study.yml"), "-q", "--jobs", "1", "--run", str(tmp_path / "run")]) == 0
    (track,) = read_filter(tmp_path / "run" / "filter.h5")
    truth = np.array([20.6, 203.0, 203.0, 0.0])
    settled = track.time_s > 20
    inside = (track.low <= truth) & (truth <= track.high)
    assert np.all(inside[settled].mean(axis=0) > 0.9)
