"""What the constrained formulation of a linkage costs beside the minimal one: a whole fit of each, in one run.

    python scripts/benchmarks/linkage.py [--quick]

The shipped three-axis arm, its rod elastic, the lower arm bending in and out of the loop's plane: all stiffnesses,
dampings and motor frictions from the same responses with 1 % noise and from the same start. Processor time of
building, linearising, fitting and settling, median of several runs taken in turn; one process, one BLAS thread. Both
must reach the same cost.  The last line is one JSON object with the numbers of the table.
"""

# One BLAS thread must be asked for before NumPy is loaded.
# ruff: noqa: E402
import os

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import argparse
import json
import statistics
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from pydantic import TypeAdapter
from ruamel.yaml import YAML

from elastid.fit.identify import identify
from elastid.fit.spec import FitSpec, ParameterSpec
from elastid.linear.linearise import Linearisation
from elastid.linear.response.transfer import to_response
from elastid.model.formulation import formulate
from elastid.model.spec import ModelSpec
from elastid.record import Configuration
from elastid.response import Covariance, FrequencyResponse
from elastid.robot import Robot

ROBOT = Path(__file__).parents[2] / "configs" / "robots" / "irb4400_linkage.yml"
ANGLES = ((0.0, 0.0, 0.0), (0.5, 0.5, 0.2), (-0.4, -0.5, 0.2), (0.2, 0.1, 0.8), (0.0, 0.9, 0.3), (0.3, -0.3, -0.8))
NOISE = 0.01
SPECS = {"constrained": ModelSpec("constrained"), "minimal": ModelSpec("minimal")}


def robot() -> Robot:
    """The shipped arm."""
    data = YAML(typ="safe").load(ROBOT.read_text(encoding="utf-8"))
    described: Robot = TypeAdapter(Robot).validate_python(data)
    return described


def measured(arm: Robot, n_lines: int, count: int) -> list[FrequencyResponse]:
    """Responses of motors and lower arm with relative noise."""
    random, model = np.random.default_rng(0), formulate(arm)
    linearisation, outputs = Linearisation.of(model), (*model.inputs, "body lower_end y", "body upper x")
    found = []
    for i, angles in enumerate(ANGLES[:count], start=1):
        linear = linearisation.at(Configuration(f"c{i}", np.array(angles)), model.theta, outputs, "acceleration")
        exact = to_response(linear, linear.theta_ref, np.geomspace(2, 90, n_lines))
        noise = random.standard_normal((2, *exact.G.shape)) / np.sqrt(2)
        level = NOISE * np.abs(exact.G)
        found.append(replace(exact, G=exact.G + level * (noise[0] + 1j * noise[1]), total=Covariance(level**2, 50.0)))
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="a small problem")
    quick = parser.parse_args().quick
    arm = robot()
    responses = measured(arm, 30 if quick else 120, 3 if quick else 6)
    start = arm.with_parameters(
        {name: 1.3 * v for name, (v, _) in arm.parameters().items() if name[:2] in ("k_", "d_")}
    )
    free = {name: ParameterSpec() for name in ("k_*", "d_*", "fm_*")}
    seconds: dict[str, list[float]] = {name: [] for name in SPECS}
    cost: dict[str, float] = {}
    for _ in range(1 if quick else 5):
        for name, spec in SPECS.items():
            begin = time.process_time()
            result = identify(responses, start, FitSpec(parameters=free, starts=1), model=spec)
            seconds[name].append(time.process_time() - begin)
            cost[name] = result.cost
    median = {name: statistics.median(times) for name, times in seconds.items()}
    ratio = median["constrained"] / median["minimal"]
    for name, value in median.items():
        print(f"{name:12}{value:8.2f} s   cost {cost[name]:.8g}")
    print(f"constrained costs {ratio:.2f} times the minimal formulation")
    print(json.dumps({"seconds": median, "ratio": ratio, "cost": cost}))


if __name__ == "__main__":
    main()
