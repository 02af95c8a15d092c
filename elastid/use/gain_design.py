r"""Gains and notches of a cascade with the largest position gains at a limited sensitivity.

.. math:: \max_{K_v, K_p, \ldots} \; \frac{1}{n_u} \sum_i \ln K_{p,i} \quad \text{so that} \quad
          M_{S,q} \le 6\, \mathrm{dB}

in all postures q, and for 95 % of the posterior samples of a fit in all of them (M_S: Skogestad and Postlethwaite,
Multivariable Feedback Control, 2nd ed., 2005, section 2.4.3). The bandwidth of an axis is nearly K_p / 2 pi. The search
starts at the fastest of a few rules within the limit (velocity loops at a fraction of the first mode, position loops
slower by a factor of 4 to 32). It is sequential quadratic programming over the logarithms (SLSQP, Kraft 1988), with
exact derivatives of M_S in frequency bands of each posture. A notch is added if the sensitivity of an axis is at its
limit and the notch increases the bandwidth. The gains of each result are reduced, in the position loops or in all
loops, until all loops are stable and within the limit. The result with the largest bandwidths is selected. Low gains
are not always safe: they do not stabilise a posture that is unstable under gravity.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import lru_cache, partial

import numpy as np
from scipy.optimize import minimize

from elastid.base.arrays import FloatArray
from elastid.base.errors import FitError
from elastid.use.cascade import HIGHEST, Cascade
from elastid.use.closed_loops import LIMIT_DB, Scene, scaled
from elastid.use.plants import Plants

MAX_NOTCHES = 2  # of an axis
_BANDS = 10  # frequency bands, each with a constraint on its peak
_ROUNDS, _STEPS, _REACH = 8, 12, 0.5  # rounds, SLSQP steps in each, and largest change of x in each
_SLOWER, _SLOWEST = 0.98, 200  # factor and most steps of a reduction of gains


def _is_within(scene: Scene, cascade: Cascade, limit_db: float) -> bool:
    loops = cascade.on(scene)
    return bool(20 * np.log10(loops.size.max()) <= limit_db and loops.stable.all())


def slow_down(cascade: Cascade, is_accepted: Callable[[Cascade], bool], slowest: int = _SLOWEST) -> Cascade | None:
    """Return the first copy of a controller with reduced gains that is accepted, to a quarter of a step; or None."""
    for step in range(slowest):
        for factor in (0.0, 1.0):  # reduction of the velocity gains over that of the position gains

            def at(steps: float, factor: float = factor) -> Cascade:
                return cascade.slower(_SLOWER**steps, _SLOWER ** (factor * steps))

            if is_accepted(at(step)):
                return next(filter(is_accepted, (at(step - x) for x in (0.75, 0.5, 0.25) if step)), at(step))
    return None


def initial_cascades(plants: Plants, first_mode_hz: float, delay: int) -> Iterator[Cascade]:
    """Yield cascades with velocity bandwidths of 2 to 1/30 of the first mode (or delay limit) and gains by inertia."""
    top = 2 * np.pi * min(first_mode_hz, plants.rate_hz / (8 * (1 + delay)))
    inertia = np.exp(np.log(plants.inertia).mean(axis=0))
    corner = np.full(len(inertia), 0.3 * plants.rate_hz)
    for omega in top * np.geomspace(2.0, 1 / 30, 13):
        for ratio in (4.0, 8.0, 16.0, 32.0):
            yield Cascade(np.full(len(inertia), omega / ratio), inertia * omega, corner, delay, np.zeros((0, 3)))


def design(scene: Scene, first_mode_hz: float, delay: int, limit_db: float = LIMIT_DB) -> Iterator[Cascade]:
    """Yield controllers of increasing bandwidth within the limit on all plants; FitError without any."""
    starts = initial_cascades(scene.plants, first_mode_hz, delay)
    feasible = [cascade for cascade in starts if _is_within(scene, cascade, limit_db)]
    best = max(feasible, key=lambda cascade: cascade.reached(scene), default=None)
    if best is None:
        raise FitError(
            "use/gains",
            f"no gains keep the sensitivity below {limit_db:.3g} dB in all postures with a delay of {delay} samples at "
            f"{scene.plants.rate_hz:g} Hz: raise the rate, or omit the posture with the fastest unstable pole",
        )
    yield best
    best = tune_gains(scene, best, limit_db) or best
    yield best
    for _ in range(MAX_NOTCHES * len(best.velocity_gain)):
        candidates = [tune_gains(scene, cascade, limit_db, rounds=2) for cascade in _with_notch(scene, best)]
        start = max(filter(None, candidates), key=lambda cascade: cascade.reached(scene), default=best)
        candidate = tune_gains(scene, start, limit_db) or best
        if candidate.reached(scene) < best.reached(scene) + 0.02:  # a notch must increase the bandwidth by 2 %
            return
        best = candidate
        yield best


def _with_notch(scene: Scene, best: Cascade) -> Iterator[Cascade]:
    """Yield cascades with another shallow notch for each axis, below and above the peak that this axis dominates."""
    U, size, Vh = np.linalg.svd(scaled(best.on(scene).S, scene.plants.inertia))
    contributions = np.abs(U[..., 0] * Vh[..., 0, :]) * size[..., :1]
    for axis in range(len(best.velocity_gain)):
        if best.axes.count(axis) >= MAX_NOTCHES:
            continue
        freq_hz = scene.freq_hz[np.unravel_index(int(contributions[..., axis].argmax()), contributions.shape[:2])]
        for ratio in (0.8, 1.25):
            row = np.array([[min(freq_hz * ratio, HIGHEST * scene.plants.rate_hz), 0.7, 0.7]])
            yield replace(best, notches=np.vstack([best.notches, row]), axes=(*best.axes, axis))


def tune_gains(scene: Scene, start: Cascade, limit_db: float, rounds: int = _ROUNDS) -> Cascade | None:
    """Maximise position gains by rounds of SLSQP; None if a start with reduced gains is not within the limit either."""
    is_accepted = partial(_is_within, scene, limit_db=limit_db)

    @lru_cache(maxsize=2)
    def margin_at(x: bytes) -> tuple[FloatArray, FloatArray]:
        return sensitivity_margin(scene, start.at(np.frombuffer(x)), limit_db)

    n = len(start.velocity_gain)
    gradient = np.eye(n, len(start.vector)).sum(axis=0) / n  # of the mean of ln K_p over the axes
    best, step_bound = slow_down(start, is_accepted), _REACH
    if best is None:
        return None
    for _ in range(rounds):
        low, high = best.bounds(step_bound, scene.plants.rate_hz)
        optimum = minimize(
            lambda x: (-gradient @ x, -gradient), best.vector, jac=True, method="SLSQP",
            bounds=list(zip(low, high, strict=True)), options={"maxiter": _STEPS, "ftol": 1e-5},
            constraints={
                "type": "ineq", "fun": lambda x: margin_at(x.tobytes())[0], "jac": lambda x: margin_at(x.tobytes())[1],
            },
        )  # fmt: skip
        x = np.clip(optimum.x, low, high)
        trial = slow_down(best.at(x), is_accepted, 20) if np.isfinite(x).all() else None
        gain = (trial or best).reached(scene) - best.reached(scene)
        best = trial if trial and gain > 0 else best
        step_bound /= 3 if gain < 0.005 else 1
        if step_bound < 0.05:
            break
    return best


def sensitivity_margin(scene: Scene, form: Cascade, limit_db: float) -> tuple[FloatArray, FloatArray]:
    """Return the limit minus M_S, dB (n,), in each band of each plant, and its slopes (n, n_x) by x."""
    closed, root = form.on(scene), np.sqrt(scene.plants.inertia)
    S, sizes = closed.S, closed.size
    bands = np.array_split(np.arange(sizes.shape[1]), _BANDS)
    lines = np.array([band[size[band].argmax()] for size in sizes for band in bands])
    rows = np.repeat(np.arange(len(sizes)), _BANDS)
    margin_db = limit_db - 0.02 - 20 * np.log10(sizes[rows, lines])
    # d sigma = -Re u^H S dF P S v in scaled coordinates.
    peak_S, scale = S[rows, lines], root[rows]
    U, sigma, Vh = np.linalg.svd(peak_S / scale[:, :, None] * scale[:, None, :])
    output_factor = np.einsum("ki,kij->kj", U[:, :, 0].conj() / scale, peak_S)
    input_factor = np.einsum("kij,kjl,kl->ki", scene.P[rows, lines], peak_S, Vh[:, 0].conj() * scale)
    by_controller = output_factor * closed.F[rows, lines] * input_factor
    log_slopes = form.log_slopes(scene.delay[rows, lines], scene.plants.rate_hz)
    slopes = -(by_controller[:, form.owners] * log_slopes).real / sigma[:, :1]
    if not closed.stable.all():  # a step to an unstable loop violates every constraint
        margin_db = margin_db - 60
    return margin_db, -20 / np.log(10) * slopes


def design_robust(estimate: Plants, draws: Plants | None, first_mode_hz: float, delay: int) -> Cascade:
    """Design a controller that is within the limit on the estimate and on 95 % of D posterior samples.

    draws: D times as many plants as the estimate, or None.  FitError if there is no such controller.
    """
    limit_db, Q, scene = LIMIT_DB, len(estimate), Scene.of(estimate)
    fine = Scene.of(estimate, lines=600, per_mode=41)
    scene_of_draws = None if draws is None else Scene.of(draws, lines=120, per_mode=9)

    def excess(cascade: Cascade) -> float:
        """Return the excess over the limit, dB, of the estimate's peak or the 95 % quantile of the samples' peaks."""
        peaks = [float(cascade.on(fine).peaks_db.max())]
        if scene_of_draws is not None:
            of_draws = cascade.on(scene_of_draws).peaks_db.reshape(-1, Q).max(axis=1)
            peaks.append(float(np.quantile(of_draws, 0.95, method="higher")))
        return max(peaks) - LIMIT_DB

    candidates: list[Cascade] = []
    for i in range(3):  # the limit of each design is lowered by the excess of the samples
        better = [tune_gains(scene, candidates[-1], limit_db)] if i else design(scene, first_mode_hz, delay, limit_db)
        candidates += filter(None, better)
        if (excess_db := excess(candidates[-1])) <= 0:
            break
        limit_db -= min(excess_db + 0.01, 1.5)
    # The reduction of gains may cost one candidate half of its bandwidth, and another none.
    safe = [*filter(None, (slow_down(start, lambda cascade: excess(cascade) <= 0) for start in candidates))]
    if not safe:
        raise FitError("use/gains", "no gains keep the sensitivity below 6 dB for 95 % of the posterior samples")
    return max(safe, key=lambda cascade: cascade.reached(scene))
