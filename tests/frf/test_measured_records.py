"""Frequency responses of real records: a two-inertia bench with bad periods, and a half-wave record without a rate."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from plants.measured import BENCH, DATA, measured

from elastid.experiment.specs.channels import ChannelSpec
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.recorded import FileSpec, RecordedSpec
from elastid.frf.estimate import estimate
from elastid.frf.period_selection import trusted
from elastid.frf.spec import EstimatorSpec
from elastid.frf.spectra import RecordSpectra, period_spectra
from elastid.record import Record
from elastid.recorded.rig import RecordedRig
from elastid.response import Response
from elastid.robot import Body, Joint, Motor, Robot, Spring

ROBOT = Robot("bench", (Body("load", joints=(Joint("1", spring=Spring(50.0), motor=Motor(1e-3)),), inertia=1e-3),))
SPEC = EstimatorSpec()
PERIOD = 2500


def _measure(recorded: RecordedSpec) -> Record:
    for file in recorded.files:
        measured(file.path)
    rig = RecordedRig(ROBOT, ExperimentSpec({"c": (0.0,)}, recorded=recorded), DATA)
    return rig.measure(rig.experiments[0])


@pytest.fixture(scope="module")
def bench() -> Record:
    """Current to motor and load angle, 20 periods of 1 s; the load's encoder is mounted mirrored."""
    current = ChannelSpec("u", "motor 1", "iq_adx", quantity="current", torque_constant=0.172668006987608)
    motor = ChannelSpec("y", "motor 1", "theta_mx", quantity="position")
    load = ChannelSpec("y", "joint 1", "theta_my", quantity="position", sign=-1)
    file = FileSpec(BENCH, "c")
    return _measure(RecordedSpec(2500.0, (current, motor, load), (file,), period=1.0))


@pytest.fixture(scope="module")
def arm() -> Record:
    """Reaction torque to acceleration of a flexible arm, one period of 1024 samples of unknown rate."""
    torque = ChannelSpec("u", "motor 1", "robot_arm_dat", 1)
    acceleration = ChannelSpec("y", "motor 1", "robot_arm_dat", 2, "acceleration")
    file = FileSpec("daisy_robot_arm/robot_arm_dat.mat", "c")
    return _measure(RecordedSpec("unknown", (torque, acceleration), (file,), period_samples=1024, half_wave=True))


def _relative_std(response: Response) -> np.ndarray:
    assert response.noise is not None
    return np.asarray(np.median(np.sqrt(response.noise.variance) / np.abs(response.G), axis=0)[:, 0])


def test_bench_transient_and_both_bad_periods_are_found_and_no_other(bench: Record) -> None:
    """The first period, and the 7th and 14th of those after it."""
    response = estimate([bench], SPEC)
    kept = trusted(period_spectra(RecordSpectra(bench), np.arange(11, 251), "acceleration"), SPEC).periods
    assert sorted(set(range(20)) - set(kept.tolist())) == [0, 7, 14]
    codes = {note.code: note.severity for note in response.notes}
    assert (codes["frf/transient-left-out"], codes["frf/periods-left-out"]) == ("information", "warning")


def test_bench_lines_antiresonance_and_resonance_are_those_known(bench: Record) -> None:
    """Lines 11 to 250 Hz, antiresonance near 54 Hz and resonance near 76 Hz at the motor, no zero at the load."""
    response = estimate([bench], SPEC)
    np.testing.assert_allclose(response.freq_hz, np.arange(11, 251))
    motor, load = np.abs(response.G[:, :, 0]).T
    below = response.freq_hz < 100
    assert response.freq_hz[below][np.argmin(motor[below])] == pytest.approx(54, abs=1)
    assert response.freq_hz[np.argmax(motor)] == pytest.approx(76, abs=1)
    assert response.freq_hz[np.argmax(load)] == pytest.approx(76, abs=1)
    below = response.freq_hz < 70
    assert motor[below].min() < 0.2 * motor[0]
    assert load[below].min() > 0.8 * load[0]


def test_bench_halves_agree_within_what_their_variances_say(bench: Record) -> None:
    """Periods 2 to 11 against 12 to 20: the squared difference is that of two independent estimates."""
    halves = [replace(bench, u=bench.u[a:b], y=bench.y[a:b]) for a, b in ((PERIOD, 11 * PERIOD), (11 * PERIOD, None))]
    a, b = (estimate([half], SPEC) for half in halves)
    assert a.noise is not None
    assert b.noise is not None
    ratio = np.abs(a.G - b.G) ** 2 / (a.noise.variance + b.noise.variance)
    assert np.all(np.abs(np.median(ratio, axis=0) / np.log(2) - 1) < 0.5)
    assert np.all(ratio.mean(axis=0) < 1.6)


def test_arm_has_odd_lines_with_a_noise_level_and_its_known_extremes(arm: Record) -> None:
    """All odd lines up to 0.2 of the rate; antiresonances .0322 and .1798, resonances .0583 and .1269, to a line."""
    response = estimate([arm], SPEC)
    np.testing.assert_allclose(response.freq_hz * 1024, np.arange(1, 204, 2))
    assert not response.rate_is_known
    assert np.all(_relative_std(response) < 0.03)
    level, spacing = np.abs(response.G[:, 0, 0]), 2 / 1024
    for low, high, find, expected in (
        (0.02, 0.045, np.argmin, 0.0322),
        (0.045, 0.08, np.argmax, 0.0583),
        (0.10, 0.15, np.argmax, 0.1269),
        (0.15, 0.19, np.argmin, 0.1798),
    ):
        near = (response.freq_hz > low) & (response.freq_hz < high)
        assert response.freq_hz[near][find(level[near])] == pytest.approx(expected, abs=spacing)
