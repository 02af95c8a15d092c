"""A real record of 1.99 periods that are no whole number of samples, from its study to a response."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from plants.measured import EMPS, EMPS_PULSES, measured
from scipy.io import loadmat

from elastid.app import cli
from elastid.friction_study.motion import regress_motion
from elastid.friction_study.motion_signals import Motion
from elastid.store.measured import read_records, read_responses

ROBOT = """
name: prismatic axis
gravity: [0, 0, 0]
bodies:
  - name: carriage
    joints:
      - name: 1
        motion: translation
        axis: x
        motor: {inertia: 1e-3, ratio: 200, viscous: 1e-3}
        spring: {stiffness: 5 MN/m, damping: 1 kN*s/m}
    mass: 45 kg
"""
STUDY = """
name: emps
robot: robot.yml
experiment:
  configurations: {{axis: [0]}}
  recorded:
    rate_hz: 1000
    {period}
    channels:
      - {{role: u, at: motor 1, channel: vir, scale: 35.1507, unit: N}}
      - {{role: y, at: motor 1, channel: qm, quantity: position, unit: m}}
    files:
      - {{path: {record}, configuration: axis}}
estimator: {{method: {method}, band_hz: [0, 20]}}
fit: {{parameters: {{Jm_1: {{}}}}}}
"""


def _study(folder: Path, period: str, method: str) -> Path:
    (folder / "robot.yml").write_text(ROBOT)
    (folder / "study.yml").write_text(STUDY.format(period=period, record=measured(EMPS), method=method))
    return folder / "study.yml"


@pytest.mark.parametrize(
    ("period", "method", "N"),
    [
        ("period_samples: 12480.02", "h1", 12480),
        ("period: 12.48002 s", "arithmetic", 12480),
        ("period: find", "arithmetic", 6240),
    ],
)
def test_the_mass_of_the_axis_is_in_its_response(period: str, method: str, N: int, tmp_path: Path) -> None:
    """Force over acceleration above 2 Hz is the published 95.11 kg within 5 %."""
    study = _study(tmp_path, period, method)
    for stage in ("measure", "estimate"):
        assert cli.run_command([stage, str(study), "--run", str(tmp_path / "run"), "-q"]) == 0
    (record,) = read_records(tmp_path / "run" / "records.h5")
    assert (record.period_samples, record.is_periodic) == (N, True)
    (response,) = read_responses(tmp_path / "run" / "frf.h5")
    high = response.freq_hz > 2.0
    assert high.sum() > 30
    assert np.median(1 / response.G[high, 0, 0].real) == pytest.approx(95.11, rel=0.05)


def test_the_same_record_as_one_transient_needs_a_method_without_periods(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A mean over realisations compares periods: refused by `check`, and the proposed method works."""
    study = _study(tmp_path, "period: none", "arithmetic")
    assert cli.run_command(["check", str(study)]) != 0
    said = " ".join(capsys.readouterr().err.split())
    assert "arithmetic compares periods" in said
    assert "or take a method that needs none: auto, local_polynomial" in said
    study = _study(tmp_path, "period: none", "h1")
    for stage in ("measure", "estimate"):
        assert cli.run_command([stage, str(study), "--run", str(tmp_path / "run"), "-q"]) == 0
    (record,) = read_records(tmp_path / "run" / "records.h5")
    assert (record.n_samples, record.is_periodic) == (24841, False)
    (response,) = read_responses(tmp_path / "run" / "frf.h5")
    assert response.noise is not None or response.total is not None


def test_two_records_of_the_axis_agree_within_their_intervals() -> None:
    """Motion alone, and with pulses of force: 95 % intervals of the difference of each number."""
    logs = [loadmat(measured(name)) for name in (EMPS, EMPS_PULSES)]
    motions = [Motion("joint 1", 1e3, log["qm"].ravel(), 35.1507 * log["vir"].ravel(), slides=True) for log in logs]
    first, second = (regress_motion(motion).chosen for motion in motions)
    assert first.names == second.names
    for name in first.names:
        assert abs(first[name] - second[name]) < 1.96 * np.hypot(first.std(name), second.std(name)), name
