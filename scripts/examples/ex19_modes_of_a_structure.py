"""
Modes of a structure
====================

Three masses on springs, with two shakers: natural frequencies, damping ratios and mode shapes with 95 % intervals from
a noisy FRF.
"""

import numpy as np

from elastid import Configuration, Response
from elastid.experiment.simulated.plant import true_modes, true_response
from elastid.modal.estimate import estimate_modes
from elastid.modal.modes import mac
from elastid.response import Covariance

freq_hz = np.arange(20, 480) / 8
G = true_response(freq_hz)
std = 0.02 * np.sqrt(np.mean(np.abs(G) ** 2))
rng = np.random.default_rng(0)
noise = std * (rng.standard_normal(G.shape) + 1j * rng.standard_normal(G.shape)) / np.sqrt(2)
bench = Configuration("bench", np.zeros(0))
names = ("shaker table", "shaker tip"), ("table x", "column x", "tip x")
covariance = Covariance(np.full(G.shape, std**2), np.inf)
response = Response(freq_hz, G + noise, *names, "acceleration", bench, noise=covariance)

# %%
# A pole is a mode only if noise alone does not produce it.
modes = estimate_modes(response)
omega, zeta, shapes = true_modes()
agreement = np.diag(mac(modes.shapes, shapes))

if __name__ == "__main__":
    from matplotlib.figure import Figure

    print(modes)
    figure = Figure(figsize=(7, 3.5), layout="constrained")
    axes = figure.add_subplot()
    axes.semilogy(freq_hz, np.abs(response.G[:, 0, 0]), ".", ms=2, label="measured")
    axes.semilogy(freq_hz, np.abs(modes.synthesis[:, 0, 0]), label="modal model")
    axes.set_xlabel("frequency in Hz")
    axes.set_ylabel("|G| in (m/s²)/N")
    axes.legend()
