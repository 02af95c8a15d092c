"""A stamp, a fit with parameters of every kind, texts, and equality to the last bit."""

import dataclasses
import math

import hypothesis.strategies as st
import numpy as np

from elastid.parameters import Parameter, Parameters, Prior, Tie
from elastid.store.artefacts import Stamp
from plants.report_values import PARAMETERS, fit_result

STAMP = Stamp("inputs", "code", "0.1.0", 3, "name: Kühlhaus\n" * 6000)

TEXT = st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"), max_size=12)


def same(a, b):
    """Equal to the last bit, whatever is inside; NaN equals NaN."""
    if dataclasses.is_dataclass(a):
        return type(a) is type(b) and all(same(getattr(a, f.name), getattr(b, f.name)) for f in dataclasses.fields(a))
    if isinstance(a, tuple):
        return isinstance(b, tuple) and len(a) == len(b) and all(map(same, a, b))
    if isinstance(a, dict):
        return isinstance(b, dict) and a.keys() == b.keys() and all(same(a[name], b[name]) for name in a)
    if isinstance(a, np.ndarray):
        if a.dtype != b.dtype or a.shape != b.shape or a.dtype.kind not in "fc":
            return a.dtype == b.dtype and np.array_equal(a, b)
        return np.array_equal(*(each.ravel().view(float) for each in (a, b)), equal_nan=True)
    if isinstance(a, float) and math.isnan(a):
        return isinstance(b, float) and math.isnan(b)
    return type(a) is type(b) and a == b


def some_fit(n_starts=2):
    """The fit of the reports with ties, priors and stand-ins of every kind, and with numbers that are not finite."""
    result, n = fit_result(), len(PARAMETERS.free)
    k_1, *others = PARAMETERS
    parameters = Parameters(
        (
            dataclasses.replace(k_1, upper=math.inf, prior=Prior(90.0, 0.1)),
            *others,
            Parameter("k_1@b", 80.0, "N*m/rad", free=False, only=("b", "c")),
            Parameter("factor", 2.0, free=False, ratio=True),
            Parameter("k_3", 60.0, "N*m/rad", tie=Tie("k_1", 0.5, "factor")),
        )
    )
    covariance = np.diag([1e-4, *[math.inf] * (n - 1)])
    return dataclasses.replace(
        result, parameters=parameters, covariance=covariance, starts=result.starts[:1] * n_starts
    )
