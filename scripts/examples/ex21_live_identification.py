"""
Measure until the goal is reached
=================================

Measure a two-axis arm experiment by experiment. Each posture and length contributes most to the goal per second of
robot time. A simulation replaces the robot and writes its logs as files.
"""

import tempfile
from pathlib import Path

import numpy as np
from two_axis_study import STUDY, TRUTH

import elastid as ei
from elastid.app.console import Console
from elastid.app.live import Session, planned_time_s
from elastid.app.run import Run
from elastid.study import load_study

folder = Path(tempfile.mkdtemp())
(folder / "study.yml").write_text(STUDY, encoding="utf-8")
run = Run(load_study(folder / "study.yml"), folder / "run", console=Console(-2))
session = Session.of(run, ("k_*: 0.05 %",), simulate=True)
plans, reached, words = session.work()

# What was known after each experiment: half widths of the intervals of the springs, in percent.
fits = [ei.load(session.plan(step).with_suffix("") / "fit.h5") for step in range(1, len(plans) + 1)]
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
    axis.axhline(0.05, color="0.4", linestyle="--", label="goal")
    axis.axvline(planned_time_s(run), color="0.7", label="the study's own plan")
    axis.set(xlabel="robot time in s", ylabel="half width of the 95 % interval in %", yscale="log")
    axis.legend()
    figure.savefig("ex21.png")
