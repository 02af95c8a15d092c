"""A motor and a load on a spring under commands that the drive holds from sample to sample, and the log of a study."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.linalg import expm

from elastid.experiment.specs.channels import ChannelSpec
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.recorded import FileSpec, RecordedSpec
from elastid.frf.estimate import estimate
from elastid.frf.spec import EstimatorSpec
from elastid.linear.linear_model import state_space
from elastid.linear.linearise import Linearisation
from elastid.model.formulation import serial
from elastid.record import Configuration, Hold
from elastid.recorded.rig import RecordedRig
from elastid.response import Response
from elastid.robot import Body, Joint, Motor, Robot, Spring
from plants.lab_logs import save_csv

RATE_HZ, N, PERIODS = 1000.0, 1000, 12
LINES = np.arange(4, 121, 2)


def plant(stiffness: float = 100.0) -> Robot:
    """Resonance at 62 Hz, antiresonance at 36 Hz."""
    joint = Joint("1", "z", Spring(stiffness, 0.02), Motor(1e-3, viscous=2e-3))
    return Robot("plant", (Body("load", joints=(joint,), inertia=2e-3),), gravity=(0.0, 0.0, 0.0))


def commanded(rng: np.random.Generator) -> np.ndarray:
    """One period (N, 1) of a multisine command, Nm."""
    spectrum = np.zeros(N // 2 + 1, complex)
    spectrum[LINES] = 0.05 * N / 2 * np.exp(2j * np.pi * rng.random(len(LINES)))
    return np.fft.irfft(spectrum, n=N)[:, None]


def positions(robot: Robot, u: np.ndarray, acts: Hold) -> np.ndarray:
    """Samples (N, 2) of motor and load in steady state under one period u (N, 1) that repeats: exact.

    A held torque leads to the discrete system of its zero-order hold, images above half the rate folded in.
    """
    model = serial(robot)
    linear = Linearisation.of(model).at(Configuration("c1", [0.0]), model.theta, ("motor 1", "body load z"), "position")
    system = state_space(linear, linear.theta_ref)
    A, B, n = system.A, system.B, len(system.A)
    points = 2j * np.pi * LINES * RATE_HZ / N
    if acts == "zero-order":
        block = expm(np.block([[A, B], [np.zeros((1, n + 1))]]) / RATE_HZ)
        A, B, points = block[:n, :n], block[:n, n:], np.exp(points / RATE_HZ)
    G = system.C @ np.linalg.solve(points[:, None, None] * np.eye(n) - A, np.tile(B, (len(LINES), 1, 1)))
    Y = np.zeros((N // 2 + 1, 2), complex)
    Y[LINES] = G[:, :, 0] * np.fft.rfft(u, axis=0)[LINES]
    return np.fft.irfft(Y, n=N, axis=0)


def measured(folder: Path, seed: int, hold: Hold, acts: Hold = "zero-order", noise: float = 3e-3) -> Response:
    """The response that a study with `hold` gets from a log of noisy encoders, of a torque that acts as `acts`."""
    rng = np.random.default_rng(seed)
    u = commanded(rng)
    y = np.tile(positions(plant(), u, acts), (PERIODS, 1)) + noise * rng.standard_normal((PERIODS * N, 2))
    save_csv(folder / "log.csv", {"u": np.tile(u[:, 0], PERIODS), "motor": y[:, 0], "load": y[:, 1]})
    rig = RecordedRig(plant(), study(hold), folder)
    return estimate([rig.measure(rig.experiments[0])], EstimatorSpec(quantity="acceleration"), LINES)


def study(hold: Hold) -> ExperimentSpec:
    """The log's channels."""
    channels = (
        ChannelSpec("u", "motor 1", "u"),
        ChannelSpec("y", "motor 1", "motor", quantity="position"),
        ChannelSpec("y", "body load z", "load", quantity="position"),
    )
    files = (FileSpec("log.csv", "c1"),)
    recorded = RecordedSpec(RATE_HZ, channels, files, period_samples=N, hold=hold)
    return ExperimentSpec({"c1": (0.0,)}, recorded=recorded)
