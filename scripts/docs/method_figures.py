"""Figures of the pages on method and theory: an axis with Coulomb friction, simulated, estimated and fitted.

uv run --group docs python scripts/docs/method_figures.py
"""

import contextlib
import runpy
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch
from pictures import HERE, smaller

import elastid as ei

BLUE, ORANGE, GREEN, GREY = "#0072b2", "#d55e00", "#009e73", "0.55"
INERTIA, RATIO, LOAD, STIFFNESS, DAMPING = 1e-3, 100.0, 8.0, 3.2e4, 30.0


def axis(coulomb: float) -> ei.Robot:
    """Return motor, gear and load; the stiffness is a start value, 6 % below the true one."""
    motor = ei.Motor(INERTIA, RATIO, 1e-3, coulomb=coulomb)
    joint = ei.Joint("1", "z", ei.Spring(3e4, DAMPING), motor)
    return ei.Robot("axis", (ei.Body("load", joints=(joint,), inertia=LOAD),), gravity=(0.0, 0.0, 0.0))


def records_of(robot: ei.Robot, realisations: int) -> Any:
    """Return records of four periods of 4 s, in closed loop."""
    excitation = {"rate_hz": 500, "period": "4 s", "band_hz": [2, 60], "torque_rms": 60, "grid": "odd-random"}
    rig = {"truth": {"k_1": STIFFNESS}, "noise": {"torque_std": 2, "angle_std": 2e-6}}
    experiment = {"configurations": {"home": [0]}, "realisations": realisations, "periods": 4, "simulated": rig}
    return ei.simulate(robot, excitation=excitation, experiment=experiment, seed=1)


def drawn(widths: tuple[float, ...]) -> tuple[Figure, Any]:
    """Draw a figure of one row of axes."""
    figure = Figure(figsize=(9, 3.1), layout="constrained")
    return figure, figure.subplots(1, len(widths), width_ratios=widths)


def log_axes(ax: Any, ylabel: str) -> None:
    """Set frequency on a logarithmic axis, with plain numbers."""
    ax.set(xscale="log", yscale="log", xlabel="frequency (Hz)", xticks=(2, 5, 10, 20, 50))
    ax.set_xticklabels(["2", "5", "10", "20", "50"])
    ax.minorticks_off()
    ax.set_ylabel(ylabel, fontsize=9)
    ax.grid(True, lw=0.3)


def loop(records: Any) -> Figure:
    """Draw block diagram of the closed loop; one period of the torque and its spectrum."""
    figure, (diagram, spectrum) = drawn((1.25, 1))
    diagram.set(xlim=(0, 10), ylim=(0, 5))
    diagram.axis("off")
    for x, y, words in ((4.4, 3.1, "robot  $G$"), (4.4, 0.8, "controller  $F$")):
        diagram.add_patch(FancyBboxPatch((x, y), 2.5, 1.0, boxstyle="round,pad=0.05", fc="#eef4fa", ec=BLUE))
        diagram.text(x + 1.25, y + 0.5, words, ha="center", va="center")
    for x in (2.6, 8.2):
        diagram.plot(x, 3.6, "o", ms=13, mfc="white", mec="black")
        diagram.text(x, 3.6, "+", ha="center", va="center")
    arrows = [(0.3, 3.6, 2.4, 3.6), (2.8, 3.6, 4.35, 3.6), (6.95, 3.6, 8.0, 3.6), (8.4, 3.6, 9.9, 3.6)]
    arrows += [(8.2, 4.9, 8.2, 3.9), (9.2, 1.3, 6.95, 1.3), (2.6, 1.3, 2.6, 3.3)]
    for x, y, to_x, to_y in arrows:
        diagram.annotate("", (to_x, to_y), (x, y), arrowprops={"arrowstyle": "-|>", "color": "black"})
    diagram.plot([9.2, 9.2], [3.6, 1.3], [4.35, 2.6], [1.3, 1.3], color="black", lw=1)
    labels = ((0.3, 3.8, "multisine $r$"), (3.0, 3.8, "torque $u$"), (8.3, 4.6, "noise $v$"), (9.3, 3.8, "$y$"))
    for x, y, words in (*labels, (2.75, 2.3, "$-$")):
        diagram.text(x, y, words, color=ORANGE if "$r$" in words else "black")
    record = records[0]
    n, r = record.period_samples, np.asarray(record.r)[: record.period_samples, 0]
    freq, R = np.fft.rfftfreq(n, 1 / record.rate_hz), np.abs(np.fft.rfft(r)) * 2 / n
    inside = (freq > 1.5) & (freq < 20)
    excited = inside & (R > 1.0)
    spectrum.vlines(freq[excited], 0, R[excited], color=ORANGE, lw=1.5)
    spectrum.plot(freq[excited], R[excited], "o", ms=3.5, color=ORANGE, label="excited DFT lines (odd)")
    rest = freq[inside & ~excited]
    spectrum.plot(rest, 0 * rest, "|", color=GREY, label="detection lines")
    spectrum.set(xlabel="frequency (Hz)", ylabel="torque amplitude (Nm)", ylim=(-0.6, 1.5 * R.max()))
    spectrum.legend(fontsize=8, loc="upper right")
    return figure


def periods(records: Any, response: ei.Response) -> Figure:
    """Draw torque in two realisations; levels of output, noise and distortion."""
    figure, (time, level) = drawn((1, 1.1))
    for record, color in zip(records[:2], (BLUE, ORANGE), strict=True):
        n = record.period_samples
        period = np.asarray(record.y)[-2 * n :, 0] * 1e3
        t = np.arange(2 * n) / record.rate_hz
        time.plot(t, period - period.mean(), color=color, lw=0.8, label=f"realisation {record.realisation + 1}")
    time.axvline(n / record.rate_hz, color="black", lw=0.8, ls="--")
    low, high = time.get_ylim()
    time.set(xlabel="time (s)", ylabel="joint angle (mrad)", xlim=(0, 8), ylim=(low, high + 0.55 * (high - low)))
    for x in (0.25, 0.75):
        time.text(x, 0.72, "period", transform=time.transAxes, ha="center", fontsize=8)
    time.legend(fontsize=8, ncols=2, loc="upper center")
    quality = response.quality
    kinds = [("excited", "amplitude", BLUE, "output"), ("odd", "amplitude", ORANGE, "odd distortion")]
    kinds += [("even", "amplitude", GREEN, "even distortion"), ("excited", "noise", GREY, "noise")]
    for index, kind, color, words in kinds:
        lines = getattr(quality, index)
        level.plot(lines.freq_hz, getattr(lines, kind)[:, 0], ".", ms=4, color=color, label=words)
    log_axes(level, "acceleration (rad/s²)")
    level.set_ylim(top=60)
    level.legend(fontsize=8, ncols=2, loc="upper left")
    return figure


def band(uncompensated: ei.Response, response: ei.Response) -> Figure:
    """Draw FRF with its 95 % band without and with friction compensation."""
    figure, each = drawn((1, 1))
    for ax, measured, words in zip(each, (uncompensated, response), ("without", "with"), strict=True):
        f, G = measured.freq_hz, np.abs(measured.G[:, 0, 0])
        half = 1.96 * measured.std[:, 0, 0]
        ax.fill_between(f, np.maximum(G - half, 1e-4), G + half, color=BLUE, alpha=0.35, lw=0, label="95 % band")
        ax.plot(f, G, ".", ms=3, color=BLUE, label="measured FRF")
        ax.plot(f, measured.std[:, 0, 0], color=ORANGE, lw=1, label="standard deviation")
        log_axes(ax, "acceleration per torque ((rad/s²)/Nm)")
        ax.set(title=f"{words} friction compensation", ylim=(1e-5, 3))
        ax.title.set_fontsize(10)
    each[0].legend(fontsize=8, loc="upper left")
    return figure


def model() -> Figure:
    """Draw two inertias and a spring, and the FRF of the linearised model with its two limits."""
    figure, (sketch, ax) = drawn((1, 1))
    sketch.set(xlim=(0, 10), ylim=(0, 5))
    sketch.axis("off")
    for x, wide, label in ((1.0, 2.0, "motor\n$M_m$"), (6.6, 2.4, "link\n$M(q_a)$")):
        sketch.add_patch(FancyBboxPatch((x, 1.6), wide, 1.8, boxstyle="round,pad=0.05", fc="#eef4fa", ec=BLUE))
        sketch.text(x + wide / 2, 2.5, label, ha="center", va="center")
    t = np.linspace(0, 1, 200)
    along = 3.05 + 3.5 * t
    coil = np.where((t > 0.15) & (t < 0.85), 0.28 * np.sin(2 * np.pi * 6 * (t - 0.15) / 0.7), 0)
    sketch.plot(along, 2.95 + coil, color="black", lw=1)
    sketch.plot([3.05, 4.7], [1.95, 1.95], [4.95, 6.55], [1.95, 1.95], color="black", lw=1)
    sketch.plot([4.7, 4.7], [1.7, 2.2], [5.2, 4.55, 4.55, 5.2], [2.25, 2.25, 1.65, 1.65], color="black", lw=1)
    named = ((4.8, 3.45, "stiffness $K$"), (4.8, 1.15, "damping $D$"), (2.0, 3.75, "$q_m,\\ u$"), (7.8, 3.75, "$q_a$"))
    for x, y, label in (*named, (7.8, 0.9, "gravity $g(q_a)$")):
        sketch.text(x, y, label, ha="center")
    f = np.geomspace(2, 60, 600)
    s, J = 2j * np.pi * f, INERTIA * RATIO**2
    c = STIFFNESS + DAMPING * s
    ax.loglog(f, np.abs(s**2 * (LOAD * s**2 + c) / ((J * s**2 + c) * (LOAD * s**2 + c) - c**2)), color=BLUE)
    limits = ((1 / (J + LOAD), 2, "rigid robot: $1/(M+M_m)$", 0.6), (1 / J, 20, "motor alone: $1/M_m$", 0.72))
    for value, x, label, up in limits:
        ax.axhline(value, color=GREY, lw=0.8, ls="--")
        ax.text(x, value * up, label, fontsize=8)
    zero, pole = np.sqrt(STIFFNESS / LOAD) / 2 / np.pi, np.sqrt(STIFFNESS * (1 / J + 1 / LOAD)) / 2 / np.pi
    for x, y, label in ((zero, 1.3e-3, "zero: motor locked"), (pole, 0.75, "pole: mode of the free robot")):
        ax.annotate(label, (x, y), (x * 1.12, y), fontsize=8, va="center")
        ax.axvline(x, color=ORANGE, lw=0.8, ls=":")
    log_axes(ax, "acceleration per torque ((rad/s²)/Nm)")
    ax.set_ylim(1e-3, 2)
    return figure


def fit(response: ei.Response, result: ei.Result) -> Figure:
    """Draw fitted FRF, normalised residuals on the normal density, intervals of the parameters."""
    figure, (curve, histogram, forest) = drawn((1.1, 0.9, 1))
    fitted = result.model("home").response(response.freq_hz).G
    curve.plot(response.freq_hz, np.abs(response.G[:, 0, 0]), ".", ms=3, color=BLUE, label="measured")
    curve.plot(response.freq_hz, np.abs(fitted[:, 0, 0]), color=ORANGE, lw=1, label="fitted")
    log_axes(curve, "acceleration per torque ((rad/s²)/Nm)")
    curve.legend(fontsize=8)
    z = ((response.G - fitted) / response.std * np.sqrt(2)).ravel()
    z, at = np.concatenate([z.real, z.imag]), np.linspace(-4, 4, 200)
    histogram.hist(z, bins=np.linspace(-4, 4, 17), density=True, color=BLUE, alpha=0.5)
    histogram.plot(at, np.exp(-(at**2) / 2) / np.sqrt(2 * np.pi), color=ORANGE)
    histogram.set(xlabel="residual / standard deviation", ylabel="density", title=f"rms {np.sqrt(np.mean(z**2)):.2f}")
    histogram.title.set_fontsize(10)
    true = {"k_1": STIFFNESS, "d_1": DAMPING, "I_load": LOAD}
    for row, (name, value) in enumerate(true.items()):
        p = result[name]
        low, mid, high = (100 * (each / value - 1) for each in (p.low, p.value, p.high))
        forest.plot([low, high], [-row, -row], color=BLUE, lw=2)
        forest.plot(mid, -row, "o", color=BLUE, ms=4)
    forest.axvline(0, color=ORANGE, lw=1)
    forest.set(yticks=range(0, -3, -1), yticklabels=list(true), ylim=(-2.6, 0.6), xlabel="error (%), 95 % interval")
    return figure


def tolerances() -> Figure:
    """Draw a stiffness and a mass of which the data determine the ratio, and contributions to the variance."""
    figure, (plane, time) = drawn((1, 1))
    noise, mass = 0.5, np.array([-4.0, 4.0])  # std of ratio (%), errors of the mass (%); its tolerance is 1 %
    for side in (-1.96, 1.96):
        plane.plot(mass, mass + side * noise, color=GREY, ls="--", label="data alone" if side > 0 else None)
    circle = 2.45 * np.array([np.cos(np.linspace(0, 2 * np.pi, 200)), np.sin(np.linspace(0, 2 * np.pi, 200))])
    plane.plot(circle[0], circle[0] + noise * circle[1], color=BLUE, label="data and tolerance")
    plane.axvspan(-1.96, 1.96, color=ORANGE, alpha=0.15, lw=0, label="tolerance of the mass")
    plane.plot([0, 0], [-1.96 * noise, 1.96 * noise], color="black", lw=3, label="interval of k, mass fixed")
    plane.set(xlabel="error of the mass (%)", ylabel="error of the stiffness (%)", xlim=(-4, 4), ylim=(-5.2, 8))
    plane.legend(fontsize=8, ncols=2, loc="upper left")
    t = np.geomspace(0.01, 100, 200)
    kinds = ((1 + noise**2 / t, BLUE, "total"), (noise**2 / t, GREY, "noise"), (1 + 0 * t, ORANGE, "tolerance"))
    for variance, color, words in kinds:
        time.loglog(t, np.sqrt(variance), color=color, label=words)
    time.set(xlabel="measurement time (relative)", ylabel="standard deviation of k (%)")
    time.grid(True, lw=0.3)
    time.legend(fontsize=8)
    return figure


def gear() -> Figure:
    """Draw torque over deflection, transmission error over the motor angle, friction over the torque."""
    figure, (torsion, error, friction) = drawn((1.1, 1, 0.9))
    x = np.linspace(-1, 1, 400)
    spring = 0.6 * x + 0.4 * x**3
    for sign, words in ((1, "hardening and hysteresis"), (-1, None)):
        torsion.plot(x, spring + sign * 0.07 * (1 - 2 * np.exp(-8 * (1 + sign * x))), color=BLUE, label=words)
    torsion.plot(x, np.sign(x) * np.maximum(np.abs(x) - 0.2, 0), color=ORANGE, ls="--", label="lost motion")
    torsion.set(xlabel="gear deflection", ylabel="gear torque", xticks=(0,), yticks=(0,), ylim=(-1.1, 1.6))
    torsion.legend(fontsize=8, loc="upper left")
    turns = np.linspace(0, 2, 400)
    error.plot(turns, 4 * np.sin(2 * np.pi * turns) + 2 * np.sin(4 * np.pi * turns + 0.5), color=BLUE)
    error.set(xlabel="motor turns", ylabel="transmission error (arcsec)")
    torque = np.linspace(-600, 600, 200)
    friction.plot(torque, 20 + 0.02 * np.abs(torque), color=BLUE)
    friction.set(xlabel="gear torque (Nm)", ylabel="friction torque (Nm)", ylim=(0, 40))
    for ax in (torsion, error, friction):
        ax.grid(True, lw=0.3)
    return figure


def of_example(name: str) -> Figure:
    """Return the figure of an example of the gallery."""
    path = Path(__file__).parents[1] / "examples" / name
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        figure: Figure = runpy.run_path(str(path), run_name="__main__")["figure"]
    return figure


def figures() -> dict[str, Figure]:
    """Return all figures by the names of their files."""
    rubbing, smooth = axis(coulomb=0.15), axis(coulomb=0.0)
    records = records_of(rubbing, 4)
    uncompensated, response = (ei.estimate(records, rubbing, friction=each)["home"] for each in ("none", "auto"))
    linear = ei.estimate(records_of(smooth, 16), smooth)["home"]
    result = ei.identify([linear], smooth, ei.choose(smooth, "k_1", "d_1", "I_load"), starts=3, seed=1)
    return {
        "method_loop": loop(records),
        "method_periods": periods(records, uncompensated),
        "method_band": band(uncompensated, response),
        "method_model": model(),
        "method_fit": fit(linear, result),
        "theory_intervals": tolerances(),
        "theory_gears": gear(),
        "theory_observer": of_example("ex12_friction_observer.py"),
        "theory_modes": of_example("ex19_modes_of_a_structure.py"),
    }


if __name__ == "__main__":
    for name, figure in figures().items():
        path: Path = HERE / f"{name}.png"
        figure.savefig(path, dpi=110)
        print(path.name, smaller(path))
