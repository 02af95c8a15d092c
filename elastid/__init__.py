"""elastid: the elasticity of industrial robots, identified from frequency responses with honest intervals.

Two wings end in the same value, FrequencyResponse, and meet in the fit:

    excitation -> experiment -> record --> frf ---.
                       ^                          v
              experiment.simulated               fit -> validation -> report
                       ^                          ^
    robot -> model -> simulation                  |
               `----> linear ---------------------'

Values (floor 1): `units` and `section` (how a study's numbers and sections are read), `parameters` (names and vectors),
`record` (sampled signals), `response` (frequency responses with covariance), `robot` (bodies, joints, springs, motors,
loops; from a table of Denavit and Hartenberg, or a URDF).

Measured wing: `excitation` (multisines), `repair` (faults of logs), `experiment` (the plan; `design` of what to
measure; the `simulated` and the `recorded` rig; `responses` of other programs), `frf` (records to responses and their
covariance).

Model wing: `model` (equations of motion in CasADi: `formulation` chooses `serial` or, for robots with loops, one of
`parallel_linkage`), `friction`, `simulation` (closed loop in time), `linear` (equilibrium, linearisation, frequency
response and its derivatives, modes and which springs hold their energy).

Together: `fit` (weights, residuals, solver, multistart, certainty), `validation`, `report`, `export` (to other tools).

The application: `study` (YAML to values), `store` (HDF5), `run`, `provenance`, `planning`, `imported` and `stages`
(file to value to file, what is current), `validating` (what the stage of that name does), `comparing` (models on
the same responses), `searching` (where the elasticity sits), `outcome` (summary.json, validation.json), `console`,
`overview`, `inspection`, `scaffold`, `tables` (what people see) and `cli`.

The names below are those that a notebook needs; they are loaded when they are first used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from elastid.experiment.plan.plan import Plan, make_plan
    from elastid.experiment.simulated.closed_loop import closed_loop_of
    from elastid.experiment.simulated.rig import SimulatedRig
    from elastid.fit.fitted_model import FittedModel
    from elastid.fit.identify import identify
    from elastid.fit.result import FitResult
    from elastid.frf.estimate import estimate
    from elastid.linear.linearise import linearise
    from elastid.linear.response.transfer import frequency_response
    from elastid.model.formulation import formulate
    from elastid.model.serial import serial
    from elastid.record import Configuration, Record
    from elastid.recorded.rig import RecordedRig
    from elastid.response import FrequencyResponse
    from elastid.robot import Robot
    from elastid.study import load as load_study
    from elastid.validation.agreement import validate

__version__ = "0.1.0"

_HOME = {
    "Configuration": "elastid.record",
    "FitResult": "elastid.fit.result",
    "FittedModel": "elastid.fit.fitted_model",
    "FrequencyResponse": "elastid.response",
    "Plan": "elastid.experiment.plan.plan",
    "Record": "elastid.record",
    "RecordedRig": "elastid.recorded.rig",
    "Robot": "elastid.robot",
    "SimulatedRig": "elastid.experiment.simulated.rig",
    "closed_loop_of": "elastid.experiment.simulated.closed_loop",
    "estimate": "elastid.frf.estimate",
    "formulate": "elastid.model.formulation",
    "frequency_response": "elastid.linear.response.transfer",
    "identify": "elastid.fit.identify",
    "linearise": "elastid.linear.linearise",
    "load_study": "elastid.study",
    "make_plan": "elastid.experiment.plan.plan",
    "serial": "elastid.model.serial",
    "validate": "elastid.validation.agreement",
}

__all__ = [  # noqa: RUF022  (in the order of the work)
    "load_study",
    "Robot",
    "Configuration",
    "make_plan",
    "closed_loop_of",
    "Plan",
    "SimulatedRig",
    "RecordedRig",
    "Record",
    "estimate",
    "FrequencyResponse",
    "formulate",
    "serial",
    "linearise",
    "frequency_response",
    "identify",
    "FitResult",
    "FittedModel",
    "validate",
]


def __getattr__(name: str) -> Any:
    """Load a public name from its module when it is first used; CasADi and SciPy wait until then."""
    if name not in _HOME:
        raise AttributeError(f"module 'elastid' has no attribute '{name}'")
    return getattr(import_module(_HOME[name]), "load" if name == "load_study" else name)
