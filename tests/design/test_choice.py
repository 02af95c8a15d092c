"""The choice of configurations: its sentence."""

from __future__ import annotations

import numpy as np

from elastid.design.choice import Choice
from elastid.experiment.plan.plan import ChosenConfiguration
from elastid.record import Configuration


def test_sentence_names_configurations_efficiency_and_the_gain_over_random_ones() -> None:
    chosen = ChosenConfiguration(Configuration("c1", np.zeros(1)), 4)
    assert Choice((chosen,), 2, 0.9712, 1.3, 200).sentence == (
        "chosen among 200 candidates: c1 (4 realisations), 2 periods each; 97.1 % of the best possible allocation, "
        "standard deviations 1.30 times smaller in the mean than for the median of random choices"
    )
