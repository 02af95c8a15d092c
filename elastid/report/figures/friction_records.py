"""Friction in records: passes, motions, loops before sliding, bristles at rest, a warm-up, a filter."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from elastid.base.arrays import FloatArray
from elastid.base.statistics import QUANTILE_95
from elastid.friction_study.at_rest import AtRest
from elastid.friction_study.filter_consistency import FILTER
from elastid.friction_study.follow import FollowedFriction
from elastid.friction_study.laws import StaticLaw
from elastid.friction_study.least_squares import Regression
from elastid.friction_study.levels import PassLevels
from elastid.friction_study.motion import MotionFriction, MotionSamples, motion_samples
from elastid.friction_study.passes import MAX_HARMONIC, Pass, distinct_speeds, gravity_names, ripple_names
from elastid.friction_study.presliding import Elements, Loops, Presliding
from elastid.friction_study.warm_up import LevelOf, ThermalModel, WarmUp, level_over_heat
from elastid.report.figures import style
from elastid.report.figures.friction import POINTS, quantity, units

# Samples of a motion that are drawn.
MOST_SAMPLES = 6000
OFFSET = "gravity and offset"
COLORS = {"friction": style.START, OFFSET: style.MEASURED, "ripple": style.NOISE, "inertia": style.TOTAL}
# Of numbers that are followed.
NAMES = {
    "Fc": "Coulomb friction",
    "f": "viscous friction",
    "f+": "viscous friction +",
    "f-": "viscous friction \N{MINUS SIGN}",
    "offset": "offset",
}


def friction_pass(pair: Sequence[Pass], regressed: PassLevels) -> Figure:
    """Torque over angle, there and back: measured and regressed; the parts of the regression; what it leaves."""
    figure, panels = style.column(6.6, (2, 2, 1), 0.14)
    total_torque, shown, left = panels
    scale = 1.0 if pair[0].slides else 180 / np.pi
    for run, own in zip(pair, parts_of(pair, regressed), strict=True):
        step = max(1, len(run.position) // 3000)
        q, u = scale * run.position[::step], run.torque[::step]
        parts = {name: part[::step] for name, part in own.items()}
        total = np.sum(list(parts.values()), axis=0)
        total_torque.plot(q, u, color=style.MEASURED, lw=0.7, alpha=0.8, label="measured")
        total_torque.plot(q, total, color=style.FITTED, lw=1.2, label="regression")
        for name, part in parts.items():
            shown.plot(q, part, color=COLORS[name], lw=1.2, label=name)
        left.plot(q, u - total, color=style.RESIDUAL, lw=0.6, label="measured − regression")
    speed, torque = units(pair[0].slides)
    style.label(total_torque, y=f"{quantity(pair[0].slides)} in {torque}")
    style.label(shown, y=f"parts in {torque}")
    style.label(left, "position in m" if pair[0].slides else "angle in °", f"left in {torque}")
    mean = float(np.mean([np.abs(run.velocity).mean() for run in pair]))
    return style.finish(figure, f"{pair[0].place}: a pass there and back at {mean:.3g} {speed}", panels, panels, 0.02)


def parts_of(pair: Sequence[Pass], regressed: PassLevels) -> list[dict[str, FloatArray]]:
    """Of each pass friction, gravity with the pair's own offset, inertia (n,), and ripple where it was regressed."""
    shared = {name: value for name, (value, _) in regressed.shared.items()}
    by_run = []
    for run in pair:
        q, speed = run.position, np.abs(run.velocity)
        sliding = _level(pair, regressed, run.direction) + shared.get("slope", 0.0) * (speed - speed.mean())
        cosine, sine = (shared.get(name, 0.0) for name in gravity_names(run.load_name))
        gravity = cosine * np.cos(q) + sine * np.sin(q)
        parts = {"friction": run.direction * sliding, OFFSET: gravity}
        if "ripple.1c" in shared:
            parts["ripple"] = _ripple(q, shared, regressed.turn)
        by_run.append(parts | {"inertia": shared.get("inertia", 0.0) * run.acceleration})
    left = [run.torque - np.sum(list(parts.values()), axis=0) for run, parts in zip(pair, by_run, strict=True)]
    offset = float(np.mean([rest.mean() for rest in left]))
    return [parts | {OFFSET: parts[OFFSET] + offset} for parts in by_run]


def _level(pair: Sequence[Pass], regressed: PassLevels, direction: float) -> float:
    """Of the pair: the level at the nearest speed, load and temperature, in its direction where these differ."""
    levels = regressed.levels
    own = (levels.direction == direction) | (levels.direction == 0)
    speed = np.mean([np.abs(run.velocity).mean() for run in pair])
    load, heat = pair[0].load, np.mean([run.temperature for run in pair])
    away = np.abs(np.log(levels.speed / speed)) + np.abs(levels.load - load) / max(float(levels.load.max()), 1e-300)
    away = away + np.nan_to_num(np.abs(levels.temperature - heat)) / 100
    return float(levels.torque[own][np.argmin(away[own])])


def _ripple(q: FloatArray, shared: Mapping[str, float], turn: float) -> FloatArray:
    """The sum over h of a_h cos h N q + b_h sin h N q."""
    total = np.zeros_like(q)
    for h in range(1, MAX_HARMONIC + 1):
        cosine, sine = (shared.get(name, 0.0) for name in ripple_names(h))
        x = 2 * np.pi * h / turn * q
        total += cosine * np.cos(x) + sine * np.sin(x)
    return total


def friction_motion(friction: MotionFriction) -> Figure:
    """Torque less inertia and gravity over velocity, and the regression with its 95 % band; torque over time.

    Dotted lines: speeds that the motion dwells at.  Dashed: with the same numbers in both directions and an offset,
    where the chosen regression has numbers of each.
    """
    samples, slides = motion_samples(friction), friction.motion.slides
    figure, panels = style.column(6.0, (1.7, 1), 0.28, sharex=False)
    curve, over_time = panels
    speed, torque = units(slides)
    _draw_over_velocity(curve, friction, samples)
    style.label(curve, f"velocity in {speed}", f"friction in {torque}")
    measured = samples.torque, style.MEASURED, 1.0, "measured"
    regressed = samples.regressed, style.FITTED, 0.8, "regression"
    rest = samples.torque - samples.regressed, style.RESIDUAL, 0.6, "measured − regression"
    part = slice(None, None, max(1, len(samples.time_s) // MOST_SAMPLES))
    style.plot_curves(over_time, samples.time_s, measured, regressed, rest, part=part)
    style.label(over_time, "time in s", f"{quantity(slides)} in {torque}")
    error = f"{100 * friction.chosen.relative_error:.3g} % of the {quantity(slides)} left"
    return style.finish(figure, f"{friction.motion.place}: friction over velocity, {error}", panels, panels, 0.01)


def sliding(numbers: Regression, v: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Friction (n,) at velocities other than 0, both directions' numbers included, and its std."""
    columns = {"coulomb": np.sign(v), "viscous": v}
    if "stiction" in numbers.names:
        fall = np.exp(-((v / numbers["stribeck_velocity"]) ** 2))
        columns |= {"coulomb": np.sign(v) * (1 - fall), "stiction": np.sign(v) * fall}
    columns |= {"directions.coulomb": np.ones_like(v), "directions.viscous": np.abs(v)}
    own = [name for name in columns if name in numbers.names]
    A = np.stack([columns[name] for name in own], axis=1)
    chosen = [numbers.names.index(name) for name in own]
    covariance = numbers.covariance[np.ix_(chosen, chosen)]
    return A @ numbers.values[chosen], np.sqrt(np.einsum("ni,ij,nj->n", A, covariance, A))


def _draw_over_velocity(axes: Axes, motion: MotionFriction, samples: MotionSamples) -> None:
    step = max(1, len(samples.velocity) // MOST_SAMPLES)
    looks = style.DOTS | {"ms": 1.5, "alpha": 0.5, "color": style.MEASURED}
    axes.plot(samples.velocity[::step], samples.friction[::step], **looks)
    for sign in (1.0, -1.0):
        for speed in distinct_speeds([plateau for plateau in motion.plateaus if sign * plateau.velocity > 0]):
            axes.axvline(sign * speed, color=style.NOISE, lw=0.8, ls=":", label="speeds dwelt at")
    for low, high in ((float(samples.velocity.min()), 0.0), (0.0, float(samples.velocity.max()))):
        v = np.linspace(low, high, POINTS)[1 if low == 0 else 0 : -1 if high == 0 else None]
        if motion.are_apart:
            offset = motion.alike["offset"] if "offset" in motion.alike.names else 0.0
            symmetric = sliding(motion.alike, v)[0] + offset
            axes.plot(v, symmetric, color=style.TRUTH, lw=0.9, ls="--", label="the same in both directions")
        friction, std = sliding(motion.chosen, v)
        style.fill_band(axes, v, friction, QUANTILE_95 * std, style.FITTED, 0.3)
        axes.plot(v, friction, color=style.FITTED, lw=1.4, label="regression")


def friction_loops(loops: Loops, presliding: Presliding, slides: bool = False) -> Figure:
    """Torque over displacement, measured and replayed; torque of each threshold; errors by number of elements."""
    margins, ratios = (0.75, 0.25, 1.05, 0.55), (1.5, 1.1, 0.9)
    figure, (panels,) = style.panels(1, 3, (style.WIDE, 4.1), margins, (0.3, 0.0), width_ratios=ratios)
    loop, spectrum, errors = panels
    torque, length = ("N", "mm") if slides else ("N·m", "mrad")
    _draw_loops(loop, loops, presliding)
    style.label(loop, f"displacement in {length}", f"{'force' if slides else 'torque'} in {torque}", "loops")
    few = len(presliding.few.stiffness)
    name = f"spectrum of {len(presliding.spectrum.stiffness)} thresholds"
    _draw_spectrum(spectrum, presliding.spectrum, style.MEASURED, 3.0, name)
    _draw_spectrum(spectrum, presliding.few, style.FITTED, 5.0, f"{few} element{'s' if few > 1 else ''}")
    spectrum.set_ylim(bottom=0)
    style.set_log_frequency(spectrum, 1e3 * presliding.spectrum.threshold[[0, -1]], 5)
    style.label(spectrum, f"threshold D in {length}", f"k D in {torque}", "spectrum")
    _draw_errors(errors, presliding)
    break_away = f"{presliding.spectrum.break_away:.3g} {torque}"
    return style.finish(figure, f"{loops.place}: presliding, elements of {break_away} in all", panels, panels)


def _draw_loops(axes: Axes, loops: Loops, presliding: Presliding) -> None:
    q, used = presliding.position, slice(loops.settled, None)
    x = 1e3 * (q - q[used].mean())
    axes.plot(x[used], loops.torque[used], color=style.MEASURED, lw=0.7, alpha=0.7, label="measured")
    axes.plot(x[used], presliding.few.torque(q)[used], color=style.FITTED, lw=0.8, label="replayed")


def _draw_spectrum(axes: Axes, elements: Elements, color: str, size: float, name: str) -> None:
    shares = elements.stiffness * elements.threshold
    used = shares > 1e-4 * elements.break_away
    x = 1e3 * elements.threshold[used]
    axes.vlines(x, 0, shares[used], color=color, lw=1.0)
    axes.plot(x, shares[used], **style.DOTS, ms=size, color=color, label=name)


def _draw_errors(axes: Axes, presliding: Presliding) -> None:
    scale = 100 / presliding.spectrum.break_away
    few = len(presliding.few.stiffness)
    counts = np.arange(1, len(presliding.errors) + 1) if len(presliding.errors) > 1 else np.array([few])
    text = "error of unseen parts"
    axes.plot(counts, scale * presliding.errors, color=style.NOISE, marker="o", ms=3.5, lw=0.8, label=text)
    chosen = presliding.errors[np.flatnonzero(counts == few)]
    axes.plot([few], scale * chosen, ls="none", marker="o", ms=7, mfc="none", color=style.FITTED)
    axes.axhline(scale * presliding.spectrum_error, color=style.MEASURED, lw=0.8, ls="--", label="of the spectrum")
    axes.set_xticks(counts)
    axes.set_ylim(bottom=0)
    style.label(axes, "elements", "% of break-away", "cross-validation")


def friction_at_rest(place: str, at_rest: AtRest, slides: bool = False) -> Figure:
    """sigma_0 and sigma_1 with 95 % intervals, at each amplitude and extrapolated to none."""
    figure, (panels,) = style.panels(1, 2, (style.WIDE, 3.9), (0.9, 0.25, 0.85, 0.55), (0.28, 0.0))
    spring, damper = panels
    torque, unit = units(slides)[1], "N/m" if slides else "N·m/rad"
    points = [(p.torque, p.stiffness, p.stiffness_std, p.damping, p.damping_std) for p in at_rest.points]
    amplitude, stiffness, of_stiffness, damping, of_damping = np.array(points).T
    std_0, std_1 = np.sqrt(np.diag(at_rest.covariance)).tolist()
    _draw_at_rest(spring, amplitude, stiffness, of_stiffness, (at_rest.sigma_0, std_0))
    _draw_at_rest(damper, amplitude, damping, of_damping, (at_rest.sigma_1, std_1))
    style.label(spring, f"amplitude in {torque}", f"stiffness σ₀ in {unit}")
    style.label(damper, f"amplitude in {torque}", f"damping σ₁ in {unit.replace('/', '·s/')}")
    words = ", falling with the logarithm of the amplitude as of Maxwell slip" if at_rest.falls else ""
    return style.finish(figure, f"{place}: bristles at rest{words}", panels, panels)


def _draw_at_rest(
    axes: Axes, amplitude: FloatArray, values: FloatArray, std: FloatArray, limit: tuple[float, float]
) -> None:
    """One number over amplitude; limit: at amplitude 0, and its std."""
    looks: dict[str, Any] = {"ms": 4, "elinewidth": 1, "capsize": 3}
    order = np.argsort(amplitude)
    x, y = np.append(0.0, amplitude[order]), np.append(limit[0], values[order])
    axes.plot(x, y, color=style.WEAK, lw=0.9, ls="--", zorder=1)
    style.plot_intervals(axes, amplitude, values, std, **looks, color=style.MEASURED, label="measured")
    value, of_value = np.array(limit)[:, None]
    style.plot_intervals(axes, np.zeros(1), value, of_value, **looks, color=style.FITTED, label="extrapolated")
    axes.margins(x=0.06)


def friction_filter(followed: FollowedFriction) -> Figure:
    """Followed numbers, NIS with its band, and autocorrelation of the innovations."""
    ratios = (*(1.3 for _ in followed.names), 0.9, 1.0)
    figure, panels = style.column(1.6 * len(ratios), ratios, 0.42, sharex=False)
    time, unit = (followed.time_s, "s") if followed.time_s[-1] <= 300 else (followed.time_s / 60, "min")
    for i, name in enumerate(followed.names):
        _draw_number(panels[i], followed, i, time)
        style.label(panels[i], y=f"{NAMES[name]}\nin {_unit(name, followed.slides)}")
    nis, correlation = panels[-2:]
    nis.plot(time, followed.nis, color=style.TOTAL, lw=0.8, label="mean NIS since the point before")
    nis.axhspan(*FILTER.nis_band, color=style.FITTED, alpha=0.15, lw=0, label="mean NIS of an honest filter")
    nis.set_yscale("log")
    style.label(nis, f"time in {unit}", "NIS")
    rho = followed.consistency.autocorrelation
    correlation.stem(np.arange(1, len(rho)), rho[1:], linefmt="-", markerfmt=".", basefmt=" ")
    reach = QUANTILE_95 / np.sqrt(max(followed.consistency.n_eff, 1.0))
    correlation.axhspan(-reach, reach, color=style.FITTED, alpha=0.15, lw=0)
    style.label(correlation, "lag in samples", "autocorrelation")
    title = f"joint {followed.joint}: friction followed, mean NIS {followed.consistency.nis:.2f}"
    return style.finish(figure, title, panels, panels, 0.01)


def _draw_number(axes: Axes, followed: FollowedFriction, i: int, time: np.ndarray) -> None:
    looks: dict[str, Any] = {"color": style.FITTED, "alpha": 0.2, "lw": 0, "label": "95 % band"}
    axes.fill_between(time, followed.low[:, i], followed.high[:, i], **looks)
    axes.plot(time, followed.values[:, i], color=style.FITTED, lw=1.2, label="followed")
    held = np.where(followed.unknown[:, i], followed.values[:, i], np.nan)
    if np.isfinite(held).any():
        axes.plot(time, held, color=style.WEAK, lw=2.0, label="held: not observable in this motion")


def _unit(name: str, slides: bool) -> str:
    torque = "N" if slides else "N*m"
    return {"Fc": torque, "offset": torque}.get(name, "N*s/m" if slides else "N*m*s/rad")


def friction_warm_up(
    place: str, warm_up: WarmUp, model: ThermalModel, law: StaticLaw | None, slides: bool = False
) -> Figure:
    """Power, temperature (relative where kelvins cannot be known), and levels by speed; lines: the thermal model."""
    figure, panels = style.column(6.4, (0.7, 1.4, 1.8), 0.16)
    power, heat, tests = panels
    minutes, kelvin = warm_up.time_s / 60, model.scale == "kelvin"
    power.stairs(warm_up.power, minutes, color=style.TOTAL, lw=1.0, label="power into heat")
    read = np.isfinite(warm_up.readings)
    if read.any() and kelvin:
        heat.plot(minutes[read], warm_up.readings[read], **style.DOTS, ms=1.8, color=style.WEAK, label="thermometer")
    heat.plot(minutes, model.temperature(warm_up), color=style.FITTED, lw=1.3, label="thermal model")
    if len(warm_up.level):
        _draw_tests(tests, warm_up, model, level_over_heat(law, warm_up), units(slides)[0])
    style.label(power, y="power in W")
    style.label(heat, y="temperature in °C" if kelvin else "relative temperature")
    style.label(tests, "time in min", f"{'force' if slides else 'torque'} in {units(slides)[1]}")
    times = " and ".join(f"{constant / 60:.3g} min" for constant in model.time_constants)
    title = f"{place}: warm-up, time constant{'s' if len(model.time_constants) > 1 else ''} of {times}"
    return style.finish(figure, title, panels, panels, 0.01)


def _draw_tests(axes: Axes, warm_up: WarmUp, model: ThermalModel, level_of: LevelOf | None, unit: str) -> None:
    is_predicted = len(model.series) > 0 or level_of is not None
    predicted = model.levels(warm_up, level_of) if is_predicted else None
    minutes = warm_up.time_s[warm_up.tests] / 60
    for i, speed in enumerate(np.unique(warm_up.test_speed).tolist()):
        own, color = warm_up.test_speed == speed, style.SERIES[i % len(style.SERIES)]
        looks: dict[str, Any] = {"ms": 3, "color": color, "label": f"tests at {speed:.3g} {unit}"}
        style.plot_intervals(axes, minutes[own], warm_up.level[own], warm_up.level_std[own], **looks)
        if predicted is not None:
            axes.plot(minutes[own], predicted[own], color=color, lw=1.0)
    axes.set_ylim(bottom=min(0.0, axes.get_ylim()[0]))
