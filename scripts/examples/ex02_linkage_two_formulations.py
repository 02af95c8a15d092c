"""
Parallel linkage in two formulations
====================================

The constrained and the minimal equations of a parallel linkage have the same frequency response, except for rounding.
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import elastid as ei
from elastid.linear.linearise import linearise
from elastid.linear.response.transfer import frequency_response
from elastid.model.formulation import formulate
from elastid.model.spec import ModelSpec
from elastid.study import load_robot

robot = load_robot(Path(ei.__file__).parents[1] / "configs" / "robots" / "linkage_arm.yml")
posture = ei.Configuration("bent", np.radians([10.0] * len(robot.driven)))
freq_hz = np.geomspace(4.0, 120.0, 400)
responses = []
for formulation in ("constrained", "minimal"):
    model = formulate(robot, ModelSpec(formulation=formulation))
    linear = linearise(model, posture, model.theta, robot.motor_locations, "acceleration")
    responses.append(frequency_response(linear, np.append(model.theta, 0.0), freq_hz))
difference = np.abs(responses[0] - responses[1]).max() / np.abs(responses[0]).max()

if __name__ == "__main__":
    print(f"largest difference, relative to the largest element: {difference:.1e}")
    figure = Figure(figsize=(8, 4), layout="constrained")
    for i, ax in enumerate(figure.subplots(1, len(robot.driven), sharey=True)):
        for G, style in zip(responses, ({"lw": 4, "alpha": 0.4}, {"lw": 1, "color": "k"}), strict=True):
            ax.loglog(freq_hz, np.abs(G[:, i, i]), **style)
        ax.set(title=robot.motor_locations[i], xlabel="frequency (Hz)")
    figure.axes[0].set(ylabel="acceleration per torque (rad/s² per Nm)")
    figure.axes[-1].legend(("constrained", "minimal"))
    figure.savefig("ex02.png")
