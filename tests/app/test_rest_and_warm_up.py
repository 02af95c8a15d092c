"""Logs at rest, of slow loops and of warm-ups through a whole study: numbers, page and refusals."""

from pathlib import Path

import numpy as np
import pytest
from plants import lugre_joint, warm_rig
from plants.friction_logs import THERMOMETER_LINE, write_log, write_study
from plants.runs import run_of, summary_of

from elastid.app.run import Run, run_all
from elastid.friction_study.result import FrictionNumber, FrictionResult
from elastid.store.friction_study import read_friction_result

STUDY = """
name: logs
robot: robot.yml
friction: {joints: [1], law: {temperature: no}}
experiment:
  recorded:
    rate_hz: 1000
    hold: zero-order
    channels:
      - {role: u, at: motor 1, channel: torque}
      - {role: y, at: motor 1, channel: angle, quantity: position}
    files:
      - {path: small.csv, purpose: presliding_test, period: 2 s}
      - {path: large.csv, purpose: presliding_test, period: 2 s}
"""


def opened(study: Path) -> Run:
    return run_of(study, study.parent / "run")


def result_of(run: Run) -> FrictionResult:
    run_all(run)
    return read_friction_result(run.folder / "friction.h5")


def numbers(result: FrictionResult) -> dict[str, FrictionNumber]:
    return {number.name: number for number in result.numbers}


@pytest.mark.slow
def test_bristles_from_logs_at_rest_alone(tmp_path: Path) -> None:
    """Two amplitudes, no other log: sigma_0 to 1 % and sigma_1 to 10 %, within their intervals, with page and JSON."""
    rng = np.random.default_rng(3)
    for name, size in (("small", 0.05), ("large", 0.1)):
        lugre_joint.write_rest_log(tmp_path / f"{name}.csv", lugre_joint.multisine(size, rng), rng)
    (tmp_path / "robot.yml").write_text(lugre_joint.ROBOT)
    (tmp_path / "study.yml").write_text(STUDY)
    found = numbers(result_of(opened(tmp_path / "study.yml")))
    for name, truth, error in (("s0_m1", lugre_joint.SIGMA_0, 0.01), ("s1_m1", lugre_joint.SIGMA_1, 0.1)):
        assert found[name].std < error * truth
        # Without a log that slides viscous friction is not known, and is in the damping.
        truth += lugre_joint.VISCOUS if name == "s1_m1" else 0.0
        assert abs(found[name].value - truth) < 3.3 * found[name].std
    assert summary_of(tmp_path / "run")["status"] == "partly"
    assert (tmp_path / "run" / "report.html").exists()


def warm(folder: Path, log: warm_rig.WarmLog, *files: str) -> Run:
    """The study of a warm-up; without files its log alone."""
    write_log(folder / "log.csv", log.position, log.torque, log.thermometer)
    entries = files or ("{path: log.csv, purpose: warm_up}",)
    return opened(write_study(folder, entries, log.rate_hz, temperature="no", thermometer=THERMOMETER_LINE))


@pytest.mark.slow
def test_warm_up_study_gives_temperature_coulomb_torque_and_page(tmp_path: Path) -> None:
    """An hour in steps of 10 s: heat given off to 5 %, two nodes as the thermometer is outside."""
    joint = result_of(warm(tmp_path, warm_rig.warm_log(1.0))).at("1")
    assert joint.thermal.h == pytest.approx(warm_rig.OUTER, rel=0.05)
    assert joint.thermal.fractions[1] < 0
    assert joint.constant_velocity is not None
    assert {"Tc1_m1", "Tc2_m1", "h_m1"} <= {number.name for number in joint.numbers}
    assert (tmp_path / "run" / "report.html").is_file()
