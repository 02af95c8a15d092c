"""
Wear of a fleet
===============

Stiffness and friction of eight robots on four dates, with standard deviations. Robots of one type differ by 1.5 %. One
robot has a softer gear, and the friction of another robot increases. elastid estimates the spread between robots and
between dates. It lists findings with a false discovery rate of 5 %.
"""

import numpy as np
from matplotlib.figure import Figure

from elastid.validation.fleet import FleetValue, find_changes

rng, days = np.random.default_rng(4), (0.0, 90.0, 180.0, 270.0)
values = []
for robot in range(1, 9):
    own = 3e5 * (0.88 if robot == 3 else 1.0) * np.exp(0.015 * rng.standard_normal())
    for day in days:
        stiffness = own * np.exp(0.004 * rng.standard_normal())
        coulomb = 12.0 * (1 + 2.5e-4 * day * (robot == 6)) * np.exp(0.01 * rng.standard_normal())
        values.append(FleetValue(f"robot {robot}", day, "k_2", float(stiffness), 0.004 * 3e5))
        values.append(FleetValue(f"robot {robot}", day, "Fc_m2", float(coulomb), 0.01 * 12.0))
findings = find_changes(values, false_discovery_rate=0.05)

if __name__ == "__main__":
    print(*(finding.sentence for finding in findings), sep="\n")
    figure = Figure(figsize=(8, 4), layout="constrained")
    for ax, name in zip(figure.subplots(1, 2), ("k_2", "Fc_m2"), strict=True):
        for robot in dict.fromkeys(value.robot for value in values):
            own = [value for value in values if value.robot == robot and value.parameter == name]
            ax.errorbar([v.day for v in own], [v.value for v in own], [1.96 * v.std for v in own], label=robot)
        ax.set(title=name, xlabel="day")
    figure.savefig("ex16.png")
