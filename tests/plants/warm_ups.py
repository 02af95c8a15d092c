"""Warm-ups of outside rigs, from the log's file to the thermal model and its errors."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import ElastidError
from elastid.experiment.specs.channels import ChannelSpec
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.recorded import FileSpec, RecordedSpec
from elastid.friction_study.warm_up import WarmUp, fit_warm_up, warm_up_note, warm_up_of
from elastid.record import FrictionRecords
from elastid.recorded.friction_logs import read_friction_logs
from plants import warm_rig
from plants.friction_logs import ROBOT

TORQUE, ANGLE = ChannelSpec("u", "motor 1", "torque"), ChannelSpec("y", "motor 1", "angle", quantity="position")
THERMOMETER = ChannelSpec("t", "joint 1", "temperature", quantity="temperature")


def warm_up_from(folder: Path, log: warm_rig.WarmLog, samples: tuple[int, int] | None = None) -> WarmUp:
    """The warm-up of a log in a file."""
    file = FileSpec("warm.csv", purpose="warm_up", samples=samples)
    spec = ExperimentSpec(recorded=RecordedSpec(log.rate_hz, (TORQUE, ANGLE, THERMOMETER), (file,)))
    measured: FrictionRecords = read_friction_logs(ROBOT, spec, folder, ["1"], {})
    return warm_up_of(measured.warm_ups[0], measured.records)


def predicted(seed: int, folder: Path) -> dict[str, Any]:
    """A rig of random nodes: errors over its second hour in %, and codes of notes or the refusal."""
    factors = np.exp(np.random.default_rng(seed).uniform(-0.5, 0.5, 4))
    nodes = warm_rig.Nodes(*(np.array([2500.0, 9000.0, 12.0, 6.0]) * factors).tolist())
    log = warm_rig.warm_log(2.0, 25.0, seed, nodes=nodes)
    warm_rig.write_warm_log(folder / "warm.csv", log)
    try:
        whole, half = warm_up_from(folder, log), warm_up_from(folder, log, (0, len(log.torque) // 2))
        model, of_whole = fit_warm_up(half), fit_warm_up(whole)
    except ElastidError as error:
        return {"temperature": np.inf, "level": np.inf, "alarms": [str(error)]}
    clean, time_s = warm_rig.warm_log(2.0, 25.0, seed, 0.0, nodes=nodes), np.arange(len(log.torque)) / log.rate_hz
    housing, tests_s = np.interp(whole.time_s, time_s, clean.thermometer), whole.time_s[whole.tests]
    level = warm_rig.friction(whole.test_speed, np.interp(tests_s, time_s, log.gear))
    end = whole.time_s[-1] / 2
    error = (model.temperature(whole) - housing)[whole.time_s > end] / np.ptp(housing)
    of_level = (model.levels(whole) / level - 1)[tests_s > end]
    alarms = [note.code for note in warm_up_note(of_whole, whole, "")]
    return {"temperature": _rms(error), "level": _rms(of_level), "alarms": alarms}


def _rms(x: FloatArray) -> float:
    return 100 * float(np.sqrt(np.mean(x**2)))
