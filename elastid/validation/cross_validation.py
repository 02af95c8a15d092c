"""Cross-validation: every configuration left out of a fit once, and how far the model of the others is off on it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from elastid.validation.agreement import Agreement
    from elastid.validation.compare import Refit

# A model that is this much worse on left-out configurations than on fitted ones does not carry over; below a tenth of
# a decibel no difference matters.
CARRIES_OVER, NO_MATTER_DB = 1.5, 0.1


def carries_over(left_out_db: float, fitted_db: float) -> bool:
    """Whether errors of that many dB on configurations left out and fitted are those of a model that carries over."""
    return left_out_db <= CARRIES_OVER * fitted_db + NO_MATTER_DB


@dataclass(frozen=True)
class Fold:
    """A configuration that the model of the others met: misfit (mean |E|^2 / sigma^2), dB rms, degrees rms.

    NaN where the fit without it failed; message then says why.
    """

    configuration: str
    misfit: float
    rms_log_db: float
    phase_rms_deg: float
    message: str = ""


def folded(parts: Sequence[Sequence[str]], refits: Sequence[Refit]) -> tuple[Fold, ...]:
    """One row for each configuration; parts: the configurations left out of each of the refits."""
    rows = []
    for part, refit in zip(parts, refits, strict=True):
        for name in part:
            score = refit.left_out.get(name)
            if score is None:
                rows.append(Fold(name, math.nan, math.nan, math.nan, refit.message))
            else:
                rows.append(Fold(name, score.misfit, score.rms_log_db, score.phase_rms_deg))
    return tuple(rows)


def fold_words(folds: Sequence[Fold], fitted: Sequence[Agreement]) -> str:
    """What they say beside the errors of the fit to all, in one sentence."""
    failed = [fold for fold in folds if math.isnan(fold.rms_log_db)]
    met = [fold for fold in folds if fold not in failed]
    if not met:
        return f"Cross-validation: no fit without some of the configurations succeeded ({failed[0].message})."
    seen = {a.configuration: a.overall_rms_log_db for a in fitted}
    db = math.sqrt(np.mean([fold.rms_log_db**2 for fold in met]))
    of_fit = math.sqrt(np.mean([seen[fold.configuration] ** 2 for fold in met]))
    worst = max(met, key=lambda fold: fold.rms_log_db)
    words = (
        f"Left out in turn, configurations are predicted with {db:.2g} dB rms by the fit to the others, where the fit "
        f"to all has {of_fit:.2g} dB; worst is {worst.configuration} with {worst.rms_log_db:.2g} dB. "
    )
    words += (
        "The parameters do not hang on single configurations."
        if carries_over(db, of_fit)
        else f"Some parameters hang on single configurations: measure more like {worst.configuration}."
    )
    if failed:
        names = ", ".join(fold.configuration for fold in failed)
        words += f" Without {names} nothing could be fitted: {failed[0].message}"
    return words
