"""plan.h5: the plan, its references, the peaks of the simulated runs and the forecast."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from elastid.experiment.plan.plan import Plan
from elastid.experiment.plan.reference_trajectory import Reference
from elastid.store.reading import reader
from elastid.store.values import writer

if TYPE_CHECKING:
    from elastid.design.forecast import Forecast, LimitUse

PLAN = "plan"

# The plan, references of each configuration, peaks of the rehearsal, forecast.
write_plan = writer(
    PLAN, plan=(Plan, None), references=(tuple[Reference, ...], ()), peaks=(None, None), forecast=(None, None)
)
read_plan = reader(PLAN, "plan", Plan)
# The peaks of the rehearsal, and the forecast, if any; they bring the fit, which a reader of the plan does not need.
read_peaks: "Callable[[Path | str], LimitUse]" = reader(PLAN, "peaks", "elastid.design.forecast:LimitUse")
read_forecast: "Callable[[Path | str], Forecast | None]" = reader(
    PLAN, "forecast", "elastid.design.forecast:Forecast", may_miss=True
)
