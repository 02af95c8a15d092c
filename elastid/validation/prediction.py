"""Prediction: logs judged by numbers that others have identified, compared with a regression of these logs."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from elastid.validation.twin import TorqueBalance, describe_balance
from elastid.validation.twin_run import NO_TWIN, TwinFindings


@dataclass(frozen=True)
class Prediction:
    """Torque and motion along logs by a result of others.

    own: the torque by a regression of these logs themselves, as far as there is one; refused: why there is none.
    missing: reason by joint that is not predicted, in some log or all.
    """

    twin: TwinFindings = NO_TWIN
    own: tuple[TorqueBalance, ...] = ()
    refused: str = ""
    missing: Mapping[str, str] = field(default_factory=dict)

    def own_of(self, balance: TorqueBalance) -> TorqueBalance | None:
        """The same joint in the same log by the regression of these logs."""
        return next((own for own in self.own if (own.place, own.log) == (balance.place, balance.log)), None)

    @property
    def words(self) -> tuple[str, ...]:
        """The torque of each joint, then the simulations."""
        torques = [f"{describe_balance(balance)} {self.rms_words(balance)}" for balance in self.twin.balances]
        return (*torques, *([self.refused] if self.refused else []), *self.twin.run_words)

    def rms_words(self, balance: TorqueBalance) -> str:
        """The rms of what is left of a torque, compared with what a regression of the same logs leaves."""
        own = self.own_of(balance)
        compared = "" if own is None else f"; a regression of these logs themselves leaves {math.sqrt(own.left):.1%}"
        return f"As an rms {math.sqrt(balance.left):.1%} of the torque is left{compared}."


NO_PREDICTION = Prediction()
