"""The comparison of models and its search as values: refits, ranked models, trials."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from elastid.base.arrays import FloatArray, frozen_value

# The coordinates that are elastic in a model, in the order of the robot, by their labels.
Elastic: TypeAlias = tuple[str, ...]


@dataclass(frozen=True)
class LeftOut:
    """Errors of a model on a configuration that it was not fitted to: misfit m_c, magnitude and phase."""

    misfit: float
    rms_log_db: float
    phase_rms_deg: float


@dataclass(frozen=True)
class Refit:
    """How a fit without some configurations ended.  cost, n_free and dof: of the fit; left_out: by configuration.

    status: that of the fit, or `failed`, with the reason as message.
    """

    status: str
    message: str
    n_free: int
    cost: float
    dof: int
    left_out: dict[str, LeftOut]


@frozen_value
class ComparedModel:
    """A model in the ranking.  misfit (n_c,): by configuration, NaN where none was left out or the fit failed.

    criterion: QAIC above the smallest.  rms_log_db, phase_rms_deg: over the left-out configurations.
    """

    name: str
    n_free: int
    cost: float
    dof: int
    criterion: float
    misfit: FloatArray
    rms_log_db: float
    phase_rms_deg: float
    note: str = ""

    @property
    def mean_misfit(self) -> float:
        """Over the configurations; infinite where one of them is not known."""
        return float(self.misfit.mean()) if self.misfit.size and np.isfinite(self.misfit).all() else math.inf

    def behind(self, best: ComparedModel) -> tuple[float, float]:
        """Mean difference of the misfits to the best model's, and its standard error."""
        difference = self.misfit - best.misfit
        n = difference.size
        return float(difference.mean()), float(difference.std(ddof=1) / math.sqrt(n)) if n > 1 else math.inf


@dataclass(frozen=True)
class Trial:
    """A model tried in a step: `coordinates` become free or rigid, which leaves `elastic` ones and n_free parameters.

    before, after: misfit of left-out configurations, mean.  change, standard_error: after - before, paired over the
    configurations.  criterion: change of QAIC.  NaN where one of both has no fit.  taken: true if the search continues
    from it.
    """

    step: int
    becomes: Literal["free", "rigid"]
    coordinates: tuple[str, ...]
    elastic: Elastic
    n_free: int
    before: float
    after: float
    change: float
    standard_error: float
    criterion: float
    taken: bool


@dataclass(frozen=True)
class Comparison:
    """The models, the one that predicts best first (by the criterion where nothing was left out), and a verdict.

    trials: of the search that tried these models, in its order; none where they were given.
    """

    configurations: tuple[str, ...]
    rows: tuple[ComparedModel, ...]
    verdict: str
    trials: tuple[Trial, ...] = ()
