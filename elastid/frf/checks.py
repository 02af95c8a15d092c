r"""Checks of the records of an estimate: consistency, independent inputs, scatter, and hits of a hammer.

The weakest combination of inputs, relative to their noise S = diag(sigma_u), must exceed `MIN_SNR`:

.. math:: \lambda_{min}(S^{-1} U U^H S^{-1}) / E > 4

Dividing by it biases G by a fraction exp(-power / noise), 2 % at this limit.

The input of a record without a period is the force of a hammer if it differs from its median in few samples only.
Pulses are runs of samples above a tenth of the largest deviation; two pulses within 0.15 s are a double hit.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import starmap

import numpy as np

from elastid.base.arrays import BoolArray, FloatArray, IntArray, true_runs
from elastid.base.errors import DataError, Note
from elastid.base.matrices import inverse, singular_values, squared_magnitude
from elastid.frf.experiment_blocks import Block, MeanSpectra
from elastid.frf.lines import MIN_SNR, smoothed_noise
from elastid.record import Record
from elastid.response import Response

# Thresholds of the checks.
CLOCK_DIFFERENCE = 1e-4  # relative difference of sampling rates, up to which logs have the same lines
MIN_POWER_RATIO = 1e-12  # of the weakest to the strongest combination of inputs, by rounding errors
MAX_ERROR_RATIO = 4.0  # error power of a record relative to the others, median over lines; 2.0 in 44 clean sets
MAX_SCATTER = 0.3  # std of the mean over realisations relative to |G|, median over elements and lines
MIN_TIMES_NOISE = 10.0  # ratio of this std to the noise of the periods, below which noise or friction can cause it
REPEAT_DIFFERENCE = 0.2  # relative difference of two inputs, below which they are repeats
PHASE_LINES = 64  # number of evenly spaced lines for the comparison of phases
PULSE_START = 0.1  # sample at which a pulse begins, relative to the largest one
PULSE_FRACTION = 0.02  # largest fraction of samples in pulses for a hammer's force
PULSE_SAMPLES = 20_000  # number of evenly spaced samples of the first test
BOUNCE_S = 0.15  # longest time between the pulses of a double hit
CLIPPED_RUN = 3  # least number of successive samples at the limit of an overloaded channel


def check_consistency(records: Sequence[Record]) -> None:
    """Raise DataError without records, or if the records of a configuration are inconsistent."""
    if isinstance(records, Record):
        raise TypeError("records is a single Record. Give a sequence, such as [record]")
    if not records:
        raise DataError("frf/records", "there is no record. Measure at least one experiment")
    first = records[0]
    names = ["is_periodic", "rate_hz", "half_wave", "hold", "hold_samples", "sampled", "inputs", "outputs"]
    # Without a period each record has its own length.
    names += ["quantities", "period_samples"] if first.is_periodic else ["quantities"]
    for record in records:
        pairs = {name: (getattr(first, name), getattr(record, name)) for name in names}
        pairs["angles"] = tuple(first.configuration.angles), tuple(record.configuration.angles)
        for name, (a, b) in pairs.items():
            is_same = abs(a - b) <= CLOCK_DIFFERENCE * a if name == "rate_hz" else a == b
            if not is_same:
                raise DataError(
                    "frf/records",
                    f"records {first.name} and {record.name} of configuration {first.configuration.name} are "
                    f"inconsistent: {name} is {a} and {b}. Make two configurations of them",
                )


def check_number_of_periods(groups: Sequence[Sequence[Record]], method: str) -> None:
    """Raise DataError if a record has fewer than two periods, or there are fewer experiments than inputs.

    groups: records by realisation.  `arithmetic` needs as many experiments as inputs in each realisation, other methods
    in all of them.
    """
    first = groups[0][0]
    n_u = len(first.inputs)
    short = [record.name for group in groups for record in group if record.n_samples < 2 * record.repeat_samples]
    if short:
        raise DataError(
            "frf/periods",
            f"records {', '.join(short)} of configuration {first.configuration.name} have one period; method {method} "
            "needs two. Measure more, or set estimator.method local_rational",
        )
    if method == "arithmetic":
        counts = {f"realisation {group[0].realisation}": len(group) for group in groups}
    else:
        counts = {"all realisations": sum(map(len, groups))}
    for realisation, count in counts.items():
        if count < n_u:
            raise DataError(
                "frf/inputs-not-separable",
                f"{count} experiments for {n_u} inputs ({', '.join(first.inputs)}); each realisation needs at least "
                f"{n_u} with independent inputs. Number them as its experiments 0, 1, ...",
                f"configuration {first.configuration.name}, {realisation}",
            )


def separable_lines(data: MeanSpectra, groups: Sequence[Sequence[Record]], method: str) -> BoolArray:
    """Flag lines (F,) with independent inputs, in each realisation for `arithmetic`, else in all; DataError if none."""
    if method == "arithmetic":
        return np.asarray(np.all(list(starmap(_separates_inputs, zip(data.blocks, groups, strict=True))), axis=0))
    block, R = data.all_experiments, data.all_experiments.R
    if method == "joint" and R is not None:  # U projected on the instruments, and its noise
        _, n_u, E = block.U.shape
        block = replace(block, U=block.U @ np.linalg.pinv(R) @ R, input_noise=MIN_SNR * n_u / E * block.input_noise)
    return _separates_inputs(block, groups[0])


def _separates_inputs(block: Block, group: Sequence[Record]) -> BoolArray:
    """Flag lines (F,) where every combination of the inputs exceeds the noise; DataError if none."""
    E = block.U.shape[2]
    squares = squared_magnitude(block.U).sum(axis=2) / E
    power = np.mean(squares, axis=0)
    power = np.where(power > 0, power, 1.0)
    noise = smoothed_noise(np.mean(1 / block.periods) * block.input_noise, block.dof)
    min_power = np.maximum(MIN_SNR * noise, MIN_POWER_RATIO * np.outer(squares @ (1 / power), power))
    min_power = np.maximum(min_power, np.finfo(float).tiny)
    is_separated = _has_small_inverse(block, min_power)
    ratio = singular_values(block.U[~is_separated] / np.sqrt(min_power[~is_separated])[:, :, None]) ** 2 / E
    is_separated[~is_separated] = ratio[:, -1] > 1
    if not is_separated.any():
        record = group[0]
        rank, n_u = int(np.median(np.sum(ratio > 1, axis=1))), len(record.inputs)
        raise DataError(
            "frf/inputs-not-separable",
            f"its {E} experiments excite the {n_u} inputs ({', '.join(record.inputs)}) in only {rank} independent "
            "ways above the noise. Check for a file listed twice, an input without excitation, and equal phases in "
            "all experiments",
            f"configuration {record.configuration.name}, realisation {record.realisation}",
        )
    return is_separated


def _has_small_inverse(block: Block, min_power: FloatArray) -> BoolArray:
    """Flag lines (F,) where the Frobenius norm of the inverse proves that the inputs are independent.

    sigma_n(A) >= 1 / |A^-1|, and the inverse is needed anyway.  min_power (F, n_u): unit of the squared inputs.
    """
    try:
        return np.asarray(np.einsum("feu,fu->f", squared_magnitude(block.W), min_power) * block.U.shape[2] < 1)
    except np.linalg.LinAlgError:
        return np.zeros(len(min_power), bool)


def repeated_phase_notes(blocks: Sequence[Block], groups: Sequence[Sequence[Record]]) -> list[Note]:
    """Return a note on each pair of realisations of the same excitation, which do not show nonlinear distortion."""
    notes = []
    for m in range(1, len(blocks)):
        a, b = (block.U[:: -(-len(block.U) // PHASE_LINES)] for block in (blocks[m - 1], blocks[m]))
        if a.shape == b.shape and np.linalg.norm(a - b) < REPEAT_DIFFERENCE * np.linalg.norm(a):
            text = (
                f"realisations {groups[m - 1][0].realisation} and {groups[m][0].realisation} have the same phases, so "
                "that the total variance lacks the nonlinear distortion. Choose new phases for every realisation"
            )
            notes.append(Note("frf/inputs-not-separable", text))
    return notes


def inconsistency_notes(data: MeanSpectra, groups: Sequence[Sequence[Record]]) -> list[Note]:
    r"""Return a note on the record that deviates most from the other realisations, for M >= 3 realisations.

    With G_m = sum_{j != m} Y_j U_j^H (sum_{j != m} U_j U_j^H)^-1 from K other experiments, the error D = Y - G_m U has
    1 + n_u / K times the noise variance for realisation m, and 1 - n_u / K times for the others. The ratio of both is
    compared at the median of lines and outputs. The error of the others is at least the noise of the periods, because
    a slow disturbance affects all lines of a record, and can be small in few records by chance.
    """
    blocks = data.blocks
    n_u, K = blocks[0].U.shape[1], sum(block.U.shape[2] for block in blocks[1:])
    if len(blocks) < 3 or n_u >= K or any(block.U.shape != blocks[0].U.shape for block in blocks):
        return []
    ratios = np.array([_relative_power(data, m) for m in range(len(blocks))])
    m, e = divmod(int(np.argmax(ratios)), ratios.shape[1])
    if ratios[m, e] < MAX_ERROR_RATIO:
        return []
    text = (
        f"it differs from the {len(blocks) - 1} other realisations of its configuration by "
        f"{math.sqrt(ratios[m, e]):.2g} times their scatter. Check that robot, load and channel gains were equal; "
        f"measure realisation {groups[m][e].realisation} again, or omit it"
    )
    return [Note("frf/records", text, f"record {groups[m][e].name}")]


def scatter_notes(response: Response) -> list[Note]:
    """Return a note if realisations scatter so much more than periods that they have different responses."""
    if response.total is None or response.noise is None:
        return []
    total, noise = (
        math.sqrt(float(np.median(c.variance / np.maximum(squared_magnitude(response.G), 1e-300))))
        for c in (response.total, response.noise)
    )
    if total < MAX_SCATTER or total < MIN_TIMES_NOISE * noise:
        return []
    text = (
        f"realisations differ by {total:.3g} |G|, {total / noise:.2g} times the noise of their periods. State `at` in "
        "experiment.recorded.files if hammer or sensors moved, else make a configuration of each state"
    )
    return [Note("frf/records", text)]


def _relative_power(data: MeanSpectra, m: int) -> FloatArray:
    """Return power of the experiments (E,) of block m relative to the other blocks."""
    blocks = data.blocks
    step = -(-len(blocks[0].U) // PHASE_LINES)
    other_blocks = [block for i, block in enumerate(blocks) if i != m]
    U, Y = (np.concatenate([getattr(block, Z)[::step] for block in other_blocks], axis=2) for Z in "UY")
    ratio = U.shape[1] / U.shape[2]
    G = Y @ U.mT.conj() @ inverse(U @ U.mT.conj())
    error = np.concatenate([np.broadcast_to(np.eye(Y.shape[1]), (len(Y), Y.shape[1], Y.shape[1])), -G], axis=2)
    noise = np.einsum("fai,fij,faj->fa", error, data.S_Z[::step], error.conj()).real
    noise /= data.dof * np.mean(data.periods)
    inside = np.maximum(np.mean(squared_magnitude(Y - G @ U), axis=2) / (1 - ratio), np.maximum(noise, 1e-300))
    outside = squared_magnitude(blocks[m].Y[::step] - G @ blocks[m].U[::step]) / (1 + ratio)
    return np.asarray(np.median(outside / inside[:, :, None], axis=(0, 1)))


def pulses(u: FloatArray) -> IntArray | None:
    """Return the first sample and the end (n, 2) of each pulse of a hammer's force u (N,); None for other inputs."""
    samples = u[:: -(-len(u) // PULSE_SAMPLES) or 1]
    middle = np.median(samples)
    largest = max(u.max(initial=0.0) - middle, middle - u.min(initial=0.0))
    if np.mean(np.abs(samples - middle) > PULSE_START * largest) > 2 * PULSE_FRACTION:
        return None
    x = np.abs(u - np.median(u))
    is_pulse = x > PULSE_START * x.max(initial=0.0)
    return true_runs(is_pulse) if 0 < is_pulse.mean() <= PULSE_FRACTION else None


def hit_notes(record: Record) -> Iterator[Note]:
    """Yield notes on double hits, truncated hits and overloads in a record without a period, for hammer inputs only."""
    place, rate_hz = f"configuration {record.configuration.name}, record {record.name}", record.rate_hz
    overloads = {}
    for name, u in zip(record.inputs, record.u.T, strict=True):
        if (edges := pulses(u)) is None:
            continue
        first, gap = edges[:, 0], np.diff(edges[:, 0]) / rate_hz
        if len(bounces := np.flatnonzero(gap < BOUNCE_S)):
            i, total = bounces[0], len(first) - len(bounces)
            text = (
                f"{len(bounces)} of {total} hits of {name} are double hits, the first at {first[i] / rate_hz:.4g} s "
                f"({1000 * gap[i]:.3g} ms apart). Exclude these hits, or use a lighter hammer"
            )
            yield Note("frf/hits", text, place)
        if first[0] == 0 or edges[-1, 1] == len(u):
            text = (
                f"it begins or ends within a hit of {name}, which truncates force or response. Set a pretrigger of "
                "some milliseconds, and record until the response has decayed"
            )
            yield Note("frf/hits", text, place)
        overloads[name] = len(true_runs(np.abs(u) == np.abs(u).max(), CLIPPED_RUN))
    for name, y in zip(record.outputs, record.y.T, strict=True):
        ends = (y.max(), y.min()) if overloads and np.ptp(y) > 0 else ()
        visits = sum(len(true_runs(y == end, CLIPPED_RUN)) for end in ends)
        overloads |= {name: visits} if visits > 1 else {}  # a single run can be zero motion
    if names := [f"{name} ({count} times)" for name, count in overloads.items() if count]:
        text = (
            f"overloaded at {', '.join(names)}, which biases magnitude and damping. Hit more softly, or choose a "
            "wider range"
        )
        yield Note("frf/overload", text, place)
