"""
Geometry and priors
===================

Mass and stiffness scale together if only the motors are measured. A prior of 2 % on one mass removes the ambiguity.
The position of the centre of mass is identified together with the springs.
"""

import numpy as np
from exact_responses import measured

import elastid as ei
from elastid.robot import Placement

motor = ei.Motor(inertia=2e-3, ratio=100.0, viscous=1e-3)
joint_1 = ei.Joint("1", "y", ei.Spring(stiffness=9e4, damping=80.0), motor)
joint_2 = ei.Joint("2", "y", ei.Spring(stiffness=4e4, damping=40.0), motor)
upper = ei.Body("upper", joints=(joint_1,), mass=30.0, center_of_mass=(0.4, 0.0, 0.0), inertia=(0.2, 1.5, 1.5))
fore = ei.Body("fore", "upper", Placement(xyz=(0.8, 0.0, 0.0)), (joint_2,), 15.0, (0.3, 0.0, 0.0), (0.1, 0.6, 0.6))
robot = ei.Robot("two links", (upper, fore), gravity=(0.0, 0.0, 0.0))
truth = {"k_1": 8e4, "k_2": 5e4, "m_fore": 15.3, "c_fore_x": 0.33}
data = measured(robot, truth, {"a": (0.0, 0.4), "b": (0.0, 1.6)}, np.linspace(2.0, 40.0, 80))

parameters = ei.choose(robot, "k_1", "k_2", "d_1", "d_2", "c_fore_x", m_fore={"prior": {"std": 0.02}})
result = ei.identify(data, robot, parameters, starts=3, seed=1)

if __name__ == "__main__":
    print(result)
    figure = ei.plot.parameters(result, truth)
    figure.savefig("ex11.png")
