"""
Estimators in closed loop
=========================

H1 treats the torque as noise-free. In closed loop, the torque contains feedback noise, and H1 is biased. The
arithmetic mean and the joint input-output estimator have no such bias for the same records.
"""

import numpy as np
from matplotlib.figure import Figure

import elastid as ei
from elastid.linear.linearise import linearise
from elastid.linear.response.transfer import frequency_response
from elastid.model.formulation import formulate
from elastid.model.spec import ModelSpec

joint = ei.Joint("1", "z", ei.Spring(stiffness=4e4, damping=30.0), ei.Motor(inertia=1e-3, ratio=100.0, viscous=1e-3))
robot = ei.Robot("one elastic joint", (ei.Body("load", joints=(joint,), inertia=8.0),), gravity=(0.0, 0.0, 0.0))
excitation = {"rate_hz": 250, "period": "4 s", "band_hz": [1, 40], "torque_rms": 20}
rig = {"noise": {"angle_std": 1e-4, "torque_std": 0.1}, "controller": {"bandwidth_hz": 6}}
experiment = {"configurations": {"home": [0]}, "simulated": rig, "realisations": 8}
records = ei.simulate(robot, excitation=excitation, experiment=experiment, seed=1)

found = {m: ei.estimate(records, method=m, friction="none")["home"] for m in ("h1", "arithmetic", "joint")}
model = formulate(robot, ModelSpec())
linear = linearise(model, ei.Configuration("home", (0.0,)), model.theta, robot.motor_locations, "acceleration")
theta = np.append(model.theta, 0.0)
off = {m: np.abs(G.G / frequency_response(linear, theta, G.freq_hz) - 1)[:, 0, 0] for m, G in found.items()}
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
