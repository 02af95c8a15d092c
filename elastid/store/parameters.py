"""The parameters of fit.h5 as a table: one variable for each of their fields."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from elastid.parameters import Parameter, ParameterSet, Prior, Tie
from elastid.store.files import texts, variable


def write_parameters(group: Any, parameters: ParameterSet, axis: Any) -> None:
    """One variable for each field; no tie is an empty name, no prior is NaN."""
    ties = [p.tie or Tie("", math.nan) for p in parameters]
    priors = [(p.prior.mean, p.prior.std) if p.prior is not None else (math.nan, math.nan) for p in parameters]
    for name, values, what in (
        ("value", [p.value for p in parameters], "start or fixed value, SI"),
        ("lower", [p.lower for p in parameters], "lower bound, SI"),
        ("upper", [p.upper for p in parameters], "upper bound, SI"),
        ("log", [p.log for p in parameters], "whether x is ln p"),
        ("free", [p.free for p in parameters], "whether it is identified"),
        ("unit", [p.unit for p in parameters], "unit"),
        ("tie_to", [tie.to for tie in ties], "parameter that it is a multiple of"),
        ("tie_factor", [tie.factor for tie in ties], "that multiple"),
        ("tie_by", [tie.by for tie in ties], "and the parameter that it is multiplied by"),
        ("ratio", [p.ratio for p in parameters], "whether it is a factor of ties and not in the model"),
        ("only", [" | ".join(p.only) for p in parameters], "configurations in which it takes the place of another"),
        ("prior_mean", [mean for mean, _ in priors], "mean of the prior, SI"),
        ("prior_std", [std for _, std in priors], "standard deviation of the prior, of x"),
    ):
        variable(group, name, values if isinstance(values[0], str) else np.array(values), [axis], what)


def read_parameters(group: Any) -> ParameterSet:
    """The parameters of a group."""
    columns = {name: group[name][:].tolist() for name in ("value", "lower", "upper", "log", "free", "ratio")}
    columns |= {name: texts(group, name) for name in ("parameter", "unit", "tie_to", "tie_by", "only")}
    columns |= {name: group[name][:].tolist() for name in ("tie_factor", "prior_mean", "prior_std")}
    rows = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
    return ParameterSet(
        tuple(
            Parameter(
                row["parameter"],
                row["value"],
                row["unit"],
                row["lower"],
                row["upper"],
                row["log"],
                row["free"],
                Tie(row["tie_to"], row["tie_factor"], row["tie_by"]) if row["tie_to"] else None,
                None if math.isnan(row["prior_std"]) else Prior(row["prior_mean"], row["prior_std"]),
                tuple(row["only"].split(" | ")) if row["only"] else (),
                row["ratio"],
            )
            for row in rows
        )
    )
