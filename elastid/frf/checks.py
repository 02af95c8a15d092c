r"""Checks of records around an estimate: they fit together, inputs are separate, channels are not exchanged.

The weakest combination of inputs, each relative to its noise S = diag(sigma_u), must stand out by `MIN_SNR`:

.. math:: \lambda_{min}(S^{-1} U U^H S^{-1}) / E > 4

Dividing by it biases G by a part exp(-power / noise): 2 % where it stands out least.

Exchange: the relative gain array does not change with scale or sign of a channel (Bristol, IEEE Trans. Automatic
Control 11, 1966), and above the resonances, where G tends to the inverse of a positive definite inertia, its diagonal
is 1 or more:

.. math:: \Lambda = G \circ G^{-T}

Sign: a motor of a passive mechanism takes up power, Re(velocity / torque) >= 0 at every line.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray
from elastid.base.errors import DataError, Note
from elastid.frf.experiment_blocks import Block, MeanSpectra
from elastid.frf.lines import MIN_SNR, smoothed_noise
from elastid.frf.matrices import adjoint, inverse, squared_magnitude
from elastid.record import MOTION_ORDER, Record
from elastid.response import Response


@dataclass(frozen=True)
class Limits:
    """Thresholds of the checks."""

    clock_difference: float = 1e-4  # of logs, relative, up to which their lines are the same ones
    power_ratio: float = 1e-12  # of the weakest to the strongest combination of inputs, below which rounding decides
    # Power of a record's errors over that of the others, at the median line; 2.0 at most in 44 clean sets.
    unlike: float = 4.0
    difference: float = 0.2  # of the inputs of two records, relative, below which they are repeats of each other
    lines: int = 300  # evenly taken, that show phases and signs as well as all
    highest_share: float = 1 / 3  # of the lines, from the highest down, that is above the resonances
    relative_gain: float = 0.7  # of each element that an exchange of channels puts on the diagonal, at least
    mean_gain: float = 0.5  # of these elements by the exchange, in the mean, at least
    sigmas: float = 2.0  # by which a real part differs from zero to count
    passive_lines: int = 3  # more with the other sign, at least, for a sign to be wrong


LIMITS = Limits()


def refuse_mismatch(records: Sequence[Record]) -> None:
    """DataError where the records of a configuration do not fit together, or there are none."""
    if isinstance(records, Record):
        raise TypeError("records is a single Record; give a sequence of them, such as [record]")
    if not records:
        raise DataError(
            "frf/records", "there is no record to estimate a response from; measure at least one experiment"
        )
    first = records[0]
    for record in records:
        if not np.array_equal(record.configuration.angles, first.configuration.angles):
            raise DataError(
                "frf/records",
                f"the records are of configurations {first.configuration.name} and {record.configuration.name}, at "
                f"different angles; take those of one at a time",
            )
    for record in records:
        names = ["is_periodic", "rate_hz", "half_wave", "hold", "hold_samples", "sampled"]
        names += ["inputs", "outputs", "quantities"]
        # Without a period each record has its own length.
        for name in [*names, "period_samples"] if first.is_periodic else names:
            a, b = getattr(first, name), getattr(record, name)
            is_same = abs(a - b) <= LIMITS.clock_difference * a if name == "rate_hz" else a == b
            if not is_same:
                raise DataError(
                    "frf/records",
                    f"records {first.name} and {record.name} of configuration {first.configuration.name} do not fit "
                    f"together: {name} is {a} and {b}; make two configurations of them",
                )


def refuse_few(groups: Sequence[Sequence[Record]], method: str) -> None:
    """DataError where a record holds less than two periods, which leave no noise level, or experiments are too few.

    groups: the records by realisation, each of which needs as many as there are inputs, but for a method that pools.
    """
    first = groups[0][0]
    n_u = len(first.inputs)
    short = [record.name for group in groups for record in group if record.n_samples < 2 * record.repeat_samples]
    if short:
        raise DataError(
            "frf/periods",
            f"records {', '.join(short)} of configuration {first.configuration.name} hold one period, method "
            f"{method} needs two; measure more, or take estimator.method local_rational",
        )
    if method == "arithmetic":
        counts = {f"realisation {group[0].realisation}": len(group) for group in groups}
    else:
        counts = {"all realisations": sum(map(len, groups))}
    for realisation, count in counts.items():
        if count < n_u:
            raise DataError(
                "frf/inputs-together",
                f"{count} experiments for "
                f"{n_u} inputs ({', '.join(first.inputs)}); each realisation needs at least {n_u} that move the inputs "
                "in different ways (number them as its experiments 0, 1, ...)",
                f"configuration {first.configuration.name}, {realisation}",
            )


def separated_lines(data: MeanSpectra, groups: Sequence[Sequence[Record]], method: str) -> BoolArray:
    """Flags (F,) of lines with separate inputs, in each realisation if averaged, else in all; DataError without any."""
    if method == "arithmetic":
        return np.asarray(np.all([_separated(*pair) for pair in zip(data.blocks, groups, strict=True)], axis=0))
    return _separated(data.every, groups[0])


def _separated(block: Block, group: Sequence[Record]) -> BoolArray:
    """Flags (F,) of the lines where every combination of the inputs stands out of the noise; DataError without any."""
    E = block.U.shape[2]
    squares = squared_magnitude(block.U)
    power = np.mean(squares, axis=(0, 2))
    power = np.where(power > 0, power, 1.0)
    total = squares.sum(axis=2) @ (1 / (E * power))
    noise = [smoothed_noise(of_input, block.dof) for of_input in np.mean(1 / block.periods) * block.input_noise.T]
    least = np.maximum(MIN_SNR * np.stack(noise, axis=1), LIMITS.power_ratio * np.outer(total, power))
    least = np.maximum(least, np.finfo(float).tiny)
    try:
        # Most lines pass by the bound 1 / tr(S_U^-1) <= lambda_min, which costs no eigenvalue.
        separated = np.asarray(E * np.einsum("feu,fu->f", squared_magnitude(block.W), least) < 1)
    except np.linalg.LinAlgError:
        separated = np.zeros(len(least), dtype=np.bool_)
    doubtful = np.flatnonzero(~separated)
    U = block.U[doubtful] / np.sqrt(least[doubtful])[:, :, None]
    ratio = np.linalg.eigvalsh(U @ adjoint(U) / E)
    separated[doubtful] = ratio[:, 0] > 1
    if not separated.any():
        record = group[0]
        ways, n_u = int(np.median(np.sum(ratio > 1, axis=1))), len(record.inputs)
        raise DataError(
            "frf/inputs-together",
            f"its {E} experiments move "
            f"the {n_u} inputs ({', '.join(record.inputs)}) in {ways} independent ways only, above the noise; "
            "check for a file listed twice, an input that was not excited, and equal phases in all experiments",
            f"configuration {record.configuration.name}, realisation {record.realisation}",
        )
    return separated


def same_phases_notes(blocks: Sequence[Block], groups: Sequence[Sequence[Record]]) -> list[Note]:
    """A note on each pair of realisations of the same excitation, which do not show nonlinear distortion."""
    notes = []
    for m in range(1, len(blocks)):
        a, b = (block.U[:: -(-len(block.U) // LIMITS.lines)] for block in (blocks[m - 1], blocks[m]))
        if a.shape == b.shape and np.linalg.norm(a - b) < LIMITS.difference * np.linalg.norm(a):
            text = (
                f"realisations {groups[m - 1][0].realisation} and {groups[m][0].realisation} have the same phases, "
                "so the total variance misses the nonlinear distortion; draw new phases for every realisation"
            )
            notes.append(Note("frf/inputs-together", text))
    return notes


def unlike_notes(blocks: Sequence[Block], groups: Sequence[Sequence[Record]]) -> list[Note]:
    r"""A note on a record whose realisation the others contradict, M >= 3 of them, by far more than each other.

    With G_m = sum_{j != m} Y_j U_j^H (sum_{j != m} U_j U_j^H)^-1 an experiment outside has the error D = Y - G_m U, of
    1 + n_u / K times the variance where those inside, K of them, have 1 - n_u / K; each element of D over that of
    those inside, at the median of lines and outputs.
    """
    n_u, K = blocks[0].U.shape[1], sum(block.U.shape[2] for block in blocks[1:])
    if len(blocks) < 3 or n_u >= K or any(block.U.shape != blocks[0].U.shape for block in blocks):
        return []
    ratios = np.array([_power_unlike(blocks, m) for m in range(len(blocks))])
    m, e = divmod(int(np.argmax(ratios)), ratios.shape[1])
    if ratios[m, e] < LIMITS.unlike:
        return []
    text = (
        f"it disagrees with the {len(blocks) - 1} other realisations of its configuration by "
        f"{math.sqrt(ratios[m, e]):.2g} times what these differ by: the same robot, load, gains of channels and angles "
        f"in all of them? Measure realisation {groups[m][e].realisation} again, or leave it out"
    )
    return [Note("frf/records", text, f"record {groups[m][e].name}")]


def _power_unlike(blocks: Sequence[Block], m: int) -> FloatArray:
    """Of the experiments (E,) of block m, over that of the others."""
    step = -(-len(blocks[0].U) // LIMITS.lines)
    others = [block for i, block in enumerate(blocks) if i != m]
    U, Y = (np.concatenate([getattr(block, Z)[::step] for block in others], axis=2) for Z in "UY")
    share = U.shape[1] / U.shape[2]
    G = Y @ adjoint(U) @ inverse(U @ adjoint(U))
    inside = np.maximum(np.mean(squared_magnitude(Y - G @ U), axis=2) / (1 - share), 1e-300)
    outside = squared_magnitude(blocks[m].Y[::step] - G @ blocks[m].U[::step]) / (1 + share)
    return np.asarray(np.median(outside / inside[:, :, None], axis=(0, 1)))


def channel_notes(response: Response) -> tuple[Note, ...]:
    """A note where outputs (or inputs) of motors look exchanged; else one on each motor whose sign looks wrong."""
    places = [name for name in response.inputs if name in response.outputs]
    exchanged = _exchanged(response, places) if len(places) > 1 else {}
    if not exchanged:
        return _sign_notes(response, places)
    pairs = ", ".join(f"y at {place} answers to u at {driven}" for place, driven in exchanged.items())
    text = (
        f"channels look exchanged between motors: at the highest lines {pairs}; check which channels are y (or u) "
        f"at {', '.join(exchanged)}"
    )
    return (Note("frf/exchanged-channels", text, f"configuration {response.configuration.name}"),)


def _exchanged(response: Response, places: list[str]) -> dict[str, str]:
    """Output place -> input place, for those of the places that another motor moves more than their own."""
    rows = [response.outputs.index(place) for place in places]
    columns = [response.inputs.index(place) for place in places]
    G = response.G[-max(1, round(LIMITS.highest_share * response.n_lines)) :][:, rows][:, :, columns]
    # Relative gains do not depend on scales; without this, units could make the matrix look singular.
    magnitude = np.maximum(np.sqrt(np.mean(np.abs(G) ** 2, axis=0)), 1e-150)
    of_rows = np.sqrt(np.mean(magnitude**2, axis=1))[:, None]
    G = G / (of_rows * np.sqrt(np.mean((magnitude / of_rows) ** 2, axis=0)))
    try:
        inverse_G = inverse(G)
    except np.linalg.LinAlgError:
        return {}
    if not np.max(np.linalg.norm(G, axis=(1, 2)) * np.linalg.norm(inverse_G, axis=(1, 2))) < 1 / np.finfo(float).eps:
        return {}
    Lambda = np.median((G * np.swapaxes(inverse_G, 1, 2)).real, axis=0)
    if np.array_equal(Lambda.argmax(axis=1), np.arange(len(places))):
        return {}
    from scipy.optimize import linear_sum_assignment  # slow to load, for the few responses that look exchanged

    _, best = linear_sum_assignment(-Lambda)
    on_best, moved = Lambda[np.arange(len(places)), best], best != np.arange(len(places))
    gain = (on_best - np.diag(Lambda))[moved]
    if not moved.any() or on_best[moved].min() < LIMITS.relative_gain or np.mean(gain) < LIMITS.mean_gain:
        return {}
    return {places[i]: places[j] for i, j in enumerate(best) if moved[i]}


def _sign_notes(response: Response, places: list[str]) -> tuple[Note, ...]:
    """A note on each motor whose own response contradicts a passive mechanism and with the other sign would not."""
    notes = []
    few = slice(None, None, -(-response.n_lines // LIMITS.lines))
    freq_hz, covariance = response.freq_hz[few], response.uncertainty
    j_omega, order = 2j * np.pi * freq_hz, MOTION_ORDER["velocity"] - MOTION_ORDER[response.quantity]
    for name in places:
        j, i = response.outputs.index(name), response.inputs.index(name)
        velocity = response.G[few, j, i] * j_omega**order
        variance = np.zeros(len(velocity)) if covariance is None else covariance.variance[few, j, i]
        # Half of the variance is in the real part.
        std = np.sqrt(variance / 2) * np.abs(j_omega) ** order
        as_is, _ = _passive_lines(freq_hz, velocity, std)
        turned, negative = _passive_lines(freq_hz, -velocity, std)
        if turned - as_is >= LIMITS.passive_lines and turned > 2 * as_is:
            text = (
                f"the sign of y or of u at {name} looks wrong: Re(velocity/torque) is negative beyond noise at "
                f"{negative} of {len(std)} lines, so the motor would be driven by its load; check sign, scale and "
                "gear ratio of its channels"
            )
            notes.append(Note("frf/wrong-sign", text, f"configuration {response.configuration.name}"))
    return tuple(notes)


def _passive_lines(freq_hz: FloatArray, velocity: ComplexArray, std: FloatArray) -> tuple[int, int]:
    """Passive lines less active ones, and passive ones, at the delay with most of the former.

    A line is passive where Re(velocity / torque) is positive beyond noise, and active where it is negative.
    """
    # Delays of up to half a turn of phase at the highest line are allowed for.
    phase = np.exp(2j * np.pi * np.outer(np.linspace(0.0, 0.5, 26), freq_hz / freq_hz[-1]))
    real = (velocity * phase).real
    positive, negative = (np.sum(sign * real > LIMITS.sigmas * std, axis=1) for sign in (1, -1))
    best = int(np.argmax(positive - negative))
    return int(positive[best] - negative[best]), int(positive[best])
