"""
Friction tracking during warm-up
================================

A Kalman filter tracks Coulomb friction, viscous friction and a torque offset from angle and torque.
"""

import numpy as np
from matplotlib.figure import Figure

from elastid.friction_study.extended_kalman_filter import FilterNoise, JointSamples, TrackedJoint
from elastid.friction_study.friction_tracking import track_friction

rate_hz, inertia, count = 1000.0, 0.02, 2 * np.pi / 2**16
t = np.arange(int(20 * rate_hz)) / rate_hz
v = 20 * np.sin(2 * np.pi * 0.7 * t) + 12 * np.sin(2 * np.pi * 0.23 * t)  # from rest
acceleration = np.gradient(v, 1 / rate_hz)
warmth = 1 - np.exp(-t / 15)
true = {"Fc": 1.0 * (1 - 0.2 * warmth), "f": 0.02 * (1 - 0.4 * warmth), "offset": np.full_like(t, 0.1)}
friction = true["Fc"] * np.tanh(v / 0.05) + true["f"] * v
torque = inertia * acceleration + friction + true["offset"] + 0.03 * np.random.default_rng(0).standard_normal(len(t))
angle = np.round(np.cumsum(v) / rate_hz / count) * count

joint = TrackedJoint(motor_inertia=inertia, coulomb=0.9, viscous=0.025, bristle_stiffness=250.0, bristle_damping=0.8)
noise = FilterNoise(count / np.sqrt(12), 0.03, drift={"Fc": 6e-3, "f": 25e-3, "offset": 1e-3})
found = track_friction("1", False, [joint], [JointSamples(torque, 0 * t, angle)], rate_hz, noise, 5.0, find_noise=False)
end = dict(zip(found.names, found.values[-1], strict=True))

if __name__ == "__main__":
    print({name: (round(value, 4), round(true[name][-1], 4)) for name, value in end.items()})
    figure = Figure(figsize=(8, 5), layout="constrained")
    for i, ax in enumerate(figure.subplots(3, 1, sharex=True)):
        ax.fill_between(found.time_s, found.low[:, i], found.high[:, i], alpha=0.3)
        ax.plot(t, true[found.names[i]], "k--", lw=1)
        ax.plot(found.time_s, found.values[:, i])
        ax.set(ylabel=found.names[i])
    figure.savefig("ex12.png")
