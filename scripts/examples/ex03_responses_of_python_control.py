"""
FRFs from python-control
========================

Fit stiffness to frequency responses from another tool, here python-control.
"""

import control
import numpy as np

import elastid as ei

s, Jm, J, k, d = control.tf("s"), 1.0, 2.0, 3e3, 4.0
system = s**2 * (J * s**2 + d * s + k) / (s**2 * (Jm * J * s**2 + (Jm + J) * (d * s + k)))
data = control.frd(system, 2 * np.pi * np.linspace(1.0, 20.0, 60), inputs=["motor 1"], outputs=["motor 1"])
response = ei.Response.from_control(data, ei.Configuration("home", np.zeros(1)))

joint = ei.Joint("1", "z", ei.Spring(stiffness=2e3, damping=1.0), ei.Motor(inertia=Jm, viscous=0.0))
robot = ei.Robot("two masses", (ei.Body("load", joints=(joint,), inertia=J),), gravity=(0.0, 0.0, 0.0))
result = ei.identify([response], robot, ei.choose(robot, "k_1", "d_1"), starts=3)

if __name__ == "__main__":
    print(result, result.model("home"), sep="\n\n")
    figure = ei.plot.bode(response, result.model("home"))
    figure.savefig("ex03.png")
