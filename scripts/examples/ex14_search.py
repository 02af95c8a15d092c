"""
Search for elastic joints
=========================

The search starts with elastic gears only. It frees a joint if this lowers the error on validation configurations. In
this example, a bearing tilts across the first axis.
"""

import json
import tempfile
from pathlib import Path

from matplotlib.figure import Figure

from elastid.app.cli import run_command

ROBOT = """
name: arm
gravity: [0, 0, 0]
bodies:
  - name: upper
    joints:
      - {name: 1, axis: z, motor: {inertia: 1e-3, ratio: 100}, spring: {stiffness: 4e4, damping: 30}}
      - {name: 1x, axis: x, spring: {stiffness: 6e4, damping: 40}}
    mass: 10
    center_of_mass: [0, 0.3, 0.1]
    inertia: [0.5, 0.1, 0.5]
  - name: fore
    parent: upper
    placement: {xyz: [0, 0.6, 0]}
    joints: [{name: 2, axis: x, motor: {inertia: 1e-3, ratio: 80}}]
    mass: 6
    center_of_mass: [0, 0.3, 0.1]
    inertia: [0.3, 0.1, 0.3]
"""
STUDY = """
name: search
robot: robot.yml
excitation: {rate_hz: 500, period: 2 s, band_hz: [2, 60], torque_rms: 40}
experiment:
  configurations: {a: [0, 0.3], b: [0.3, 1.0], c: [-0.3, -0.8]}
  simulated: {substeps: 4, noise: {torque_std: 0.2, angle_std: 1e-6}}
fit: {starts: 1}
"""
with tempfile.TemporaryDirectory() as name:
    folder = Path(name)
    (folder / "robot.yml").write_text(ROBOT)
    (folder / "study.yml").write_text(STUDY)
    common = [str(folder / "study.yml"), "--run", str(folder / "run"), "--jobs", "1"]
    tasks = (["run", "design", "measure", "estimate", "fit"], ["compare", "--search"])
    codes = [run_command([task, *common, *rest]) for task, *rest in tasks]
    comparison = json.loads((folder / "run" / "compare.json").read_text())

if __name__ == "__main__":
    print(comparison["verdict"], *comparison["models"], sep="\n")
    misfit = {model["name"]: sum(model["misfit"]) / len(model["misfit"]) for model in comparison["models"][::-1]}
    ax = (figure := Figure(figsize=(8, 3), layout="constrained")).subplots()
    ax.barh(list(misfit), list(misfit.values()))
    ax.set(xscale="log", xlabel="mean square error over variance, configurations left out")
    figure.savefig("ex14.png")
