"""Logs at rest and of warm-ups of outside rigs, from CSV to numbers: errors, coverage, prediction, cost, false alarms.

    python scripts/studies/rest_and_warm_up.py [--quick] [--draws 100] [--rigs 30] [--seed 1]

At rest: LuGre friction behind a gear on a spring, integrated in plain Python (tests/plants/lugre_rig.py), two
amplitudes of a multisine or of noise: error of sigma_0 and sigma_1 in % and the share of 95 % intervals that hold the
truth.  Loops: LuGre by multiple shooting from loops of 1 Hz with a dither and passes.  Warm-up: gear and housing with
the thermometer outside (tests/plants/warm_rig.py), of random capacities and conductances; fitted on the first of two
hours, error over the second of the temperature over its rise and of the gear's friction, rms in %; notes and refusals,
none of which these logs deserve.  Cost: CPU seconds of 720 000 samples from the file to the thermal model.  The last
line is one JSON object.

Multisine of 6 periods, 100 draws: sigma_0 0.41 %, sigma_1 2.2 % rms, coverage 96 and 94 +- 3 % (its bias is 0.3 to
0.7 %).  Noise of 30 s: 0.25 and 1.3 % rms, coverage 96 and 90 +- 3 %, of 120 draws each with --seed 11 and 12 97 and
96, 98 and 95 %. Coverage must be 95 %, three standard deviations of chance allowed.
Loops: 0.15 and 1.1 % rms.  Warm-up, 30 rigs: temperature within 0.13 %, level within 0.30 %, no note and no
refusal.  Cost: 2 CPU seconds.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import ElastidError
from elastid.base.statistics import QUANTILE_95
from elastid.experiment.specs.channels import ChannelSpec
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.recorded import FileSpec, RecordedSpec
from elastid.friction_study.at_rest import fit_at_rest, rest_responses
from elastid.friction_study.identify import identify_friction
from elastid.friction_study.joint_levels import find_joint_levels
from elastid.friction_study.spec import FrictionSpec, LawSpec
from elastid.friction_study.warm_up import WarmUp, fit_warm_up, warm_up_note, warm_up_of
from elastid.record import FrictionRecords
from elastid.recorded.friction_logs import read_friction_logs
from elastid.robot import Robot
from elastid.simulation.elastic_joint import held_joint
from elastid.study import load_robot
from tests.plants import lugre_rig, warm_rig
from tests.plants.friction_logs import ROBOT

TORQUE, ANGLE = ChannelSpec("u", "motor 1", "torque"), ChannelSpec("y", "motor 1", "angle", quantity="position")
THERMOMETER = ChannelSpec("t", "joint 1", "temperature", quantity="temperature")
# Peaks of the multisine in Nm, a twentieth and a tenth of Coulomb friction; rms of noise.
PEAKS, RMS = (1.0, 2.0), (0.35, 0.7)


def outside_joint(folder: Path) -> Robot:
    """The robot of the rig with bristles."""
    (folder / "robot.yml").write_text(lugre_rig.ROBOT)
    return load_robot(folder / "robot.yml")


def at_rest(robot: Robot, kind: str, draws: int, folder: Path, seed: int) -> dict[str, Any]:
    """Errors and coverage of (sigma_0, sigma_1) over draws, viscous friction known."""
    joint = held_joint(robot, "1", np.zeros(1))
    rng, errors, stds = np.random.default_rng(seed), [], []
    torque = np.stack([_torque(kind, i, rng) for _ in range(draws) for i in range(2)], axis=1)
    angle = lugre_rig.moved(torque + lugre_rig.TORQUE_STD * rng.standard_normal(torque.shape))
    for draw in range(draws):
        for i in range(2):
            column = 2 * draw + i
            lugre_rig.write_rest_log(folder / f"{i}.csv", torque[:, column], rng, angle[:, column])
        period = 2.0 if kind == "multisine" else None
        files = tuple(FileSpec(f"{i}.csv", purpose="at_rest", period=period) for i in range(2))
        spec = RecordedSpec(lugre_rig.RATE, (TORQUE, ANGLE), files, hold="zero-order")
        records = read_friction_logs(robot, ExperimentSpec(recorded=spec), folder, ["1"], {}).of("1", "at_rest")
        found = fit_at_rest("joint 1", rest_responses(records), joint, (lugre_rig.VISCOUS, 0.0))
        errors.append([found.sigma_0 / lugre_rig.SIGMA_0 - 1, found.sigma_1 / lugre_rig.SIGMA_1 - 1])
        stds.append(np.sqrt(np.diag(found.covariance)) / [lugre_rig.SIGMA_0, lugre_rig.SIGMA_1])
    held = np.abs(errors) < QUANTILE_95 * np.array(stds)
    return {
        "rms_percent": _percent(np.sqrt(np.mean(np.square(errors), axis=0))),
        "bias_percent": _percent(np.mean(errors, axis=0)),
        "coverage": held.mean(axis=0).round(3).tolist(),
    }


def _torque(kind: str, i: int, rng: np.random.Generator) -> FloatArray:
    return lugre_rig.multisine(PEAKS[i], rng) if kind == "multisine" else lugre_rig.noise(RMS[i], rng)


def _percent(values: FloatArray) -> list[float]:
    return [round(100 * float(value), 3) for value in values]


def loops(robot: Robot, draws: int, folder: Path) -> dict[str, Any]:
    """Errors of sigma_0 and sigma_1 by multiple shooting from slow loops with dither, and passes, in %."""
    joint, law, errors = robot.driven[0], FrictionSpec(law=LawSpec(presliding="lugre", temperature="no")), []
    for draw in range(draws):
        rng = np.random.default_rng(draw)
        q, u = lugre_rig.passes(rng)
        lugre_rig.write_rest_log(folder / "passes.csv", u, rng, q)
        lugre_rig.write_rest_log(folder / "loops.csv", lugre_rig.slow_loops(rng), rng)
        files = (FileSpec("passes.csv"), FileSpec("loops.csv", purpose="loops"))
        spec = RecordedSpec(lugre_rig.RATE, (TORQUE, ANGLE), files, hold="zero-order")
        measured = read_friction_logs(robot, ExperimentSpec(recorded=spec), folder, ["1"], {})
        result = identify_friction(robot, find_joint_levels(robot, [joint], measured), measured, law)
        bristles = result.at("1").bristles
        assert bristles is not None, result.at("1").notes
        truth = {"sigma_0": lugre_rig.SIGMA_0, "sigma_1": lugre_rig.SIGMA_1}
        errors.append([bristles.values[name] / value - 1 for name, value in truth.items()])
    return {"rms_percent": _percent(np.sqrt(np.mean(np.square(errors), axis=0)))}


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
    of_level = (model.levels(whole, None) / level - 1)[tests_s > end]
    alarms = [note.code for note in warm_up_note(of_whole, whole, "")]
    return {"temperature": _rms(error), "level": _rms(of_level), "alarms": alarms}


def _rms(x: FloatArray) -> float:
    return 100 * float(np.sqrt(np.mean(x**2)))


def cost(folder: Path, rate_hz: float) -> float:
    """CPU s of two hours, at 100 Hz 720 000 samples."""
    log = warm_rig.warm_log(2.0, rate_hz)
    warm_rig.write_warm_log(folder / "warm.csv", log)
    start = time.process_time()
    fit_warm_up(warm_up_from(folder, log))
    return time.process_time() - start


def main(arguments: Sequence[str] | None = None) -> None:
    """Print each figure, then one JSON line; assert those that texts quote."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=100, help="at rest, of each kind")
    parser.add_argument("--rigs", type=int, default=30, help="that warm up")
    parser.add_argument("--seed", type=int, default=1, help="of the draws at rest")
    parser.add_argument("--loops", type=int, default=5, help="logs of slow loops")
    parser.add_argument("--quick", action="store_true", help="one draw, one rig, and its log at a tenth of the rate")
    options = parser.parse_args(arguments)
    draws, rigs = (1, 1) if options.quick else (options.draws, options.rigs)
    results: dict[str, Any] = {"draws": draws, "rigs": rigs}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        results["cpu_s_720000"] = round(cost(folder, 10.0 if options.quick else 100.0), 1)
        print("cost", results["cpu_s_720000"], flush=True)
        robot = outside_joint(folder)
        for kind in ("multisine", "noise"):
            results[kind] = at_rest(robot, kind, draws, folder, options.seed)
            print(kind, results[kind], flush=True)
        results["loops"] = loops(robot, 1 if options.quick else options.loops, folder)
        print("loops", results["loops"], flush=True)
        halves = [predicted(seed, folder) for seed in range(rigs)]
    for key in ("temperature", "level"):
        results[f"{key}_percent"] = [round(quantile([half[key] for half in halves], part), 3) for part in (0.5, 1.0)]
    results["alarms"] = [alarm for half in halves for alarm in half["alarms"]]
    print(json.dumps(results))
    assert results["cpu_s_720000"] < 60
    assert results["temperature_percent"][1] < 0.3
    assert results["level_percent"][1] < 0.5
    assert not results["alarms"]
    for kind in ("multisine", "noise"):
        assert max(results[kind]["rms_percent"]) < 5, results[kind]
        least = 0.95 - 3 * np.sqrt(0.95 * 0.05 / draws)
        assert options.quick or min(results[kind]["coverage"]) > least, results[kind]


def quantile(values: Sequence[float], part: float) -> float:
    """Of values, the largest for 1."""
    return float(np.quantile(values, part))


if __name__ == "__main__":
    main()
