"""Functional mock-up units of a fitted robot: FMI 2.0 and 3.0, co-simulation, with their sources."""

from elastid.export.fmu.unit import write_fmu

__all__ = ["write_fmu"]
