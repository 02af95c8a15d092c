"""The records of a study through its fitted model: replayed in time, and the torque of their motors part by part."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from itertools import chain
from pathlib import Path

from elastid.app.dry_friction import shaft_couplings
from elastid.app.run import Run
from elastid.base.arrays import FloatArray
from elastid.base.errors import StudyError
from elastid.base.execution import Execution
from elastid.fit.fitted_robot import FittedRobot
from elastid.frf.spec import EstimatorSpec
from elastid.linear.linear_model import LinearModel
from elastid.nonlinear.result import FrictionTakenOut
from elastid.nonlinear.take_out import net_records
from elastid.store import read_configurations, read_friction, read_records
from elastid.validation.elastic_twin import ModelParts, elastic_balances, model_parts, rigid_linearisation
from elastid.validation.replay import replay
from elastid.validation.results import Replay
from elastid.validation.twin import TorqueBalance


@dataclass(frozen=True)
class InTime:
    """The records of one configuration replayed, and the torque of each motor in the first of them."""

    replayed: Replay
    balances: tuple[TorqueBalance, ...]


def records_in_time(run: Run, fitted: FittedRobot, execution: Execution) -> list[InTime]:
    """Of every configuration of records.h5; each process has a few records in memory at a time.

    No torque is divided into parts where the robot cannot be without its springs, or a motor's motion was not measured.
    """
    path, names = run.path("measure"), read_configurations(run.path("measure"))
    models = [each for each in _models(run, fitted) if each.configuration in names]
    work = partial(_in_time, path, read_friction(run.path("estimate")), shaft_couplings(run.study), run.study.estimator)
    return execution.ordered(work, models)


@dataclass(frozen=True, eq=False)
class _Models:
    """The model of one configuration with its numbers (n_theta,), its parts or None, and the lines (F,) in Hz."""

    configuration: str
    whole: LinearModel
    theta: FloatArray
    parts: ModelParts | None
    freq_hz: FloatArray


def _models(run: Run, fitted: FittedRobot) -> Iterator[_Models]:
    try:
        rigid = rigid_linearisation(fitted, run.study.model)
    except StudyError as error:
        run.console.say(f"validate: the torque is not divided into parts: {error}")
        rigid = None
    for response in fitted.measured:
        name = response.configuration.name
        parts = None if rigid is None else model_parts(fitted, rigid, name)
        yield _Models(name, fitted.at(name), fitted.theta_of(name), parts, response.freq_hz)


def _in_time(
    path: Path, friction: FrictionTakenOut | None, E: FloatArray | None, spec: EstimatorSpec, models: _Models
) -> InTime:
    records = read_records(path, models.configuration)
    first = next(records)
    (net,) = net_records([first], friction, E)
    freq_hz, parts = models.freq_hz, models.parts
    balances = () if parts is None else elastic_balances(first, net, parts, freq_hz, spec)
    every = chain([net], net_records(records, friction, E))
    band_hz = float(freq_hz[0]), float(freq_hz[-1])
    return InTime(replay(every, models.whole, models.theta, band_hz, spec), balances)
