"""
A two-mass bench
================

A single elastic joint, from its numbers to its stiffness with an interval, in Python alone.

A motor with a gear of ratio 100 drives a load through an elastic gear. The simulated rig is measured in closed loop,
the response is estimated, and stiffness and damping are fitted from a start that is wrong by a third.
"""

from __future__ import annotations

import elastid as ei

joint = ei.Joint("1", "z", ei.Spring(stiffness=3e4, damping=30.0), ei.Motor(inertia=1e-3, ratio=100.0, viscous=1e-3))
robot = ei.Robot("one elastic joint", (ei.Body("load", joints=(joint,), inertia=8.0),), gravity=(0.0, 0.0, 0.0))
true_stiffness = 4e4

excitation = ei.MultisineSpec(rate_hz=500.0, period=4.0, band_hz=(2.0, 60.0), torque_rms=50.0)
noise = ei.NoiseSpec(torque_std=1.0, encoder_counts=2**20)
truth = ei.SimulatedSpec(truth={"k_1": true_stiffness}, noise=noise)
experiment = ei.ExperimentSpec(configurations={"home": (0.0,)}, simulated=truth)
plan = ei.make_plan(excitation, experiment, robot, seed=1)
rig = ei.SimulatedRig(robot, experiment, plan, seed=1)
response = ei.estimate([rig.measure(e) for e in rig.experiments], ei.EstimatorSpec(), plan.lines)

free = {name: ei.ParameterSpec() for name in ("k_1", "d_1", "fm_1")}
result = ei.identify([response], robot, ei.FitSpec(parameters=free, starts=4, seed=1))
low, high = result.interval("k_1")

if __name__ == "__main__":
    print(plan, response, result, sep="\n\n")
    figure = ei.plot.bode(response, result.model("home"))
    figure.savefig("ex01.png")
