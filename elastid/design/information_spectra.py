"""The spectra that tell most about the parameters: powers shared out between the lines, for the criterion of a design.

Each configuration gets its own, all of them found together: what one tells well, another need not tell again. Before
configurations are chosen a typical spectrum, the best that several candidates can have in common, stands for all.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import StudyError
from elastid.design.choice import visible
from elastid.design.expected_response import Prospect
from elastid.design.optimal import DesignCriterion
from elastid.design.optimal_powers import best_powers, even_powers
from elastid.record import Configuration


def best_spectra(
    prospects: Sequence[Prospect],
    configurations: Sequence[Configuration],
    realisations: Sequence[int],
    cost: FloatArray,
    x: FloatArray,
    criterion: DesignCriterion,
    known: FloatArray,
    least: float,
    together: bool = False,
) -> FloatArray:
    """Amplitudes (Q, F, n_u) in Nm of Q configurations, or (1, F, n_u) where all have the same.

    prospects: how each of them will be measured.  cost (Q, n_o, F, n_u): what powers cost of the limits (`limits`).
    x (S, n_x): guesses.  known (S, n_x, n_x): information that is there already.  StudyError where fewer experiments
    than inputs are run.
    """
    first = prospects[0]
    E, n_u = first.R.shape[1], first.R.shape[3]
    if n_u > E:
        raise StudyError(
            f"excitation.flat: information needs as many experiments as motors, and there are {E} for {n_u}: with "
            "fewer the inputs are told apart by neighbouring lines, which must all be strong; take another flat, or "
            "leave experiment.experiments out"
        )
    each = zip(prospects, configurations, realisations, strict=True)
    sources = [[prospect.source(c, one, M) for one in x] for prospect, c, M in each]
    even = even_powers(cost)
    H = [[source.information(P) for source in sources_] for sources_, P in zip(sources, even, strict=True)]
    criterion, ground = visible(criterion, np.swapaxes(np.array(H), 0, 1), known, first.parameters)
    groups = [sources] if together else [[one] for one in sources]
    cost = cost.mean(axis=0, keepdims=True) if together else cost
    best = best_powers(groups, cost, criterion, known + ground, least)
    amplitude: FloatArray = np.sqrt(best.P / E)
    return amplitude
