"""elastid: the elasticity of industrial robots, identified from frequency responses with honest intervals.

Five nouns carry it, and a script from logs to stiffness needs no other name (`elastid.nouns`):

- Robot       bodies, joints, springs, motors, loops                     Robot.read("robot.yml")
- Record      sampled signals of one experiment                          Record.read(robot, ...)
- Response    G (F, n_y, n_u) of one configuration, with covariance      Response.estimate(records)
- Parameters  numbers of a robot: units, bounds, priors, which are free  Parameters.choose(robot, "k_*")
- Result      estimates with intervals, covariance, status               Result.fit(responses, robot, parameters)

Two wings end in the same value, FrequencyResponse, and meet in the fit:

     measured wing:  excitation -> experiment -> record -> frf -----.
                                       ^                            v
     one bridge:            experiment/simulated                   fit -> validation -> report, export
                                       ^                            ^
     model wing:     robot -> model -> simulation                   |
                                `----> linear ----------------------'----> use

Floors, from the top; a room imports from the floors below it only:

- app           command line, table of stages, runs: file -> value -> file
- nouns         the five nouns with their constructors
- export study  models for other tools; YAML -> values, with file, line and column of every error
- report store  page and figures; HDF5
- design nonlinear recorded use validation  plans within limits; friction out of records; logs -> records; maps of the
  workspace and draws of robots; agreement
- friction_study               levels, laws, presliding and warm-up of friction; an extended Kalman filter follows it
- experiment fit modal         plan and simulated rig; weights, least squares, solvers, diagnosis; modes of a structure
- frf linear simulation        estimators; linearised robot and its responses; closed loop in time
- friction model response      laws; equations of motion in CasADi; FrequencyResponse
- excitation parameters robot   multisines; names and vectors; bodies, joints, springs, motors
- record        sampled signals
- base          arrays, units, errors, notes, execution

The names below are those that a notebook needs, in the order of the work; they are loaded when they are first used.
"""

from __future__ import annotations

# Nothing is imported here: the program's first lines (`elastid.__main__`) come after this file.
TYPE_CHECKING = False

if TYPE_CHECKING:
    from typing import Any

    from elastid import plot as plot
    from elastid.app.finished_run import FinishedRun as FinishedRun
    from elastid.app.finished_run import run as run
    from elastid.design.friction import design_friction as design_friction
    from elastid.excitation.spec import MultisineSpec as MultisineSpec
    from elastid.experiment.plan.plan import Plan as Plan
    from elastid.experiment.plan.plan import make_plan as make_plan
    from elastid.experiment.simulated.friction_rig import SimulatedFrictionRig as SimulatedFrictionRig
    from elastid.experiment.simulated.plant import closed_loop_of as closed_loop_of
    from elastid.experiment.simulated.rig import SimulatedRig as SimulatedRig
    from elastid.experiment.specs.channels import ChannelSpec as ChannelSpec
    from elastid.experiment.specs.disturbances import NoiseSpec as NoiseSpec
    from elastid.experiment.specs.experiment import ExperimentSpec as ExperimentSpec
    from elastid.experiment.specs.recorded import FileSpec as FileSpec
    from elastid.experiment.specs.recorded import RecordedSpec as RecordedSpec
    from elastid.experiment.specs.simulated import ControllerSpec as ControllerSpec
    from elastid.experiment.specs.simulated import SimulatedSpec as SimulatedSpec
    from elastid.fit.fitted_robot import FittedRobot as FittedRobot
    from elastid.fit.identify import identify as identify
    from elastid.fit.load_tests import LoadTest as LoadTest
    from elastid.fit.problem.static_loads import placed_tests as placed_tests
    from elastid.fit.result import FitResult as FitResult
    from elastid.fit.spec import FitSpec as FitSpec
    from elastid.fit.spec import ParameterSpec as ParameterSpec
    from elastid.fit.spec import PriorSpec as PriorSpec
    from elastid.fit.spec import TieSpec as TieSpec
    from elastid.fit.spec import WeightSpec as WeightSpec
    from elastid.frf.estimate import estimate as estimate
    from elastid.frf.spec import EstimatorSpec as EstimatorSpec
    from elastid.friction_study.identify import identify_friction as identify_friction
    from elastid.friction_study.joint_levels import find_joint_levels as find_joint_levels
    from elastid.friction_study.result import FrictionResult as FrictionResult
    from elastid.friction_study.spec import FrictionSpec as FrictionSpec
    from elastid.linear.fitted_model import FittedModel as FittedModel
    from elastid.linear.linearise import linearise as linearise
    from elastid.linear.posture_model import PostureModel as PostureModel
    from elastid.linear.response.transfer import frequency_response as frequency_response
    from elastid.modal.estimate import estimate_modes as estimate_modes
    from elastid.modal.modes import Modes as Modes
    from elastid.modal.shapes import mac as mac
    from elastid.modal.state_space import StateSpace as StateSpace
    from elastid.modal.state_space import fit_state_space as fit_state_space
    from elastid.model.formulation import formulate as formulate
    from elastid.model.formulation import serial as serial
    from elastid.model.spec import ModelSpec as ModelSpec
    from elastid.nouns import Parameters as Parameters
    from elastid.nouns import Record as Record
    from elastid.nouns import Response as Response
    from elastid.nouns import Result as Result
    from elastid.nouns import Robot as Robot
    from elastid.record import Configuration as Configuration
    from elastid.record import FrictionRecord as FrictionRecord
    from elastid.record import FrictionRecords as FrictionRecords
    from elastid.record import JointLoop as JointLoop
    from elastid.recorded.rig import RecordedRig as RecordedRig
    from elastid.response import Covariance as Covariance
    from elastid.response import FrequencyResponse as FrequencyResponse
    from elastid.response import Responses as Responses
    from elastid.robot import Body as Body
    from elastid.robot import Frame as Frame
    from elastid.robot import Friction as Friction
    from elastid.robot import Joint as Joint
    from elastid.robot import Loop as Loop
    from elastid.robot import Motor as Motor
    from elastid.robot import Payload as Payload
    from elastid.robot import Placement as Placement
    from elastid.robot import Rod as Rod
    from elastid.robot import Spring as Spring
    from elastid.store.friction_study import read_friction_result as read_friction_result
    from elastid.store.measured import read_modes as read_modes
    from elastid.store.measured import read_plan as read_plan
    from elastid.store.measured import read_records as read_records
    from elastid.store.measured import read_responses as read_responses
    from elastid.store.measured import write_records as write_records
    from elastid.store.measured import write_responses as write_responses
    from elastid.store.results import read_fit as read_fit
    from elastid.store.results import read_validation as read_validation
    from elastid.store.results import write_fit as write_fit
    from elastid.study import LoadedStudy as LoadedStudy
    from elastid.study import Study as Study
    from elastid.study import load_robot as load_robot
    from elastid.study import load_study as load_study
    from elastid.use.compliance import Cut as Cut
    from elastid.use.draws import draw_robots as draw_robots
    from elastid.use.map import map_workspace as map_workspace
    from elastid.use.postures import random_postures as random_postures
    from elastid.validation.agreement import validate as validate

__version__ = "0.2.0"

# Which names a module has, in the order of the work.
_NAMES = {
    "elastid.nouns": ("Robot", "Record", "Response", "Parameters", "Result"),
    "elastid.app.finished_run": ("run", "FinishedRun"),
    "elastid.study": ("load_study", "load_robot", "LoadedStudy", "Study"),
    "elastid.robot": ("Body", "Joint", "Spring", "Motor", "Loop", "Rod", "Payload", "Friction", "Frame", "Placement"),
    "elastid.excitation.spec": ("MultisineSpec",),
    "elastid.experiment.specs.experiment": ("ExperimentSpec",),
    "elastid.experiment.specs.simulated": ("SimulatedSpec", "ControllerSpec"),
    "elastid.experiment.specs.disturbances": ("NoiseSpec",),
    "elastid.experiment.specs.recorded": ("RecordedSpec", "FileSpec"),
    "elastid.experiment.specs.channels": ("ChannelSpec",),
    "elastid.experiment.plan.plan": ("Plan", "make_plan"),
    "elastid.experiment.simulated.plant": ("closed_loop_of",),
    "elastid.experiment.simulated.rig": ("SimulatedRig",),
    "elastid.recorded.rig": ("RecordedRig",),
    "elastid.record": ("Configuration", "FrictionRecord", "FrictionRecords", "JointLoop"),
    "elastid.frf.spec": ("EstimatorSpec",),
    "elastid.frf.estimate": ("estimate",),
    "elastid.response": ("Covariance", "FrequencyResponse", "Responses"),
    "elastid.modal.estimate": ("estimate_modes",),
    "elastid.modal.modes": ("Modes",),
    "elastid.modal.shapes": ("mac",),
    "elastid.modal.state_space": ("StateSpace", "fit_state_space"),
    "elastid.model.spec": ("ModelSpec",),
    "elastid.model.formulation": ("formulate", "serial"),
    "elastid.linear.linearise": ("linearise",),
    "elastid.linear.response.transfer": ("frequency_response",),
    "elastid.fit.spec": ("FitSpec", "ParameterSpec", "PriorSpec", "TieSpec", "WeightSpec"),
    "elastid.fit.identify": ("identify",),
    "elastid.fit.load_tests": ("LoadTest",),
    "elastid.fit.problem.static_loads": ("placed_tests",),
    "elastid.fit.result": ("FitResult",),
    "elastid.linear.fitted_model": ("FittedModel",),
    "elastid.linear.posture_model": ("PostureModel",),
    "elastid.use.postures": ("random_postures",),
    "elastid.use.compliance": ("Cut",),
    "elastid.use.map": ("map_workspace",),
    "elastid.use.draws": ("draw_robots",),
    "elastid.fit.fitted_robot": ("FittedRobot",),
    "elastid.validation.agreement": ("validate",),
    "elastid.design.friction": ("design_friction",),
    "elastid.experiment.simulated.friction_rig": ("SimulatedFrictionRig",),
    "elastid.friction_study.spec": ("FrictionSpec",),
    "elastid.friction_study.joint_levels": ("find_joint_levels",),
    "elastid.friction_study.identify": ("identify_friction",),
    "elastid.friction_study.result": ("FrictionResult",),
    "elastid.store.friction_study": ("read_friction_result",),
    "elastid.store.measured": (
        "read_plan",
        "read_records",
        "write_records",
        "read_responses",
        "write_responses",
        "read_modes",
    ),
    "elastid.store.results": ("read_fit", "write_fit", "read_validation"),
}
_HOME = {name: module for module, names in _NAMES.items() for name in names}

__all__ = ["plot", *_HOME]


def __getattr__(name: str) -> Any:
    """Load a public name from its module when it is first used; CasADi and SciPy wait until then."""
    from importlib import import_module

    if name == "plot":
        return import_module("elastid.plot")
    if name not in _HOME:
        raise AttributeError(f"module 'elastid' has no attribute '{name}'")
    return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    """The public names, whether they have been used or not."""
    return sorted({*__all__, "__version__"})
