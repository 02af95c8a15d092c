"""
Replay of a measured torque
===========================

The measured torque, replayed on the fitted model, gives the measured motion but for the noise; an error of the model
would show here. The same model with half the stiffness does not.
"""

from __future__ import annotations

import ex01_identify_from_python as bench
import numpy as np
from matplotlib.figure import Figure

from elastid.fit.fitted_robot import FittedRobot
from elastid.frf.spec import EstimatorSpec
from elastid.validation.elastic_twin import describe_replays, replay

fitted = FittedRobot.of(bench.result, bench.robot, [bench.response])
model, theta = fitted.at("home"), fitted.theta_of("home")
band, spec = bench.excitation["band_hz"], EstimatorSpec()
twin = replay(bench.records, model, theta, band, spec)
soft = theta.copy()
soft[model.parameters.index("k_1")] /= 2
poor = replay(bench.records, model, soft, band, spec)
explained, of_the_soft = float(twin.fit_percent.min()), float(poor.fit_percent.min())

if __name__ == "__main__":
    print(describe_replays([twin]), f"With half the stiffness: {of_the_soft:.0f} %.", sep="\n")
    figure = Figure(figsize=(8, 4), layout="constrained")
    ax, t = figure.subplots(), np.arange(len(twin.measured)) / twin.rate_hz
    ax.plot(t, twin.measured[:, 0], lw=4, alpha=0.4, label="measured")
    ax.plot(t, twin.replayed[:, 0], "k", lw=1, label="model")
    ax.plot(t, poor.replayed[:, 0], lw=1, label="half the stiffness")
    ax.set(xlim=(0.0, 0.5), xlabel="time (s)", ylabel=f"{twin.quantity} of {twin.outputs[0]} ({twin.units[0]})")
    ax.legend()
    figure.savefig("ex15.png")
