"""
Weights for the wrist
=====================

A wrist that the motors barely move is known to 13 to 18 %; twelve readings of a dial gauge make that 1 to 2 %.
"""

from __future__ import annotations

import matplotlib.pyplot as plt
import numpy as np
from exact_responses import measured

import elastid as ei

joints = [
    ei.Joint("1", "z", ei.Spring(3e5, 500), ei.Motor(2.4e-3, 121, 1.5e-3)),
    ei.Joint("2", "y", ei.Spring(3.5e5, 600), ei.Motor(2.8e-3, 125, 1.8e-3)),
    ei.Joint("3", "y", ei.Spring(1.8e5, 250), ei.Motor(1.6e-3, 110, 1.2e-3)),
    ei.Joint("4", "x", ei.Spring(6e4, 60), ei.Motor(6e-4, 100, 6e-4)),
    ei.Joint("5", "y", ei.Spring(5e4, 50), ei.Motor(5e-4, 100, 5e-4)),
]
turret = ei.Body("turret", joints=(joints[0],), mass=160, center_of_mass=(0.1, 0, 0.15), inertia=9.0)
upper = ei.Body("upper", "turret", ei.Placement((0.2, 0, 0.35)), (joints[1],), 60, (0.05, 0, 0.4), (6.0, 6.2, 0.8))
fore = ei.Body("fore", "upper", ei.Placement((0, 0, 0.85)), (joints[2],), 60, (0.3, 0, 0.1), (1.5, 8.0, 8.0))
roll = ei.Body("roll", "fore", ei.Placement((0.8, 0, 0.1)), (joints[3],), 10, (0.05, 0, 0), (0.06, 0.1, 0.1))
hand = ei.Body("hand", "roll", ei.Placement((0.15, 0, 0)), (joints[4],), 8, (0.08, 0, 0.02), (0.05, 0.06, 0.06))
hook = ei.Frame("hook", "hand", ei.Placement((0.3, 0.4, 0.1)))  # at the end of a lever
robot = ei.Robot("arm with a wrist", (turret, upper, fore, roll, hand), frames=(hook,), tolerances="exact")

truth = {"k_1": 3.3e5, "k_2": 3.2e5, "k_3": 2.0e5, "k_4": 5.4e4, "k_5": 5.6e4}
postures = {
    "folded": [0.0, -0.3, 0.9, 0.3, -0.7],
    "reach": [0.3, 1.0, -0.9, -1.0, 0.5],
    "low": [-0.8, 1.3, 0.3, 0.8, 1.1],
}
# Configuration, force on the hook in N, direction of the dial gauge, what it read in m: axes of the base.
readings = [
    ("folded", (0, 0, -100), "z", -0.001243),
    ("folded", (0, 0, -200), "z", -0.002484),
    ("folded", (0, 100, 0), "y", 0.000656),
    ("folded", (100, 0, 0), "x", 0.000247),
    ("reach", (0, 0, -100), "z", -0.002026),
    ("reach", (0, 0, -200), "z", -0.004061),
    ("reach", (0, 100, 0), "y", 0.001579),
    ("reach", (100, 0, 0), "x", 0.000276),
    ("low", (0, 0, -100), "z", -0.000428),
    ("low", (0, 0, -200), "z", -0.000855),
    ("low", (0, 100, 0), "y", 0.001306),
    ("low", (100, 0, 0), "x", 0.00065),
]

# Noise of the size of a hundredth of the largest element: the small ones, of the wrist, drown in it.
rng, responses = np.random.default_rng(1), []
for exact in measured(robot, truth, postures, np.linspace(2.0, 60.0, 40), noise=0.0):
    std = 0.01 * np.broadcast_to(np.abs(exact.G).max(axis=(1, 2), keepdims=True), exact.G.shape)
    G = exact.G + std * (rng.standard_normal(std.shape) + 1j * rng.standard_normal(std.shape)) / np.sqrt(2)
    known = ei.Covariance(std**2, np.inf)
    responses.append(
        ei.FrequencyResponse(exact.freq_hz, G, exact.inputs, exact.outputs, exact.quantity, exact.configuration, known)
    )
tests = [
    ei.LoadTest(name, frame="hook", force=force, along=axis, deflection=read, std=5e-6)
    for name, force, axis, read in readings
]
placed = ei.placed_tests(tests, {response.configuration.name: response.configuration for response in responses})
spec = ei.FitSpec(
    parameters={"k_*": ei.ParameterSpec(), "d_*": ei.ParameterSpec(prior=ei.PriorSpec(0.2))}, starts=1,
    weights=ei.WeightSpec(floor=0.0),
)  # fmt: skip
alone = ei.identify(responses, robot, spec)
both = ei.identify(responses, robot, spec, loads=placed)
springs = [f"k_{i}" for i in range(1, 6)]
relative = {name: (alone.std[name] / alone.values[name], both.std[name] / both.values[name]) for name in springs}

if __name__ == "__main__":
    for name, (without, with_loads) in relative.items():
        print(f"{name}: +-{100 * without:.2g} % by the motors alone, +-{100 * with_loads:.2g} % with the weights")
    print(both.static.words)
    figure, axes = plt.subplots(figsize=(6, 3), layout="constrained")
    for place, (label, color) in enumerate((("motors alone", "0.7"), ("with 12 load tests", "tab:blue"))):
        heights = [100 * pair[place] for pair in relative.values()]
        axes.bar(np.arange(5) + 0.4 * place, heights, 0.4, color=color, label=label)
    axes.set_xticks(np.arange(5) + 0.2, springs)
    axes.set(yscale="log", ylabel="standard deviation in %")
    axes.legend()
    figure.savefig("ex20.png")
