"""What is known of a LuGre law before its joint is moved through presliding: static numbers, bristles at rest."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from elastid.base.arrays import FloatArray, frozen_value
from elastid.friction_fit.at_rest import AtRest
from elastid.friction_fit.static_law import StaticLaw
from elastid.simulation.elastic_joint import FRICTION


@frozen_value
class Prior:
    """ln of the numbers of `FRICTION`: mean (6,), and information (6, 6), the inverse covariance; 0 of unknown ones."""

    mean: FloatArray
    information: FloatArray

    @classmethod
    def of(cls, values: Mapping[str, float], covariance: FloatArray) -> Prior:
        """From numbers by name and their covariance in this order, to first order in the logarithm.

        A number that is not positive has no logarithm and is left out, with the others' variances as they are.
        """
        names, value = list(values), np.array(list(values.values()))
        used = [i for i, name in enumerate(names) if name in FRICTION and value[i] > 0]
        at = [FRICTION.index(names[i]) for i in used]
        mean, information = np.zeros(len(FRICTION)), np.zeros((len(FRICTION),) * 2)
        mean[at] = np.log(value[used])
        relative = covariance[np.ix_(used, used)] / np.outer(value[used], value[used])
        information[np.ix_(at, at)] = np.linalg.inv(relative)
        return cls(mean, information)

    @classmethod
    def of_law(cls, law: StaticLaw) -> Prior:
        """The static numbers that a curve without load and temperature has."""
        return cls.of(law.values, law.covariance)

    @classmethod
    def of_rest(cls, found: AtRest) -> Prior:
        """sigma_0 and sigma_1."""
        return cls.of({"sigma_0": found.sigma_0, "sigma_1": found.sigma_1}, found.covariance)

    def with_other(self, other: Prior) -> Prior:
        """What both know of different numbers."""
        return Prior(self.mean + other.mean, self.information + other.information)

    @property
    def known(self) -> dict[str, float]:
        """The numbers with a mean, by name."""
        used = np.diag(self.information) > 0
        return {name: float(np.exp(x)) for name, x, known in zip(FRICTION, self.mean, used, strict=True) if known}
