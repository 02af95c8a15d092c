"""Cross-validation: every configuration is left out of one fit, and predicted by the fit to the others."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from elastid.validation.comparison import LeftOut, Refit
from elastid.validation.results import Agreement, Fold


def generalises(left_out_db: float, fitted_db: float) -> bool:
    """True if a model with these errors holds in left-out configurations: at most half as much more, plus 0.1 dB."""
    return left_out_db <= 1.5 * fitted_db + 0.1


def divide(names: Sequence[str], parts: int) -> tuple[tuple[str, ...], ...]:
    """The configurations in so many parts, each in one of them; 0: one a part. None for a single configuration."""
    n = min(parts or len(names), len(names))
    return tuple(tuple(names[i::n]) for i in range(n)) if n > 1 else ()


def gather_folds(parts: Sequence[Sequence[str]], refits: Sequence[Refit]) -> tuple[Fold, ...]:
    """One fold for each configuration; parts: the configurations left out of each of the refits."""
    folds = []
    for part, refit in zip(parts, refits, strict=True):
        for name in part:
            score, message = refit.left_out.get(name), ""
            if score is None:
                score, message = LeftOut(math.nan, math.nan, math.nan), refit.message
            folds.append(Fold(name, score.misfit, score.rms_log_db, score.phase_rms_deg, message))
    return tuple(folds)


def describe_folds(folds: Sequence[Fold], fitted: Sequence[Agreement]) -> str:
    """The errors of the folds compared with those of the fit to all, with advice."""
    failed = [fold for fold in folds if math.isnan(fold.rms_log_db)]
    met = [fold for fold in folds if fold not in failed]
    if not met:
        return f"Cross-validation: every fit without some configurations failed; the first with: {failed[0].message}"
    of_all = {a.configuration: a.overall_rms_log_db for a in fitted}
    db = math.sqrt(np.mean([fold.rms_log_db**2 for fold in met]))
    of_fit = math.sqrt(np.mean([of_all[fold.configuration] ** 2 for fold in met]))
    worst = max(met, key=lambda fold: fold.rms_log_db)
    words = (
        f"Cross-validation: the fit to the others predicts a left-out configuration with {db:.2g} dB rms, the fit to "
        f"all has {of_fit:.2g} dB; worst is {worst.configuration} with {worst.rms_log_db:.2g} dB. "
    )
    words += (
        "The parameters do not depend on single configurations."
        if generalises(db, of_fit)
        else f"Some parameters depend on single configurations; measure more configurations like {worst.configuration}."
    )
    if failed:
        names = ", ".join(fold.configuration for fold in failed)
        words += f" The fit without {names} failed: {failed[0].message}"
    return words
