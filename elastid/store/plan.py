"""Plan of an identification in plan.h5: plan, references, peak values of the simulated runs, forecast."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from elastid.experiment.plan.plan import Plan
from elastid.experiment.plan.reference_trajectory import Reference
from elastid.store.reading import reader
from elastid.store.writing import writer

if TYPE_CHECKING:
    from elastid.design.forecast import Forecast
    from elastid.design.limit_use import LimitUse

PLAN = "plan"

write_plan = writer(
    PLAN, plan=(Plan, None), references=(tuple[Reference, ...], ()), peaks=(None, None), forecast=(None, None)
)
read_plan = reader(PLAN, "plan", Plan)
# By name, since these types import the fit.
read_peaks: "Callable[[Path | str], LimitUse]" = reader(PLAN, "peaks", "elastid.design.limit_use:LimitUse")
read_forecast: "Callable[[Path | str], Forecast | None]" = reader(
    PLAN, "forecast", "elastid.design.forecast:Forecast", is_optional=True
)
