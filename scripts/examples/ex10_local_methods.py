"""
Local methods
=============

Two motors move at once, in one experiment that starts at rest. The local rational method estimates the FRF of both and
the transient. The local polynomial method is biased at a resonance that is narrower than its window.
"""

import numpy as np
from matplotlib.figure import Figure

import elastid as ei
from elastid.frf.estimate import estimate
from elastid.frf.spec import EstimatorSpec

rate_hz, N, periods = 200.0, 2000, 2
rng = np.random.default_rng(0)
f = np.fft.rfftfreq(N * periods * 4, 1 / rate_hz)  # zeros behind the record: the response from rest


def plant(freq_hz):
    """Return compliance of two coupled modes at 8 and 17 Hz with 3 % damping."""
    shapes = np.array([[1.0, 0.6], [0.5, -1.0]])
    omega, modes = 2 * np.pi * freq_hz[:, None], 2 * np.pi * np.array([8.0, 17.0])
    each = modes**2 / (modes**2 - omega**2 + 0.06j * modes * omega)
    return np.einsum("fm,mi,mj->fij", each, shapes, shapes)


lines = np.arange(20, 300)  # of 1/period, 2 to 30 Hz
spectrum = np.zeros((N // 2 + 1, 2), complex)
spectrum[lines] = np.exp(2j * np.pi * rng.random((len(lines), 2)))
u = np.tile(np.fft.irfft(spectrum * 20, n=N, axis=0), (periods, 1))
y = np.fft.irfft(np.einsum("fij,fj->fi", plant(f), np.fft.rfft(u, n=4 * len(u), axis=0)), axis=0)[: len(u)]
y += 1e-3 * np.std(y) * rng.standard_normal(y.shape)
motors = ("motor 1", "motor 2")
record = ei.Record(
    "r", ei.Configuration("home", np.zeros(2)), 0, 0, rate_hz, N, motors, motors, ("position",) * 2, u, y, None
)
error, found = {}, {}
for method in ("local_polynomial", "local_rational"):
    spec = EstimatorSpec(method=method, quantity="position", transient_periods=0)
    G = found[method] = estimate([record], spec, lines)
    off = np.linalg.norm(G.G - plant(G.freq_hz), axis=(1, 2)) / np.linalg.norm(plant(G.freq_hz), axis=(1, 2))
    error[method] = float(off.max())

if __name__ == "__main__":
    print({method: f"{100 * worst:.2f} % at the worst line" for method, worst in error.items()})
    figure = Figure(figsize=(8, 4), layout="constrained")
    ax = figure.subplots()
    for method, G in found.items():
        ax.semilogy(G.freq_hz, np.abs(G.G[:, 0, 0]), ".", label=method)
    ax.semilogy(G.freq_hz, np.abs(plant(G.freq_hz)[:, 0, 0]), "k-", lw=0.8, label="true")
    ax.set(xlabel="frequency (Hz)", ylabel="position per torque")
    ax.legend()
    figure.savefig("ex10.png")
