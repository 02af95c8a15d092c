"""
A response measured in closed loop
==================================

H1 takes the torque for exact; in closed loop it holds the noise that is fed back, and H1 is biased where that is large.
The mean of realisations and the joint input-output estimate are not, from the same records.
"""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

import elastid as ei

joint = ei.Joint("1", "z", ei.Spring(stiffness=4e4, damping=30.0), ei.Motor(inertia=1e-3, ratio=100.0, viscous=1e-3))
robot = ei.Robot("one elastic joint", (ei.Body("load", joints=(joint,), inertia=8.0),), gravity=(0.0, 0.0, 0.0))
excitation = ei.MultisineSpec(rate_hz=250.0, period=4.0, band_hz=(1.0, 40.0), torque_rms=20.0)
noise = ei.NoiseSpec(angle_std=1e-4, torque_std=0.1)
rig_spec = ei.SimulatedSpec(noise=noise, controller=ei.ControllerSpec(bandwidth_hz=6.0))
experiment = ei.ExperimentSpec(configurations={"home": (0.0,)}, simulated=rig_spec, realisations=8)
plan = ei.make_plan(excitation, experiment, robot, seed=1)
rig = ei.SimulatedRig(robot, experiment, plan, seed=1)
records = [rig.measure(each) for each in rig.experiments]

specs = {m: ei.EstimatorSpec(method=m, friction="none") for m in ("h1", "arithmetic", "joint")}
found = {m: ei.estimate(records, spec, plan.lines) for m, spec in specs.items()}
model = ei.formulate(robot, ei.ModelSpec())
linear = ei.linearise(model, ei.Configuration("home", (0.0,)), model.theta, robot.motor_locations, "acceleration")
theta = np.append(model.theta, 0.0)
off = {m: np.abs(G.G / ei.frequency_response(linear, theta, G.freq_hz) - 1)[:, 0, 0] for m, G in found.items()}
error = {method: float(np.median(each)) for method, each in off.items()}

if __name__ == "__main__":
    print({method: f"{100 * e:.2f} %" for method, e in error.items()})
    figure = Figure(figsize=(8, 4), layout="constrained")
    ax = figure.subplots()
    for method, response in found.items():
        ax.semilogy(response.freq_hz, off[method], ".-", label=method)
    ax.set(xlabel="frequency (Hz)", ylabel="relative error")
    ax.legend()
    figure.savefig("ex09.png")
