"""
Simulation of a log
===================

The measured torque drives the simulated fitted robot. The simulated motion equals the measured motion except for
noise. A robot with half the stiffness does not reproduce the log.
"""

import ex01_identify_from_python as bench
import numpy as np
from matplotlib.figure import Figure

from elastid.fit.fitted_robot import estimated_robot
from elastid.validation.log_comparison import MOTION
from elastid.validation.simulation import simulate_record

robot, (low_hz, high_hz) = estimated_robot(bench.result), bench.excitation["band_hz"]
soft = robot.with_parameters({"k_1": bench.result["k_1"].value / 2})
runs = [run for each in (robot, soft) for run in simulate_record(bench.records[0], each, (low_hz, high_hz))]
signal, poor = (run.of(MOTION)[0] for run in runs)

if __name__ == "__main__":
    print(*(run.sentence for run in runs), sep="\n")
    figure = Figure(figsize=(8, 4), layout="constrained")
    ax, t = figure.subplots(), np.arange(len(signal.measured)) / runs[0].rate_hz
    ax.plot(t, signal.measured, lw=4, alpha=0.4, label="measured")
    ax.plot(t, signal.simulated, "k", lw=1, label="model")
    ax.plot(t, poor.simulated, lw=1, label="half the stiffness")
    ax.set(xlim=(0.0, 0.5), xlabel="time (s)", ylabel=f"{signal.kind} of {signal.place} ({signal.unit})")
    ax.legend()
    figure.savefig("ex15.png")
