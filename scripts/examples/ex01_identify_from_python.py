"""
Two-mass bench
==============

Identify the stiffness of one elastic joint in Python, with a 95 % interval.

A motor drives a load through an elastic gear of ratio 100. The example simulates the closed-loop measurement,
estimates the FRF, and fits stiffness and damping. The start value of the stiffness is wrong by a third.
"""

import elastid as ei

joint = ei.Joint("1", "z", ei.Spring(stiffness=3e4, damping=30.0), ei.Motor(inertia=1e-3, ratio=100.0, viscous=1e-3))
robot = ei.Robot("one elastic joint", (ei.Body("load", joints=(joint,), inertia=8.0),), gravity=(0.0, 0.0, 0.0))
true_stiffness = 4e4

excitation = {"rate_hz": 500, "period": "4 s", "band_hz": [2, 60], "torque_rms": 50}
rig = {"truth": {"k_1": true_stiffness}, "noise": {"torque_std": 1, "encoder_counts": 2**20}}
experiment = {"configurations": {"home": [0]}, "simulated": rig}
records = ei.simulate(robot, excitation=excitation, experiment=experiment, seed=1)
(response,) = ei.estimate(records, friction="none")

result = ei.identify([response], robot, ei.choose(robot, "k_1", "d_1", "fm_1"), starts=4, seed=1)
low, high = result.interval("k_1")

if __name__ == "__main__":
    print(response, result, sep="\n\n")
    figure = ei.plot.bode(response, result.model("home"))
    figure.savefig("ex01.png")
