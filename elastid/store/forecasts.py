"""The layout of what a plan is expected to tell: a group of plan.h5."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from elastid.experiment.design.forecast import Forecast
from elastid.store.files import attributes, opened, scale, texts, variable

GROUP = "forecast"


def write_forecast(group: Any, forecast: Forecast) -> None:
    """Fill the group of an open plan.h5."""
    parameter = scale(group, "parameter", forecast.parameters, "parameter that the fit identifies")
    configuration = scale(group, "fitted_configuration", forecast.configurations, "configuration that the fit uses")
    frequency = scale(group, "freq_hz", forecast.freq_hz, "excited frequency", "Hz")
    blind = scale(group, "direction", np.arange(len(forecast.blind)), "direction that the plan does not see")
    variable(group, "unit", forecast.units, [parameter], "unit of the parameter")
    variable(group, "nominal", forecast.nominal, [parameter], "value for which it is told", "SI")
    variable(group, "std", forecast.std, [parameter], "expected standard deviation", "SI")
    variable(group, "log", np.array(forecast.log), [parameter], "whether the covariance is of its logarithm")
    variable(group, "covariance", forecast.covariance, [parameter, parameter], "expected covariance of x")
    axes = [configuration, frequency, parameter]
    variable(group, "share", forecast.share, axes, "part of what is known about a parameter that comes from here")
    variable(group, "blind", forecast.blind, [blind, parameter], "relative change that the plan does not see")
    scale(group, "note", forecast.notes, "note")
    if forecast.choice:
        group.attrs["choice"] = forecast.choice


def read_forecast(path: Path) -> Forecast | None:
    """The forecast in plan.h5; None where there is none."""
    with opened(path, "plan") as file:
        if GROUP not in file:
            return None
        group = file[GROUP]
        return Forecast(
            parameters=texts(group, "parameter"),
            units=texts(group, "unit"),
            nominal=group["nominal"][:],
            log=tuple(group["log"][:].tolist()),
            covariance=group["covariance"][:],
            configurations=texts(group, "fitted_configuration"),
            freq_hz=group["freq_hz"][:],
            share=group["share"][:],
            blind=group["blind"][:],
            notes=texts(group, "note"),
            choice=str(attributes(group).get("choice", "")),
        )
