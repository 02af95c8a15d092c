"""
Multisine for three motors
==========================

Design a multisine with odd lines, random phases and a flat spectrum. The three experiments are orthogonal at every
line.
"""

import numpy as np
from matplotlib.figure import Figure

from elastid.excitation.multisine import orthogonal_set, synthesise

rate_hz, period, rms = 500.0, 4.0, np.array([300.0, 300.0, 150.0])
lines = np.arange(7, 240, 2)  # of 1/period: 1.75 to 59.75 Hz, odd ones alone
amplitude = np.sqrt(2 / len(lines)) * np.ones((len(lines), 1)) * rms
U = orthogonal_set(amplitude, np.random.default_rng(1))  # (experiment, line, motor)
torque = np.stack([synthesise(lines, experiment, round(rate_hz * period)) for experiment in U])

gram = np.einsum("ema,emb->mab", U, U.conj())  # over experiments, at each line
orthogonality = np.abs(gram - np.einsum("maa->ma", gram)[:, :, None] * np.eye(3)).max() / np.abs(gram).max()
found_rms = np.sqrt(np.mean(torque**2, axis=1))

if __name__ == "__main__":
    print(f"rms {found_rms[0].round(1)} Nm; largest product between motors {orthogonality:.1e}")
    figure = Figure(figsize=(8, 3))
    ax = figure.subplots()
    ax.plot(np.arange(torque.shape[1]) / rate_hz, torque[0])
    ax.set(xlabel="time (s)", ylabel="torque (Nm)", title="first experiment, three motors")
    figure.savefig("ex07.png")
