# ruff: noqa: I001
"""Public names with their modules, in the order of the work; `elastid` loads each when it is first used."""

from elastid import plot as plot
from elastid.nouns import (
    Robot as Robot,
    Record as Record,
    Response as Response,
    Parameters as Parameters,
    Result as Result,
)
from elastid.app.finished_run import run as run, FinishedRun as FinishedRun
from elastid.study import load_study as load_study, load_robot as load_robot, LoadedStudy as LoadedStudy, Study as Study
from elastid.robot import (
    Body as Body,
    Joint as Joint,
    Spring as Spring,
    Motor as Motor,
    Loop as Loop,
    Rod as Rod,
    Payload as Payload,
    Friction as Friction,
    Frame as Frame,
    Placement as Placement,
)
from elastid.excitation.spec import MultisineSpec as MultisineSpec
from elastid.experiment.specs.experiment import ExperimentSpec as ExperimentSpec
from elastid.experiment.specs.simulated import SimulatedSpec as SimulatedSpec, ControllerSpec as ControllerSpec
from elastid.experiment.specs.disturbances import NoiseSpec as NoiseSpec
from elastid.experiment.specs.recorded import RecordedSpec as RecordedSpec, FileSpec as FileSpec
from elastid.experiment.specs.channels import ChannelSpec as ChannelSpec
from elastid.experiment.plan.plan import Plan as Plan, make_plan as make_plan
from elastid.experiment.simulated.plant import closed_loop_of as closed_loop_of
from elastid.experiment.simulated.rig import SimulatedRig as SimulatedRig
from elastid.recorded.rig import RecordedRig as RecordedRig
from elastid.record import (
    Configuration as Configuration,
    FrictionRecord as FrictionRecord,
    FrictionRecords as FrictionRecords,
    JointLoop as JointLoop,
)
from elastid.frf.spec import EstimatorSpec as EstimatorSpec
from elastid.frf.estimate import estimate as estimate
from elastid.response import Covariance as Covariance, FrequencyResponse as FrequencyResponse, Responses as Responses
from elastid.modal.estimate import estimate_modes as estimate_modes
from elastid.modal.modes import Modes as Modes
from elastid.modal.modes import mac as mac
from elastid.model.spec import ModelSpec as ModelSpec
from elastid.model.formulation import formulate as formulate, serial as serial
from elastid.linear.linearise import linearise as linearise
from elastid.linear.response.transfer import frequency_response as frequency_response
from elastid.fit.spec import (
    FitSpec as FitSpec,
    ParameterSpec as ParameterSpec,
    PriorSpec as PriorSpec,
    TieSpec as TieSpec,
    WeightSpec as WeightSpec,
)
from elastid.fit.identify import identify as identify
from elastid.fit.load_tests import LoadTest as LoadTest
from elastid.fit.problem.static_loads import placed_tests as placed_tests
from elastid.fit.result import FitResult as FitResult
from elastid.linear.fitted_model import FittedModel as FittedModel
from elastid.linear.posture_model import PostureModel as PostureModel
from elastid.use.postures import random_postures as random_postures
from elastid.use.compliance import Cut as Cut
from elastid.use.map import map_workspace as map_workspace
from elastid.use.draws import draw_robots as draw_robots
from elastid.fit.fitted_robot import FittedRobot as FittedRobot
from elastid.validation.agreement import validate as validate
from elastid.design.friction import design_friction as design_friction
from elastid.experiment.simulated.friction_rig import SimulatedFrictionRig as SimulatedFrictionRig
from elastid.friction_study.spec import FrictionSpec as FrictionSpec
from elastid.friction_study.joint_levels import find_joint_levels as find_joint_levels
from elastid.friction_study.identify import identify_friction as identify_friction
from elastid.friction_study.result import FrictionResult as FrictionResult
from elastid.store.friction_study import read_friction_result as read_friction_result
from elastid.store.measured import (
    read_plan as read_plan,
    read_records as read_records,
    write_records as write_records,
    read_responses as read_responses,
    write_responses as write_responses,
    read_modes as read_modes,
)
from elastid.store.results import read_fit as read_fit, write_fit as write_fit, read_validation as read_validation

__version__: str
