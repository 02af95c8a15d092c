"""How time and memory of estimate, identify and map grow: slopes in log-log over records, lines, coordinates and more.

    python scripts/benchmarks/growth.py [--quick]

Every size in a process of its own: CPU time of a second run, and the peak of memory in the first, with the data and
without what is loaded. Records: 6 x 6, 4 periods. Fits: the arm of fit.py, its first joints for fewer coordinates, one
start, no profiles; the number of iterations is in their time, too. A slope of 1 is proportional growth; slopes are
those of the line through all sizes. Linux only. The last line is one JSON object with them.

Measured (CPU time; memory at its peak): `estimate` grows with the power 0.8 (estimate_records_cpu) of its records in
time and 0.9 (estimate_records_memory) in memory, 0.7 (estimate_samples_cpu) and 0.8 (estimate_samples_memory) of the
samples of a period, 0.4 (estimate_lines_cpu) and 0.3 (estimate_lines_memory) of its lines; `identify` with 0.6
(identify_configurations_cpu) and 0.0 (identify_configurations_memory) of the configurations, 0.3 (identify_lines_cpu)
and 0.2 (identify_lines_memory) of their lines, 1.9 (identify_coordinates_cpu) and 2.5 (identify_coordinates_memory)
of the coordinates; `map` with 1.0 (map_postures_cpu) and 0.0 (map_postures_memory) of the postures. Studies from
their logs: of references with 0.9 (references_configurations_cpu) and 0.2 (references_configurations_memory) of the
configurations; of commands with 1.0 (commands_samples_cpu) and 0.3 (commands_samples_memory) of the samples.
"""

import json
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from itertools import count
from multiprocessing import get_context
from pathlib import Path
from tempfile import mkdtemp

import timing
import numpy as np
from fit import IDENTIFIED, build_robot, measure
from frf import simulate

from elastid.app.finished_run import run
from elastid.fit.identify import identify
from elastid.fit.result import Result
from elastid.fit.spec import FitSpec, ParameterSpec
from elastid.frf.estimate import estimate
from elastid.frf.spec import EstimatorSpec
from elastid.use.map import map_workspace
from elastid.use.postures import random_postures

sys.path.append(str(Path(__file__).parents[2] / "tests"))
from plants import commanded_joints, referenced_robot

# What is measured over which sizes: records of a configuration, its lines, samples of a period; configurations, their
# lines, coordinates of the robot; postures; configurations of logged references, samples of a log of commands.
SIZES = {
    "estimate": {"records": (12, 24, 48, 96), "lines": (256, 512, 1024, 2047), "samples": (4096, 8192, 16384, 32768)},
    "identify": {"configurations": (8, 16, 32, 64), "lines": (50, 100, 200, 400), "coordinates": (9, 12, 15, 18)},
    "map": {"postures": (1000, 2000, 4000, 8000)},
    "references": {"configurations": (2, 4, 8, 16)},
    "commands": {"samples": (2000, 4000, 8000, 16000)},
}
# Sizes that are constant in each series.
FIT = {"configurations": 8, "lines": 100, "coordinates": 18}
USUAL = {"estimate": {"records": 24, "lines": 512, "samples": 4096}, "identify": FIT, "map": {"postures": 1000, **FIT}}
QUICK = {"records": (12, 24), "configurations": (3, 6), "postures": (50, 100), "samples": (500, 1000)}


def of_estimate(records: int, lines: int, samples: int) -> Callable[[], object]:
    """Prepare the estimation of a response from records with six experiments per realisation."""
    chosen = np.arange(1, lines + 1)
    experiments = simulate(chosen, samples, 4, records // 6, 6)
    return lambda: estimate(experiments, EstimatorSpec(), chosen)


def of_identify(configurations: int, lines: int, coordinates: int) -> Callable[[], Result]:
    """Prepare the fit of responses with noise."""
    whole = build_robot()
    robot = replace(whole, bodies=whole.bodies[: coordinates // 3])
    responses = measure(robot, configurations, np.linspace(2.0, 100.0, lines), full=False)
    names = {name: ParameterSpec() for name in IDENTIFIED if name[:2] in ("k_", "d_", "fm")}
    spec = FitSpec(parameters=names, starts=1, seed=1, profile=())
    return lambda: identify(responses, robot, spec)


def of_map(postures: int, **fit: int) -> Callable[[], object]:
    """Prepare the prediction of compliance, modes and stability, with intervals, in random postures."""
    result = of_identify(**fit)()
    angles = random_postures(result.nominal_robot, postures, 1)
    return lambda: map_workspace(result, angles, frame=str(fit["coordinates"] // 3))


def of_study(study: Path, *stages: str) -> Callable[[], object]:
    """Prepare the stages of a study from logs to parameters, in a new folder for each call."""
    folders = (study.parent / f"run{i}" for i in count())
    return lambda: run(study, next(folders), "measure", *stages, verbosity=-2)


def of_references(configurations: int) -> Callable[[], object]:
    """Prepare a study of three axes from references and encoders with sampled controllers."""
    whole, rng = build_robot(), np.random.default_rng(0)
    robot = replace(whole, bodies=whole.bodies[:3])
    postures = {f"p{i}": rng.uniform(-1.2, 1.2, len(robot.driven)).tolist() for i in range(configurations)}
    return of_study(
        referenced_robot.write(Path(mkdtemp()) / "logs", robot, postures, 1e-3, realisations=1), "estimate", "fit"
    )


def of_commands(samples: int) -> Callable[[], object]:
    """Prepare a friction study of two joints from commands and positions."""
    folder = Path(mkdtemp())
    r = commanded_joints.references(samples, 2, 0.5, 2.0)
    q = commanded_joints.positions(commanded_joints.two_joints, r, 0.0)
    np.savetxt(folder / "log.csv", np.hstack([r, q]), "%.12g", ",", header="r0,r1,q0,q1", comments="")
    (folder / "robot.yml").write_text(commanded_joints.TWO_ROBOT)
    channels = [
        {"role": role, "at": f"motor {i + 1}", "channel": f"{letter}{i}", "quantity": "position", "unit": "rad"}
        for role, letter in (("reference", "r"), ("y", "q"))
        for i in range(2)
    ]
    kp, kd = np.transpose(commanded_joints.GAINS)
    controller = {"position_gain": (kp / kd).tolist(), "velocity_gain": kd.tolist()}
    recorded = {"rate_hz": commanded_joints.RATE_HZ, "controller": controller, "channels": channels}
    recorded["files"] = [{"path": "log.csv"}]
    study = {"name": "commands", "robot": "robot.yml", "friction": {}, "experiment": {"recorded": recorded}}
    (folder / "study.yml").write_text(json.dumps(study, indent=1))
    return of_study(folder / "study.yml", "constant_velocity", "friction")


def memory_mb(name: str) -> float:
    """Read VmRSS, the resident memory of this process in MB, or VmHWM, its maximum since the last reset."""
    status = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    return float(next(line for line in status if line.startswith(name)).split()[1]) / 1024


def point(task: tuple[str, dict[str, int]]) -> tuple[float, float]:
    """Measure one size: CPU seconds of its second run, and peak memory of its first run, MB, including its data."""
    name, size = task
    start_mb = memory_mb("VmRSS")
    studies = {"references": of_references, "commands": of_commands}
    work = ({"estimate": of_estimate, "identify": of_identify, "map": of_map} | studies)[name](**size)
    Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
    work()
    peak, begin = memory_mb("VmHWM"), time.process_time()
    work()
    return time.process_time() - begin, peak - start_mb


def main() -> None:
    """Print a row for each size, then the slopes."""
    is_quick = timing.options(__doc__, "two small sizes of one thing each, to see that it runs").quick
    slopes = dict[str, float]()
    print(timing.machine())
    for name, over in SIZES.items():
        usual = USUAL.get(name, {})
        if is_quick and "coordinates" in usual:
            usual = usual | {"configurations": 3, "coordinates": 9}
        for key, sizes in [*over.items()][: 1 if is_quick else None]:
            selection = QUICK[key] if is_quick else sizes
            tasks = [(name, usual | {key: size}) for size in selection]
            with get_context("spawn").Pool(1, maxtasksperchild=1) as pool:
                points = np.array(pool.map(point, tasks, chunksize=1))
            print(f"{name} over {key} {selection}: CPU s, MB\n{points.round(2)}", flush=True)
            for kind, values in zip(("cpu", "memory"), points.T, strict=True):
                slope = np.polyfit(np.log(selection), np.log(np.maximum(values, 1e-3)), 1)[0]
                slopes[f"{name}_{key}_{kind}"] = round(float(slope), 2)
    print(json.dumps(slopes))


if __name__ == "__main__":
    main()
