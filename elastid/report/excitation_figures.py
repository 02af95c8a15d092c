"""What was injected: amplitude spectrum and one period of torque of one experiment of the plan."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from elastid.experiment.plan import Plan
from elastid.report import style


def excitation(plan: Plan) -> Figure:
    """Amplitude of every line (left) and torque over one period (right) of the plan's first experiment, by input."""
    experiment = plan.experiments[0]
    torque = plan.torque(experiment)
    amplitude = np.abs(plan.R[0, 0, 0])
    t = np.arange(plan.period_samples) / plan.rate_hz
    n_u = len(plan.inputs)
    height = 1.2 + 1.35 * n_u
    grid = {"left": 0.085, "right": 0.97, "top": 1 - 0.65 / height, "bottom": 0.5 / height, "wspace": 0.14}
    figure = Figure(figsize=(9.5, height))
    panels = figure.subplots(n_u, 2, sharex="col", squeeze=False, gridspec_kw=grid | {"hspace": 0.16})
    for j, name in enumerate(plan.inputs):
        spectrum, time = panels[j]
        spectrum.vlines(plan.freq_hz, 0, amplitude[:, j], color=style.MEASURED, lw=0.6)
        spectrum.plot(plan.freq_hz, amplitude[:, j], ls="none", marker="o", ms=2, color=style.MEASURED)
        spectrum.set_ylim(0, 1.15 * amplitude.max())
        time.plot(t, torque[:, j], color=style.MEASURED, lw=0.7)
        time.axhline(np.sqrt(np.mean(torque[:, j] ** 2)), color=style.FITTED, lw=0.8, ls="--", label="rms")
        time.annotate(
            style.plain(name), (1.012, 0.5), xycoords="axes fraction", rotation=270, va="center", fontsize=style.NORMAL
        )
        for axes in (spectrum, time):
            style.light(axes)
    style.log_frequency(panels[0, 0], plan.freq_hz)
    panels[0, 0].set_title("amplitude of the lines in N·m", fontsize=style.NORMAL)
    panels[0, 1].set_title("torque in N·m (dashed: rms)", fontsize=style.NORMAL)
    panels[-1, 0].set_xlabel("frequency in Hz", fontsize=style.NORMAL)
    panels[-1, 1].set_xlabel("time in s", fontsize=style.NORMAL)
    panels[-1, 1].set_xlim(0, t[-1])
    style.titled(figure, f"Excitation: {experiment.name}")
    return figure
