"""elastid: the elasticity of industrial robots, identified from frequency responses with honest intervals.

Two wings end in the same value, FrequencyResponse, and meet in the fit:

     measured wing:  excitation -> experiment -> record -> frf -----.
                                       ^                            v
     one bridge:            experiment/simulated                   fit -> validation -> report, export
                                       ^                            ^
     model wing:     robot -> model -> simulation                   |
                                `----> linear ----------------------'

Floors, from the top; a room imports from the floors below it only:

- app           command line, table of stages, runs: file -> value -> file
- export study  models for other tools; YAML -> values, with file, line and column of every error
- report store  page and figures; HDF5
- design recorded validation   plans within limits; logs -> records; agreement, cross-validation, comparison
- friction_fit                 levels, laws, presliding and warm-up of friction
- experiment fit               plan and simulated rig; weights, least squares, solvers, uncertainty, diagnosis
- frf linear simulation        estimators; linearised robot and its responses; closed loop in time
- friction model response      laws; equations of motion in CasADi; FrequencyResponse
- excitation parameters robot   multisines; names and vectors; bodies, joints, springs, motors
- record friction_record        sampled signals
- base          arrays, units, errors, notes, execution

The names below are those that a notebook needs; they are loaded when they are first used.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from elastid.design.friction import design_friction
    from elastid.experiment.plan.plan import Plan, make_plan
    from elastid.experiment.simulated.closed_loop import closed_loop_of
    from elastid.experiment.simulated.friction_rig import SimulatedFrictionRig
    from elastid.experiment.simulated.rig import SimulatedRig
    from elastid.fit.fitted_robot import FittedRobot
    from elastid.fit.identify import identify
    from elastid.fit.result import FitResult
    from elastid.frf.estimate import estimate
    from elastid.friction_fit.identify import identify_friction
    from elastid.friction_fit.joint_levels import find_joint_levels
    from elastid.friction_fit.result import FrictionResult
    from elastid.friction_record import FrictionRecord, FrictionRecords
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
    "FittedRobot": "elastid.fit.fitted_robot",
    "FrequencyResponse": "elastid.response",
    "FrictionRecord": "elastid.friction_record",
    "FrictionRecords": "elastid.friction_record",
    "FrictionResult": "elastid.friction_fit.result",
    "Plan": "elastid.experiment.plan.plan",
    "Record": "elastid.record",
    "RecordedRig": "elastid.recorded.rig",
    "Robot": "elastid.robot",
    "SimulatedFrictionRig": "elastid.experiment.simulated.friction_rig",
    "SimulatedRig": "elastid.experiment.simulated.rig",
    "closed_loop_of": "elastid.experiment.simulated.closed_loop",
    "design_friction": "elastid.design.friction",
    "estimate": "elastid.frf.estimate",
    "find_joint_levels": "elastid.friction_fit.joint_levels",
    "formulate": "elastid.model.formulation",
    "frequency_response": "elastid.linear.response.transfer",
    "identify": "elastid.fit.identify",
    "identify_friction": "elastid.friction_fit.identify",
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
    "FittedRobot",
    "validate",
    "design_friction",
    "SimulatedFrictionRig",
    "FrictionRecord",
    "FrictionRecords",
    "find_joint_levels",
    "identify_friction",
    "FrictionResult",
]


def __getattr__(name: str) -> Any:
    """Load a public name from its module when it is first used; CasADi and SciPy wait until then."""
    if name not in _HOME:
        raise AttributeError(f"module 'elastid' has no attribute '{name}'")
    return getattr(import_module(_HOME[name]), "load" if name == "load_study" else name)
