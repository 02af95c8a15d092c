"""The section `heat` of a simulated experiment: what warms and cools the joints of a friction study."""

from __future__ import annotations

from typing import Annotated

from elastid.base.section import Key, section
from elastid.base.units import Conductance, Temperature, TemperatureRise, Time


@section
class HeatSpec:
    r"""Heat of each joint of a friction study, for friction laws that have a `temperature`.

    .. math:: C \dot T = \tau_f v - h (T - T_a)
    """

    # fmt: off
    conductance: Annotated[Conductance, Key("Thermal conductance h from the joint to the room.", "smaller for hotter "
        "joints: the final rise is the heat of friction over it, commonly 10 to 40 K.")]
    time_constant: Annotated[Time, Key("Thermal time constant C / h of the joint.", "45 minutes are usual for gears of "
        "medium robots; larger gears take up to two hours.")] = 2700.0
    ambient: Annotated[Temperature, Key("Temperature T_a of the room.", "that of the hall; losses count from it, and "
        "joints start there unless `start` is given.")] = 20.0
    start: Annotated[Temperature | None, Key("Temperature T of every joint at the start (default: ambient).",
        "above ambient for a robot that has worked before; the warm-up then shows less of the fall.")] = None
    thermometer_std: Annotated[TemperatureRise, Key("Standard deviation of the logged temperature; one error for each "
        "motion.", "0.5 to 2 K for sensors on the housing; its error goes into the numbers of the temperature law as "
        "one per motion.")] = 0.0
    has_thermometer: Annotated[bool, Key("Temperatures are logged if true.", "false for robots that log none; the law "
        "then has no temperature terms, and drift shows as scatter.")] = True
    # fmt: on

    def __post_init__(self) -> None:
        """Refuse a joint without heat capacity, or one that nothing cools."""
        if not self.conductance > 0 or not self.time_constant > 0:
            raise ValueError(
                f"conductance is {self.conductance:g} W/K and time_constant {self.time_constant:g} s; both must be "
                "positive"
            )
        if self.thermometer_std < 0:
            raise ValueError(f"thermometer_std is {self.thermometer_std:g} K; it must not be negative")

    @property
    def start_degc(self) -> float:
        """Of every joint at the start."""
        return self.ambient if self.start is None else self.start
