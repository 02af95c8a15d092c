"""
Low crest factor
================

Optimised phases lower the crest factor of a multisine: smaller peaks at the same power.
"""

import numpy as np
from matplotlib.figure import Figure

from elastid.excitation.multisine import experiments, synthesise
from elastid.excitation.phases import crest_factors

lines = np.arange(5, 120)
amplitude = np.full((len(lines), 1), np.sqrt(2 / len(lines)))  # 1 Nm rms
direct = np.ones((len(lines), 1, 1), complex)  # the signal whose peaks count is the torque itself
signals = {}
for phases in ("random", "schroeder", "optimised"):
    rng = np.random.default_rng(3)
    signals[phases] = experiments(phases, "dft", lines, amplitude, rng, direct)[0]
crest = {phases: float(crest_factors(lines, U.T)[0]) for phases, U in signals.items()}
gain = crest["random"] / crest["optimised"]  # more torque below the same limit

if __name__ == "__main__":
    print({phases: round(factor, 2) for phases, factor in crest.items()}, f"gain {gain:.2f}")
    figure = Figure(figsize=(8, 5), layout="constrained")
    for ax, (phases, U) in zip(figure.subplots(3, 1, sharex=True, sharey=True), signals.items(), strict=True):
        ax.plot(synthesise(lines, U, 2048)[:, 0])
        ax.set(title=f"{phases}: crest factor {crest[phases]:.2f}", ylabel="torque (Nm)")
    figure.savefig("ex08.png")
