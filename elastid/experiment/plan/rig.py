"""Rig: the contract that the simulated robot and a folder of lab logs share."""

from __future__ import annotations

from typing import Protocol

from elastid.experiment.plan.plan import Experiment
from elastid.record import Record


class Rig(Protocol):
    """Something that can be measured, one experiment at a time, in any order and in any process (it pickles)."""

    @property
    def experiments(self) -> tuple[Experiment, ...]:
        """All experiments that it can run."""
        ...

    def measure(self, experiment: Experiment) -> Record:
        """Run one experiment; the same experiment gives the same record, bit for bit."""
        ...
