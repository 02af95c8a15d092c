"""
A twin beside the robot
=======================

The measured torque, replayed on the fitted model, gives the measured motion: what the twin does not explain is what
noise leaves, or an error of the model that would show here. The same model with half the stiffness does not.
"""

from __future__ import annotations

import ex01_identify_from_python as bench

import elastid as ei
from elastid.fit.fitted_robot import FittedRobot
from elastid.validation.replay import describe_replays, replay

records = [bench.rig.measure(each) for each in bench.rig.experiments]
fitted = FittedRobot.of(bench.result, bench.robot, [bench.response])
model, theta = fitted.at("home"), fitted.theta_of("home")
band, spec = bench.excitation.band_hz, ei.EstimatorSpec()
twin = replay(records, model, theta, band, spec)
soft = theta.copy()
soft[model.parameters.index("k_1")] /= 2
poor = replay(records, model, soft, band, spec)
explained, of_the_soft = float(twin.fit_percent.min()), float(poor.fit_percent.min())

if __name__ == "__main__":
    print(describe_replays([twin]), f"With half the stiffness: {of_the_soft:.0f} %.", sep="\n")
