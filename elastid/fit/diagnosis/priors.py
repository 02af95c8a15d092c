"""Prior check: priors of the study and tolerances of the robot model, compared with the data."""

import math
from collections.abc import Sequence

import numpy as np

from elastid.base.display import percent
from elastid.base.errors import Note
from elastid.base.statistics import FALSE_ALARM_RATE, chi_square_limit
from elastid.fit.diagnosis.limits import LIMITS
from elastid.fit.gear_ratios import RatioScatter
from elastid.fit.result import Result
from elastid.fit.result_rows import ModificationIndex
from elastid.response import Response


def tolerance_of(index: ModificationIndex, result: Result) -> str:
    """Return the tolerance, in words, of the value that a cause changes most; empty if not significant."""
    nuisances = {p.name: p for p in result.parameters.free if p.is_nuisance and p.prior is not None}
    steps = zip(index.members, np.abs(index.steps).tolist(), strict=True)
    changes = [(step / p.prior.std, p) for name, step in steps if (p := nuisances.get(name)) is not None and p.prior]
    if not changes or index.drop <= LIMITS.min_drop:
        return ""
    _, p = max(changes, key=lambda change: change[0])
    std = 0.0 if p.prior is None else p.prior.std
    return percent(std) if p.log else f"{std:.2g} {p.unit}"


def contradicted_priors(result: Result) -> tuple[Note, ...]:
    """Return a note on each prior of the study that the data contradict.

    For a prior with mean m and variance S, and posterior variance P, x - m has the variance S - P.
    """
    notes, (moves, _) = [], result.parameters.priors(result.x)
    for p, P, move in zip(result.parameters.free, np.diag(result.covariance), moves, strict=True):
        if p.prior is None or p.is_nuisance or not (gain := 1 - P / p.prior.std**2) > 1 - LIMITS.prior_fraction:
            continue
        sigmas, alone = abs(move) / math.sqrt(gain), p.to_x(p.prior.mean) + move * p.prior.std / gain
        if sigmas >= LIMITS.max_prior_stds:
            text = (
                f"the data contradict the prior: {p.name} = {math.exp(alone) if p.log else alone:.6g} {p.unit} "
                f"without it, instead of {p.prior.mean:.6g} {p.unit} ({sigmas:.3g} std apart)"
            )
            remedy = "Correct the prior, or check the records"
            notes.append(Note("fit/prior-contradicted", text, p.name, remedy=remedy))
    return tuple(notes)


def contradicted_tolerances(result: Result) -> tuple[Note, ...]:
    r"""Return a note if the data contradict the tolerances: all together (chi-square test), one, or by their effect.

    d: changes of nominal values over their tolerances s; d^T d has the expectation tr(1 - P), P: posterior covariance
    of d, with 1 - P = 1 if P > 1 (scatter of gear ratios). The changes shift the parameters of interest by L d s, L =
    C_an C_nn^-1. By the tolerances alone this shift has the covariance L (S - C_nn) L^T, S = diag(s^2) (Hausman 1978,
    eq. 2.9).
    """
    n, C = len(result.parameters.of_interest), result.covariance
    d, slope = (x[n:] for x in result.parameters.priors(result.x))
    if not (len(d) and slope.all() and np.isfinite(C).all()):
        return ()
    s, variance_ratio = 1 / slope, np.diag(C)[n:] * slope**2
    dof, square = max(float(np.sum(np.where(variance_ratio > 1, 1.0, 1 - variance_ratio))), 1.0), float(d @ d)
    limit = chi_square_limit(dof, FALSE_ALARM_RATE)
    L = np.linalg.solve(C[n:, n:], C[n:, :n]).T
    changes, by_tolerances = L @ (d * s), np.einsum("ij,jk,ik->i", L, np.diag(s**2) - C[n:, n:], L)
    sizes = np.abs(changes) / np.sqrt(np.maximum(by_tolerances, np.diag(C)[:n]))
    if square <= limit and max(np.abs(d).max(), sizes.max()) <= LIMITS.max_prior_stds:
        return ()
    worst = int(np.argmax(sizes))
    p = result.parameters.of_interest[worst]
    change = relative_change(-changes[worst]) if p.log else f"{-changes[worst]:+.2g} {p.unit}"
    ratio, most = math.sqrt(square / dof), math.sqrt(limit / dof)
    text = (
        f"the robot model differs from the data by {ratio:.2g} tolerances (rms over its values; limit {most:.2g}). "
        f"Exact nominal values would change {p.name} by {change}, {sizes[worst]:.2g} times the std of this change "
        f"(limit {LIMITS.max_prior_stds:.2g})"
    )
    return (Note("fit/tolerances", text, p.name, remedy="Check torque constants, angles and payload"),)


def scattered_ratios(ratios: RatioScatter, responses: Sequence[Response]) -> tuple[Note, ...]:
    """Return a note on each gear whose ratio differs between angles, if this explains most of the excess of V."""
    first, notes = responses[0], list[Note]()
    for name, std in ratios.std.items() if ratios.explains else ():
        scatter = std * float(first.ratio_std[first.inputs.index(name)])
        text = (
            f"{name}: the gear ratio differs between configurations by {100 * scatter:.2g} % (std; tolerance "
            f"{100 * scatter / std:.2g} %), as with a transmission error. The intervals include it. To narrow them, "
            "measure more configurations, or superimpose a movement over whole motor revolutions"
        )
        notes.append(Note("fit/ratio-varies", text))
    return tuple(notes)


def relative_change(step: float) -> str:
    """Return the step of a logarithm in words: a percentage for factors from 0.5 to 2, else the factor, at most 1e6."""
    if abs(step) > math.log(1e6):
        return f"a factor {'above 1e+06' if step > 0 else 'below 1e-06'}"
    factor = math.exp(step)
    return f"{100 * (factor - 1):+.2g} %" if 0.5 < factor < 2 else f"a factor {factor:.3g}"
