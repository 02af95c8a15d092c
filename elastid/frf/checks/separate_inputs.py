r"""Inputs that the experiments separate, line by line: elsewhere outputs cannot be traced to inputs.

The weakest combination of inputs, each relative to its RMS, must stand out of its noise by `MIN_SNR`:

.. math:: \lambda_{min}(U U^H) / E > 4\, \sigma_u^2

Dividing by it biases G by a part exp(-power / noise): 2 % where it stands out least.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from elastid.base.arrays import BoolArray, FloatArray, IntArray
from elastid.base.errors import DataError
from elastid.base.note import Note
from elastid.frf.experiment_blocks import Block, pooled
from elastid.frf.lines import MIN_SNR, described_lines, smoothed_noise
from elastid.frf.matrices import squared_magnitude
from elastid.frf.methods import AVERAGED
from elastid.record import Record

# Power of the weakest over the strongest combination of inputs, below which rounding decides.
_MIN_POWER_RATIO = 1e-12
# Realisations whose inputs differ by less than this part have the same phases.
_SAME_PHASES_DIFFERENCE = 0.2
# So many lines, evenly taken, show that as well as all.
_MAX_LINES = 1000


def separated_lines(blocks: Sequence[Block], groups: Sequence[Sequence[Record]], method: str) -> BoolArray:
    """Flags (F,) of the lines with separate inputs: in every realisation if each gives a response, else in all of them.

    Raises DataError where there is no such line.
    """
    if method in AVERAGED:
        return np.asarray(np.all([_separated(*each) for each in zip(blocks, groups, strict=True)], axis=0))
    return _separated(pooled(blocks), groups[0])


def _separated(block: Block, group: Sequence[Record]) -> BoolArray:
    """Flags (F,) of the lines where every combination of the inputs stands out of the noise; DataError without any."""
    rms, (_, n_u, E) = block.input_rms, block.U.shape
    of_mean = block.input_noise * np.mean(1 / block.periods)
    noise = MIN_SNR * smoothed_noise((of_mean / rms**2).max(axis=1), block.dof)
    total = squared_magnitude(block.U).sum(axis=2) @ (1 / (E * rms**2))
    least = np.maximum(noise, _MIN_POWER_RATIO * total)
    # Most lines pass by the bound 1 / tr(S_U^-1) <= lambda_min, which costs no eigenvalue.
    separated = _weakest_at_least(block, least)
    doubtful = np.flatnonzero(~separated)
    U = block.U[doubtful]
    power = np.linalg.eigvalsh(U @ np.swapaxes(U, 1, 2).conj() / (E * np.outer(rms, rms)))
    separated[doubtful] = power[:, 0] > least[doubtful]
    if not separated.any():
        record = group[0]
        ways = int(np.median(np.sum(power > least[:, None], axis=1)))
        raise DataError(
            f"configuration {record.configuration.name}, realisation {record.realisation}: its {E} experiments move "
            f"the {n_u} inputs ({', '.join(record.inputs)}) in {ways} independent ways only, above the noise; "
            "check for a file listed twice, an input that was not excited, and equal phases in all experiments"
        )
    return separated


def _weakest_at_least(block: Block, least: FloatArray) -> BoolArray:
    """Flags (F,) of the lines where 1 / tr(S_U^-1) exceeds the least power; none where some matrix has no inverse."""
    try:
        E, n_u = block.W.shape[1:]
        trace = E * (squared_magnitude(block.W).reshape(-1, E * n_u) @ np.tile(block.input_rms**2, E))
    except np.linalg.LinAlgError:
        return np.zeros(len(least), dtype=np.bool_)
    return np.asarray(least * trace < 1)


def left_out_note(lines: IntArray, some_are_left: np.bool_, record: Record) -> Note:
    """A note on the lines (F,) without separate inputs; DataError where no other line is left."""
    names = f"lines {described_lines(lines, record)}"
    if not some_are_left:
        raise DataError(
            f"configuration {record.configuration.name}: no line has separate inputs in every realisation: {names} are "
            "lost in one or another; measure the weak realisations again"
        )
    return Note(
        "lines-left-out",
        f"{names} are left out: some combination of the inputs is less than 6 dB above its noise there, so that "
        "outputs cannot be traced to inputs",
    )


def same_phases_notes(blocks: Sequence[Block], groups: Sequence[Sequence[Record]]) -> list[Note]:
    """A note on each pair of realisations that were excited alike and so do not show nonlinear distortion."""
    notes = []
    for m in range(1, len(blocks)):
        a, b = (each.U[:: -(-len(each.U) // _MAX_LINES)] for each in (blocks[m - 1], blocks[m]))
        if a.shape == b.shape and np.linalg.norm(a - b) < _SAME_PHASES_DIFFERENCE * np.linalg.norm(a):
            notes.append(
                Note(
                    "same-phases",
                    f"realisations {groups[m - 1][0].realisation} and {groups[m][0].realisation} have the same phases, "
                    "so the total variance misses the nonlinear distortion; draw new phases for every realisation",
                )
            )
    return notes
