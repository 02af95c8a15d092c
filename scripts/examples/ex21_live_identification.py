"""
Measure until it is known
=========================

A two-axis arm is measured experiment by experiment: each has the posture and the length that bring most towards the
goal in a second of the robot's time, given the logs before it. The rig is simulated, and its logs come in as files.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

import elastid as ei
from elastid.app.console import Console
from elastid.app.live.session import Asked, Session, planned_time_s
from elastid.app.run import Run

STUDY = """\
name: arm
seed: 1
robot:
  name: arm
  bodies:
    - name: upper
      joints: [{name: 1, axis: y, motor: {inertia: 2e-3, ratio: 80, viscous: 1e-3, coulomb: 0.05},
        spring: {stiffness: 4e4, damping: 80}, limits: {angle: [-90 deg, 90 deg], velocity: 3, torque: 1.5 kN*m}}]
      mass: 30
      center_of_mass: [0.4, 0, 0]
      inertia: 1.5
    - name: fore
      parent: upper
      placement: {xyz: [0.8, 0, 0]}
      joints: [{name: 2, axis: y, motor: {inertia: 2e-3, ratio: 80, viscous: 1e-3, coulomb: 0.05},
        spring: {stiffness: 2e4, damping: 40}, limits: {angle: [-90 deg, 90 deg], velocity: 3, torque: 800 N*m}}]
      mass: 20
      center_of_mass: [0.35, 0, 0]
      inertia: 1
excitation: {rate_hz: 200, period: 2 s, band_hz: [2, 40], torque_rms: 20}
experiment:
  configurations: {down: [20 deg, 40 deg], out: [-10 deg, 10 deg], up: [-60 deg, 50 deg], in: [10 deg, 80 deg]}
  simulated:
    truth: {k_1: 3.4e4, k_2: 2.3e4}
    carrier: {amplitude: 0.5 deg, cycles: 1}
    noise: {torque_std: 0.2, encoder_counts: 1048576}
fit: {starts: 1, parameters: {"k_*": {}, "d_*": {}}}
"""
TRUTH = {"k_1": 3.4e4, "k_2": 2.3e4}

folder = Path(tempfile.mkdtemp())
(folder / "study.yml").write_text(STUDY, encoding="utf-8")
run = Run(ei.load_study(folder / "study.yml"), folder / "run", console=Console(-2))
session = Session.of(run, Asked(("k_*: 0.04 %",), simulate=True))
plans, reached, words = session.work()

# What was known after each experiment: half widths of the intervals of the springs, in percent.
fits = [ei.read_fit(session.folder.fit(step)) for step in range(1, len(plans) + 1)]
robot_time_s = np.cumsum([plan.robot_time_s for plan in plans])
half_widths = {
    name: [100 * (high - low) / 2 / fit.values[name] for fit in fits for low, high in [fit.interval(name)]]
    for name in TRUTH
}
inside = {name: low < true < high for name, true in TRUTH.items() for low, high in [fits[-1].interval(name)]}
share = float(robot_time_s[-1] / planned_time_s(run))

if __name__ == "__main__":
    print(words)
    for plan, width in zip(plans, half_widths["k_2"], strict=True):
        print(f"{np.degrees(plan.configurations[0].angles)} deg, {plan.periods} periods: k_2 to {width:.2g} %")
    import matplotlib.pyplot as plt

    figure = plt.figure(figsize=(6.4, 3.6), layout="constrained")
    axis = figure.subplots()
    for name, widths in half_widths.items():
        axis.plot(robot_time_s, widths, "o-", label=name)
    axis.axhline(0.04, color="0.4", linestyle="--", label="goal")
    axis.axvline(planned_time_s(run), color="0.7", label="the study's own plan")
    axis.set(xlabel="robot time in s", ylabel="half width of the 95 % interval in %", yscale="log")
    axis.legend()
    figure.savefig("ex20.png")
