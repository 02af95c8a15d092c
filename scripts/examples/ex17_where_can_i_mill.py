"""
Best posture for milling
========================

Map static compliance and limiting depth of cut over the workspace of a fitted arm. Plot the tool FRF at the softest
posture.
"""

import numpy as np
from exact_responses import measured

import elastid as ei
from elastid.robot import Frame, Placement
from elastid.use.map import Cut, map_workspace

joints = [
    ei.Joint("1", "z", ei.Spring(3e5, 500), ei.Motor(2.4e-3, 121, 1.5e-3)),
    ei.Joint("2", "y", ei.Spring(3.5e5, 600), ei.Motor(2.8e-3, 125, 1.8e-3)),
    ei.Joint("3", "y", ei.Spring(1.8e5, 250), ei.Motor(1.6e-3, 110, 1.2e-3)),
]
turret = ei.Body("turret", joints=(joints[0],), mass=160, center_of_mass=(0.1, 0, 0.15), inertia=9.0)
upper = ei.Body("upper", "turret", Placement((0.2, 0, 0.35)), (joints[1],), 60, (0.05, 0, 0.4), (6.0, 6.2, 0.8))
fore = ei.Body("fore", "upper", Placement((0, 0, 0.85)), (joints[2],), 75, (0.45, 0, 0.1), (1.5, 11.0, 11.0))
robot = ei.Robot("arm", (turret, upper, fore), frames=(Frame("tool", "fore", Placement((1.0, 0, 0.1))),))

truth = {"k_1": 3.5e5, "k_2": 3.0e5, "k_3": 2.1e5}
postures = {"folded": [0.0, -0.3, 0.9], "reach": [0.3, 1.0, -0.9], "low": [-0.8, 1.3, 0.3]}
responses = measured(robot, truth, postures, np.linspace(2.0, 60.0, 60))
result = ei.identify(responses, robot, ei.choose(robot, "k_*", "d_*"), starts=1)

angles = np.random.default_rng(0).uniform([-2.9, -1.0, -1.7], [2.9, 1.7, 1.2], (500, 3))
# Aluminium, a face that looks upwards.
workspace = map_workspace(result, angles, Cut(cutting_coefficient=700e6, normal=(0, 0, 1)))
compliance = 1e6 * workspace["softest_compliance"].value
soft, stiff = compliance.max(), compliance.min()
depth = workspace["depth_of_cut"]
gain = np.percentile(depth.value, 90) / np.percentile(depth.value, 10)
tool = result.at(workspace.angles[workspace.softest[0]], axes="world")

if __name__ == "__main__":
    print(f"softest direction {stiff:.2f} to {soft:.2f} um/N, std {100 * depth.relative_std.max():.2g} % or less")
    print(f"a good posture takes {gain:.1f} times the depth of cut of a bad one")
    print(tool.stiffness(), tool.modes(), sep="\n")
    figure = ei.plot.workspace(workspace, "depth_of_cut")
    figure.savefig("ex17.png")
