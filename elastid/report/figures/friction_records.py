"""Figures of friction in records: friction of a motion over velocity, and friction tracked by a Kalman filter."""

from collections.abc import Iterator

import numpy as np
from matplotlib.figure import Figure

from elastid.base.arrays import FloatArray
from elastid.base.statistics import QUANTILE_95
from elastid.friction_study.filter_consistency import NIS_BAND
from elastid.friction_study.friction_tracking import TrackedFriction
from elastid.friction_study.inverse_dynamics_regression import TORQUE_COMPONENTS, MotionFriction, torque_components
from elastid.friction_study.least_squares import Regression
from elastid.friction_study.motion_signals import MotionSignals, distinct_speeds
from elastid.friction_study.regressor import columns_of
from elastid.report.figures import style
from elastid.report.figures.friction import POINTS, quantity, units
from elastid.report.figures.style import Curve, Panel

# Names of tracked parameters.
NAMES = {
    "Fc": "Coulomb friction",
    "f": "viscous friction",
    "f+": "viscous friction +",
    "f-": "viscous friction \N{MINUS SIGN}",
    "offset": "offset",
}


def friction_motion(friction: MotionFriction) -> Figure:
    """Draw friction over velocity with the 95 % band of the regression, and torque over time."""
    signals, slides = MotionSignals.of(friction.motion, friction.passband_hz), friction.motion.slides
    columns, (speed, unit) = columns_of(signals, friction.terms), units(slides)
    components = torque_components(friction.regression, columns)
    torque, v = signals.filtered(friction.motion.torque), signals.filtered(signals.velocity)
    regressed, rigid = (
        np.sum([components[name] for name in names if name in components], axis=0)
        for names in (TORQUE_COMPONENTS, TORQUE_COMPONENTS[:2])
    )
    time_s = np.arange(len(friction.motion.position))[signals.decimation] / friction.motion.rate_hz
    samples = style.thinned(len(time_s))
    over_time = [
        Curve(time_s[samples], values[samples], text, ink)
        for values, ink, text in (
            (torque, style.MEASURED, "measured"),
            (regressed, style.FITTED, "regression"),
            (torque - regressed, style.RESIDUAL, "measured − regression"),
        )
    ]
    rows = [
        [Panel([*_over_velocity(friction, v, torque - rigid)], f"velocity in {speed}", f"friction in {unit}")],
        [Panel(over_time, "time in s", f"{quantity(slides)} in {unit}")],
    ]
    error = f"{100 * friction.regression.relative_error:.3g} % of the {quantity(slides)} unexplained"
    return style.matrix(f"{friction.motion.place}: friction over velocity, {error}", rows)


def sliding(numbers: Regression, v: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return friction (n,) and its std at nonzero velocities v (n,), from the parameters of both directions."""
    columns = {"coulomb": np.sign(v), "viscous": v}
    if "stiction" in numbers.names:
        fall = np.exp(-((v / numbers["stribeck_velocity"]) ** 2))
        columns |= {"coulomb": np.sign(v) * (1 - fall), "stiction": np.sign(v) * fall}
    columns |= {"directions.coulomb": np.ones_like(v), "directions.viscous": np.abs(v)}
    names = [name for name in columns if name in numbers.names]
    A = np.stack([columns[name] for name in names], axis=1)
    indices = [numbers.names.index(name) for name in names]
    covariance = numbers.covariance[np.ix_(indices, indices)]
    return A @ numbers.values[indices], np.sqrt(np.einsum("ni,ij,nj->n", A, covariance, A))


def _over_velocity(motion: MotionFriction, velocity: FloatArray, friction: FloatArray) -> Iterator[Curve]:
    """Yield curves over velocity (n,): measured friction (n,), constant speeds, and the regression."""
    samples = style.thinned(len(velocity))
    yield Curve(velocity[samples], friction[samples], dots=True)
    ends = [float(friction.min()), float(friction.max())]
    for sign in (1.0, -1.0):
        for speed in distinct_speeds(p.velocity for p in motion.plateaus if sign * p.velocity > 0):
            yield Curve([sign * speed] * 2, ends, "speeds dwelt at", style.NOISE, looks={"ls": ":"})
    for low, high in ((float(velocity.min()), 0.0), (0.0, float(velocity.max()))):
        v = np.linspace(low, high, POINTS)[1 if low == 0 else 0 : -1 if high == 0 else None]
        torque, std = sliding(motion.regression, v)
        yield Curve(v, torque, "regression", style.FITTED, band=style.band_95(torque, std))


def friction_filter(tracked: TrackedFriction) -> Figure:
    """Draw tracked parameters, the NIS (normalised innovations squared), and the innovations' autocorrelation."""
    time, rows = tracked.time_s, []
    for i, name in enumerate(tracked.names):
        y, band = tracked.values[:, i], (tracked.low[:, i], tracked.high[:, i])
        curves = [Curve(time, y, "followed", style.FITTED, band=band, band_label="95 % band")]
        unobserved = np.where(tracked.unknown[:, i], y, np.nan)
        if np.isfinite(unobserved).any():
            text = "fixed: not observable in this motion"
            curves.append(Curve(time, unobserved, text, style.WEAK))
        rows.append([Panel(curves, y=f"{NAMES[name]}\nin {_unit(name, tracked.slides)}")])
    low, high = (np.full_like(time, end) for end in NIS_BAND)
    text, label = "mean NIS since the point before", "mean NIS of an honest filter"
    nis = Curve(time, tracked.nis, text, style.TOTAL, band=(low, high), band_label=label)
    rows.append([Panel([nis], "time in s", "NIS", scale="log")])
    rho = tracked.consistency.autocorrelation[1:]
    limit = QUANTILE_95 / np.sqrt(max(tracked.consistency.n_eff, 1.0))
    dots = Curve(np.arange(1, len(rho) + 1), rho, dots=True)
    rows.append([Panel([dots], "lag in samples", "autocorrelation", marks=(-limit, limit))])
    return style.matrix(f"joint {tracked.joint}: friction followed, mean NIS {tracked.consistency.nis:.2f}", rows)


def _unit(name: str, slides: bool) -> str:
    torque = "N" if slides else "N*m"
    return {"Fc": torque, "offset": torque}.get(name, "N*s/m" if slides else "N*m*s/rad")
