r"""Outliers: one to three samples that the other periods contradict (Hampel identifier across periods).

.. math:: e = x_p - x_{p+1},\; x_p - x_{p+2},\; x_p - \operatorname{median}_q x_q, \qquad
          d = |e - \text{running median of } e| > 6 \sigma, \qquad
          \sigma^2 = (d_{75\,\%} / 1.15)^2 + q^2 / 12

for each e, in which a transient is smooth, and for each period (Davies and Gather, J. Am. Stat. Assoc. 88, 1993).  q:
step of the converter.  A spike must also satisfy three conditions.  Its distance from the parabola through its
neighbours is five times the distance of three quarters of them.  Its d is five times the d of these neighbours, and
three times the d of 90 % of the samples in most parts of the log.  These conditions exclude drift, transients, steps,
bursts of oscillation, and the pulses of a controller at encoder counts.  A value that repeats the previous value
exactly, or is exactly 0, is a lost message if such values are more frequent than by chance, or if one e differs.  A
sample is replaced only if its distance from the interpolation exceeds four times the interpolation error.  Lost
messages below this limit are replaced together if that error does not explain their median distance.  If quantisation
repeats values by chance, lost messages are detected only as spikes.  Interpolated samples are never tested.  With three
periods, equal spikes at one phase of two periods outvote the third period if they are below the roughness of the
signal; a note counts them.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from elastid.base.arrays import BoolArray, FloatArray, IntArray, true_runs
from elastid.logs.repair import LogReport, blocks, detrend_repetitions, interpolate_linearly
from elastid.logs.repair.interpolation import MAX_BRIDGED, QUIET_FRACTION, QUIET_STD, interpolations, period_noise
from elastid.logs.repair.masks import MASKED, MAX_FRACTION, MIN_OVER_USUAL, step

OUTVOTED = "spikes by two periods against one"
# Limits that distinguish a spike from a signal, its noise, its steps and its transients.
MIN_SIGMAS = 6.0
MIN_RATIO = 5.0  # distance of a spike over that of its neighbours, at least
MIN_ERRORS = 4.0  # distance of a spike or lost message from its interpolation, over the error of that
# Median of squared distances of k lost messages over squared errors of their interpolations, less 0.91 (equal errors),
# times sqrt(k).
MIN_EXCESS = 8.0
MAX_BY_CHANCE = 0.01  # repeated values, or zeros, in a channel
MIN_OVER_CHANCE = 3.0  # number of them over the number by chance plus two, from which most are lost messages
MIN_PERIODS = 3
# Samples of the longest spike, of the neighbours on each side, and of the running median.
MAX_RUN = 3
NEIGHBOURS = 2 * MAX_RUN
MEDIAN_WINDOW = 2 * NEIGHBOURS - 1
# Quantile of the change from period to period that distinguishes transients; least pulse in a transient, relative to
# the largest step that repeats.
TRANSIENT_FRACTION, JUMP_MARGIN = 0.95, 1.2
# Typical distance: median over SECTIONS of the log of the quantile USUAL_FRACTION.
USUAL_FRACTION, SECTIONS = 0.9, 20
ROUNDS = 8  # iterations: large spikes are replaced before smaller spikes next to them are tested


def without_spikes(signals: FloatArray, L: int, sign: int, log: LogReport) -> FloatArray:
    """Mask (NaN) the spikes of signals (n, c), some samples NaN, in the channels that the log names.

    Nothing changes for fewer than three repetitions of L samples.
    """
    P = len(signals) // L
    if MIN_PERIODS > P:
        return signals
    channels = signals[: P * L, : len(log.names)].T
    spikes = [_spikes_of_periods(x, L, sign) for x in channels]
    pairs = zip(channels, spikes, strict=True) if P == MIN_PERIODS else ()
    n_votes = [int(np.sum(_roughness(interpolate_linearly(x))[at] <= 1)) for x, at in pairs]
    return _mask(signals, spikes, "the other periods", log, n_votes)


def without_lone_spikes(signals: FloatArray, log: LogReport, are_motions: Sequence[bool] = ()) -> FloatArray:
    """Mask (NaN) the spikes of signals (n, c), finite and without a period, among their neighbours.

    are_motions (c,): positions, whose spikes leap by more than three times the step that 99 % of the rows stay below.
    """
    everywhere = np.ones(len(signals), np.bool_)
    at = []
    for x, is_motion in zip(signals.T, are_motions or [False] * signals.shape[1], strict=True):
        min_jump = MIN_OVER_USUAL * float(np.quantile(np.abs(np.diff(x)), 0.99)) if is_motion else 0.0
        # Without a period, a step that swings is no spike: all neighbours are quieter.
        at.append(np.flatnonzero(_spikes(x, x, everywhere, len(x), min_jump, MAX_BRIDGED, step(x), quantile=1.0)))
    return _mask(signals, at, "their neighbours", log)


def outlier_count_text(name: str, count: int, n: int) -> str:
    """Return the number of outliers among n samples of a channel, in words."""
    return f"{name}: {count} of {n} samples are outliers"


def _mask(
    signals: FloatArray, spikes: Sequence[IntArray], reference: str, log: LogReport, n_votes: Sequence[int] = ()
) -> FloatArray:
    """Mask and report spikes. n_votes (c,): number of spikes that only two periods against one show."""
    result = np.copy(signals)
    for c, at in enumerate(spikes):
        if at.size == 0:
            continue
        test = f"(Hampel test against {reference}, limit {MIN_SIGMAS:g} std)"
        text = f"{outlier_count_text(log.names[c], at.size, len(signals))} {test}"
        if at.size >= MAX_FRACTION * len(signals):
            log.report("spikes left", at.size, f"{text}, which is too many. They are left unchanged")
            continue
        result[at, c] = np.nan
        log.report(MASKED, at.size, f"{text} and are interpolated. The first is {log.time_of(at[0])}")
        if any(n_votes[c : c + 1]):
            text = f"{log.names[c]}: {n_votes[c]} spikes are no rougher than the signal, so that equal disturbances of"
            text += " the two other periods have the same effect. Measure four periods or more"
            log.report(OUTVOTED, n_votes[c], text)
    return result


def _spikes_of_periods(x: FloatArray, L: int, sign: int) -> IntArray:
    """Find samples (k,) of the lost messages and spikes of a signal (P L,), NaN where missing."""
    has_value, full, q = np.isfinite(x), _interpolate(x, L, sign), step(x)
    is_lost, may_be_lost = _lost_messages(x, q)
    is_spike = np.zeros(len(x), np.bool_)
    if is_lost.any():
        to_nearest = np.min([_lone_distance(e) for e in _differences(full, L, sign)], axis=0)
        full, is_spike = _replace(full, is_lost, L, sign, to_nearest, are_lost=True)
    for _ in range(ROUNDS):
        # A sample that is off by no more than periods are from each other adds nothing to their scatter.
        noise = period_noise(full, L, sign)
        in_all, in_any = np.ones(len(x), np.bool_), np.zeros(len(x), np.bool_)
        for e in _differences(full, L, sign):
            if in_all.any() or may_be_lost.any():
                new_spikes = _spikes(x, e, has_value & ~is_spike, L, noise, MAX_RUN, q)
                in_all, in_any = in_all & new_spikes, in_any | new_spikes
        candidates = in_all | (may_be_lost & in_any)
        if not candidates.any():
            break
        is_rough = _roughest(full, candidates, has_value & ~is_spike, L)
        is_rough[:L] &= _lone_distance(full[:L]) >= _transient_pulse(full, L, sign, q)
        if not is_rough.any():
            break
        full, is_new = _replace(full, is_rough, L, sign, np.full(len(full), np.inf))
        has_value &= ~is_rough
        is_spike |= is_new
    return np.flatnonzero(is_spike)


def _replace(
    x: FloatArray, suspects: BoolArray, L: int, sign: int, to_nearest: FloatArray, are_lost: bool = False
) -> tuple[FloatArray, BoolArray]:
    """Interpolate suspects (P L,) of a signal (P L,) that are far from their interpolation; return their flags, too.

    to_nearest (P L,): distance to the nearest of the other periods. Where it is less than half of the distance from
    the interpolation, another period has the spike.  are_lost: suspects close to their interpolations are replaced
    together if their median distance is larger than errors of the interpolation explain.
    """
    result, is_replaced = np.copy(x), np.zeros(len(x), np.bool_)
    near = []
    for at, gap in interpolations(np.where(suspects, np.nan, x), L, sign):
        if gap is None:
            continue
        distance = np.abs(x[at] - gap.values).max()
        if MIN_ERRORS * gap.error < distance < 2 * to_nearest[at].max():
            result[at], is_replaced[at] = gap.values, True
        elif distance < 2 * MIN_ERRORS * gap.error and at.stop - at.start <= MAX_RUN:
            near.append((at, gap.values, distance / gap.error))
    # Normal errors d of lost messages and e of interpolations: the median is 0.45 (d^2 + e^2) / e^2.
    squares = [ratio**2 for *_, ratio in near if ratio <= MIN_ERRORS]
    if are_lost and squares and np.median(squares) > 0.91 + MIN_EXCESS / np.sqrt(len(squares)):
        for at, values, _ in near:
            result[at], is_replaced[at] = values, True
    return result, is_replaced


def _differences(x: FloatArray, L: int, sign: int) -> list[FloatArray]:
    """Compute differences (P L,) of each period to the next two, and, of more than three, to the median of all.

    A spike differs from each of them; a sample whose reference has a spike does not.
    """
    X = detrend_repetitions(x, L, sign)
    references = [np.roll(X, -1, axis=0), np.roll(X, -2, axis=0)]
    if len(X) > MIN_PERIODS:
        references.append(np.broadcast_to(np.median(X, axis=0), X.shape))
    return [(X - reference).ravel() for reference in references]


def _transient_pulse(x: FloatArray, L: int, sign: int, q: float) -> float:
    """Estimate the size of pulses of a transient in the first period of a signal (P L,); 0 without a transient.

    The largest step that all later periods show: there a transient has friction of the other direction for a moment.
    """
    from scipy.ndimage import median_filter

    X = blocks(x, L, sign)
    first, *later = np.quantile(np.abs(np.diff(X, axis=0)), TRANSIENT_FRACTION, axis=1)
    if first <= MIN_OVER_USUAL * max(min(later), q):
        return 0.0
    return JUMP_MARGIN * float(np.abs(np.diff(median_filter(X[1:], (1, 2 * MAX_RUN + 1)), axis=1)).min(axis=0).max())


def _roughest(x: FloatArray, candidates: BoolArray, is_tested: BoolArray, L: int) -> BoolArray:
    """Select the roughest candidate (P L,) at each phase of a signal, and all others that are rough.

    Of three periods, two with spikes also flag the third. Two different spikes are not references of each other. If
    other periods are far rougher at this phase, they contain the spikes.
    """
    from scipy.ndimage import maximum_filter

    roughness = _roughness(x).reshape(-1, L)
    highest = np.where(candidates.reshape(-1, L), roughness, -1.0).max(axis=0)
    rivals = roughness > np.maximum(2 * highest, 1)
    rivals &= highest >= 0
    # A signal is also rough next to a spike: such a phase is tested after the spike is replaced.
    are_highest = rivals & (roughness == maximum_filter(roughness, (1, len(_CUBIC))))
    is_rough = candidates.reshape(-1, L) & (roughness > 1)
    is_chosen = np.where(rivals.any(axis=0), are_highest, (roughness == highest) | is_rough)
    return np.asarray(is_chosen.ravel() & is_tested)


def _roughness(x: FloatArray) -> FloatArray:
    """Compute the distance (n,) of each sample from a cubic through its neighbours, relative to the limit of spikes."""
    away = np.abs(np.convolve(np.pad(x, 2, mode="reflect", reflect_type="odd"), _CUBIC, mode="valid"))
    return away / max(MIN_RATIO * float(np.quantile(away, QUIET_FRACTION)), 1e-300)


def _lone_distance(e: FloatArray) -> FloatArray:
    """Compute the distance (n,) of each sample of a signal from its running median."""
    from scipy.ndimage import median_filter

    return np.asarray(np.abs(e - median_filter(e, MEDIAN_WINDOW, mode="mirror")))


def _interpolate(x: FloatArray, L: int, sign: int) -> FloatArray:
    """Interpolate a signal (P L,); linearly if no period has a sample at this phase."""
    result = np.copy(x)
    for at, gap in interpolations(x, L, sign):
        result[at] = np.nan if gap is None else gap.values
    return interpolate_linearly(result)


def _spikes(
    x: FloatArray, e: FloatArray, is_tested: BoolArray, L: int, min_distance: float, max_run: int, q: float,
    quantile: float = QUIET_FRACTION,
) -> BoolArray:  # fmt: skip
    """Flag (n,) the spikes of up to max_run samples of a signal x (n,) where is_tested (n,).

    e (n,): finite difference of x to a reference, with a separate noise std for each period of L.  min_distance: least
    distance of a spike.  q: step of the converter.  quantile: of the neighbours' distances; larger distances can be
    spikes.
    """
    from scipy.ndimage import maximum_filter

    n, d = NEIGHBOURS, _lone_distance(e)
    sigma = np.hypot(np.quantile(d.reshape(-1, L), QUIET_FRACTION, axis=1) / QUIET_STD, q / np.sqrt(12)).repeat(L)
    rounding = 1e-7 * float(np.nanmax(x) - np.nanmin(x))  # by single precision or nine digits in a text
    threshold = np.maximum(MIN_SIGMAS * sigma, max(rounding, min_distance))
    if not np.any(d > threshold):
        return np.zeros(len(e), np.bool_)
    # A spike changes the running median next to it, but little if e is smooth.
    beside = maximum_filter(d, MEDIAN_WINDOW) / MIN_RATIO
    short = [(a, b) for a, b in true_runs(d > np.maximum(threshold, beside)).tolist() if b - a <= max_run]
    is_spike = np.zeros(len(e), np.bool_)
    sections = d[: len(d) // SECTIONS * SECTIONS].reshape(SECTIONS, -1)
    usual_distance = float(np.median(np.quantile(sections, USUAL_FRACTION, axis=1)))
    straight = np.copy(e)
    for first, end in short:
        straight[first:end] = np.nan
    straight = interpolate_linearly(straight)
    for first, end in short:
        # Near an end, a spike and a curvature are indistinguishable.
        if not is_tested[first:end].any() or first <= n or end >= len(e) - n:
            continue
        sides = np.r_[max(0, first - 2 * n) : first - 1, end + 1 : min(len(e), end + 1 + 2 * n)]
        around = np.quantile(d[sides], quantile)
        distance, scatter = _parabola_distance(e, straight, first, end, quantile)
        is_lone = d[first:end].max() > max(MIN_RATIO * around, MIN_OVER_USUAL * usual_distance)
        if is_lone and distance > max(threshold[first], MIN_RATIO * scatter):
            is_spike[first:end] = True
    return is_spike & is_tested


def _lost_messages(x: FloatArray, q: float) -> tuple[BoolArray, BoolArray]:
    """Flag (n,) repeated values and zeros: those more frequent than by chance with steps of q, and all rare ones."""
    change = np.diff(x, prepend=np.nan)
    scale, repeats, is_rare = float(np.nanmedian(np.abs(change))), *np.zeros((2, len(x)), np.bool_)
    for distance, n_equal in ((np.abs(change), _repeats_in_motion(change, q)), (np.abs(x), np.sum(x == 0))):
        is_equal = distance == 0
        if is_equal.mean() < MAX_FRACTION:
            is_rare |= is_equal
            # While it sticks, a joint repeats values more often: half as often as it moves by a step.
            n_near, n_single = np.sum((distance > 0) & (distance <= scale)), np.sum(np.abs(distance - q) < q / 2)
            by_chance = max(n_near * q / max(2 * scale, 1e-300), n_single / 2)
            if by_chance < MAX_BY_CHANCE or n_equal > MIN_OVER_CHANCE * (by_chance + 2):
                repeats |= is_equal
    return repeats, is_rare


def _repeats_in_motion(change: FloatArray, q: float) -> int:
    """Count the repeated values between two changes (n,) of at least 2 q in one direction, where no joint sticks."""
    at = np.flatnonzero(change)
    before, after = change[at[:-1]], change[at[1:]]
    return int(np.sum((np.diff(at) - 1)[np.minimum(before * np.sign(after), np.abs(after)) >= 2 * q]))


def _parabola_distance(e: FloatArray, beside: FloatArray, first: int, end: int, quantile: float) -> tuple[float, float]:
    """Compute the largest distance of a run of e (n,) from its neighbours' parabola, and a quantile of theirs."""
    n = NEIGHBOURS
    sides = np.r_[first - 1 - n : first - 1, end + 1 : end + 1 + n]
    away = np.abs(np.r_[beside[sides], e[first:end]] - _PARABOLAS[end - first] @ beside[sides])
    return float(away[len(sides) :].max()), float(np.quantile(away[: len(sides)], quantile))


def _parabola(length: int) -> FloatArray:
    """Compute weights (2 n + length, 2 n) of the parabola by n neighbours on each side of a run, at these and in it."""
    n = NEIGHBOURS
    sides = np.r_[-1 - n : -1, length + 1 : length + 1 + n]
    powers = np.vander((np.r_[sides, 0:length] - (length - 1) / 2) / n, 3)
    return powers @ np.linalg.pinv(powers[: len(sides)])


# Difference of a sample to the cubic through two neighbours on each side.
_CUBIC = np.array([1, -4, 6, -4, 1]) / 6
_PARABOLAS = {length: _parabola(length) for length in range(1, MAX_RUN + 1)}
