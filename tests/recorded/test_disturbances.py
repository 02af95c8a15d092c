"""A known disturbance at a motor is added to its torque, in responses and in friction, and need not repeat."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from plants.friction_logs import COULOMB, RATE, ROBOT, VISCOUS, logs, sliding_torque, trapezoids
from plants.notes import said
from scipy.signal import lfilter

from elastid.base.errors import StudyError
from elastid.experiment.specs.channels import ChannelSpec, Structure
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.recorded import FileSpec, RecordedSpec
from elastid.frf.estimate import estimate
from elastid.frf.spec import EstimatorSpec
from elastid.friction_study.joint_levels import find_joint_levels
from elastid.recorded.friction_logs import read_friction_logs
from elastid.recorded.rig import RecordedRig
from elastid.study import load

N, P = 250, 8
SHAKER = (
    ChannelSpec("u", "shaker", "u", quantity="force", unit="N"),
    ChannelSpec("y", "tip", "y", quantity="acceleration", unit="m/s^2"),
)
PULSES = ChannelSpec("d", "shaker", "d", quantity="force", unit="N", sign=-1)
SPEC = EstimatorSpec(method="arithmetic", quantity="acceleration", lines="excited")


def shaken(folder: Path, channels: tuple[ChannelSpec, ...]) -> np.ndarray:
    """|G| relative std (F,) of a structure that is shaken periodically, and struck by pulses that do not repeat."""
    rng = np.random.default_rng(5)
    lines = np.arange(4, 80, 5)
    angle = rng.uniform(0, 2 * np.pi, len(lines))
    u = np.tile(np.cos(2 * np.pi * np.outer(np.arange(N), lines) / N + angle).sum(axis=1), P)
    d = np.zeros(P * N)
    for start, width in zip(rng.integers(0, P * N, 12), rng.integers(1, 6, 12), strict=True):
        d[start : start + width] = 5.0
    y = lfilter([0, 1, 0.5], [1, -0.9, 0.5], np.tile(u[:N], P + 1) + np.append(np.zeros(N), d))[N:]
    y += 0.01 * rng.standard_normal(len(y))
    rows = "\n".join(f"{a:.12g},{-b:.12g},{c:.12g}" for a, b, c in zip(u, d, y, strict=True))
    (folder / "log.csv").write_text(f"u,d,y\n{rows}\n")
    recorded = RecordedSpec(100.0, channels, (FileSpec("log.csv", "bench"),), period_samples=N)
    rig = RecordedRig(Structure.from_channels(channels), ExperimentSpec({"bench": ()}, recorded=recorded), folder)
    record = rig.measure(rig.experiments[0])
    if PULSES in channels:
        np.testing.assert_allclose(record.u[:, 0], u + d, atol=1e-9)
        assert said(record.notes) == ()
    noise = estimate([record], SPEC).noise
    assert noise is not None
    return np.sqrt(noise.variance[:, 0, 0])


def test_pulses_that_are_known_are_no_noise_of_a_response(tmp_path: Path) -> None:
    """Pulses of one to five samples, none taken for a spike: the std of G is that of the sensor, a tenth and less."""
    known, unknown = shaken(tmp_path, (*SHAKER, PULSES)), shaken(tmp_path, SHAKER)
    assert np.median(unknown / known) > 10
    # Noise of 0.01 in P N samples, lines of amplitude 1.
    assert np.median(known) == pytest.approx(0.01 * np.sqrt(4 / (P * N)), rel=0.5)


def pushed(folder: Path, with_pulses: bool) -> tuple[float, float, float]:
    """Coulomb and viscous friction, and the share of the torque that is left, of an axis pushed by known pulses."""
    q = trapezoids([0.2, 0.5, 0.35])
    d = np.zeros(len(q))
    for start in range(300, len(q) - 300, 700):
        d[start : start + 150] = 40.0
    u = sliding_torque(q) - d
    rows = "\n".join(f"{a:.9g},{b:.9g},{c:.9g}" for a, b, c in zip(u, q, d, strict=True))
    (folder / "log.csv").write_text(f"u,q,d\n{rows}\n")
    channels = (ChannelSpec("u", "motor 1", "u"), ChannelSpec("y", "motor 1", "q", quantity="position"))
    known = (ChannelSpec("d", "motor 1", "d"),) if with_pulses else ()
    measured = read_friction_logs(ROBOT, logs(FileSpec("log.csv"), channels=(*channels, *known)), folder, ["1"], {})
    (record,) = measured.records
    if with_pulses:
        np.testing.assert_allclose(record.torque, u + d, atol=1e-6)
        np.testing.assert_allclose(record.disturbance, d)
    else:
        assert record.disturbance is None
    motion = find_joint_levels(ROBOT, ROBOT.driven, measured)[0].motion
    assert motion is not None
    return motion.chosen["coulomb"], motion.chosen["viscous"], motion.chosen.relative_error


def test_pulses_that_are_known_are_no_friction(tmp_path: Path) -> None:
    """As those of a prismatic axis on which a second actuator pushes."""
    coulomb, viscous, left = pushed(tmp_path, with_pulses=True)
    assert coulomb == pytest.approx(COULOMB, rel=0.05)
    assert viscous == pytest.approx(VISCOUS, rel=0.1)
    assert left < 0.03
    assert pushed(tmp_path, with_pulses=False)[2] > 10 * left


def test_a_reference_without_a_controller_is_a_note(tmp_path: Path) -> None:
    q = trapezoids([0.2, 0.5])
    rows = "\n".join(f"{a:.9g},{b:.9g}" for a, b in zip(sliding_torque(q), q, strict=True))
    (tmp_path / "log.csv").write_text(f"u,q\n{rows}\n")
    places = [("u", "u", "torque"), ("y", "q", "position"), ("reference", "q", "position")]
    channels = tuple(ChannelSpec(role, "motor 1", name, quantity=what) for role, name, what in places)  # type: ignore[arg-type]
    (record,) = read_friction_logs(ROBOT, logs(FileSpec("log.csv"), channels=channels), tmp_path, ["1"], {}).records
    assert [(note.code, note.severity) for note in record.notes] == [("records/unused-reference", "information")]
    assert record.rate_hz == RATE


@pytest.mark.parametrize("at", ["joint 1", "body arm z"])
def test_a_disturbance_behind_the_motor_is_refused(at: str, tmp_path: Path) -> None:
    robot = "bodies: [{name: arm, joints: [{name: 1, axis: z, motor: {inertia: 1e-3, ratio: 50}}], inertia: 1}]"
    (tmp_path / "robot.yml").write_text(f"name: one\n{robot}\n")
    np.savetxt(tmp_path / "log.csv", np.random.default_rng(0).standard_normal((300, 3)), header="u,q,d", comments="")
    (tmp_path / "study.yml").write_text(
        "name: pushed\nrobot: robot.yml\nfriction: {passes: detect}\nexperiment:\n  recorded:\n    rate_hz: 100\n"
        "    channels:\n      - {role: u, at: motor 1, channel: u}\n"
        "      - {role: y, at: motor 1, channel: q, quantity: position}\n"
        f"      - {{role: d, at: {at}, channel: d}}\n    files:\n      - {{path: log.csv}}\n"
    )
    with pytest.raises(StudyError) as refused:
        load(tmp_path / "study.yml")
    assert "study.yml:10:" in str(refused.value)
