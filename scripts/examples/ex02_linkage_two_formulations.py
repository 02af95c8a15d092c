"""
A linkage, minimal against constrained
======================================

The equations of a parallel linkage, constrained and with its loop eliminated, have the same response.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

import elastid as ei

robot = ei.load_robot(Path(ei.__file__).parents[1] / "configs" / "robots" / "linkage_arm.yml")
posture = ei.Configuration("bent", np.radians([10.0] * len(robot.driven)))
freq_hz = np.geomspace(4.0, 120.0, 50)
responses = []
for formulation in ("constrained", "minimal"):
    model = ei.formulate(robot, ei.ModelSpec(formulation=formulation))
    linear = ei.linearise(model, posture, model.theta, robot.motor_locations, "acceleration")
    responses.append(ei.frequency_response(linear, np.append(model.theta, 0.0), freq_hz))
difference = np.abs(responses[0] - responses[1]).max() / np.abs(responses[0]).max()

if __name__ == "__main__":
    print(f"largest difference, relative to the largest element: {difference:.1e}")
