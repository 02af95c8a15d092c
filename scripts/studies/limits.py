"""Does any peak leave the robot's limits? Randomly drawn robots, limits, signals and movements, designed and measured.

    python scripts/studies/limits.py [--quick] [--studies 1000] [--seed 0] [--jobs 2] [--truth 0.0]

Every study is planned as the stage design plans it, with the amplitudes scaled to the limits; then each of its
experiments is run on the nonlinear simulation with noise of another seed, ramps included, and every peak of torque,
position, velocity and acceleration is held against the limit. --truth: the simulated robot's springs and dampers are
off the planned ones by up to this part. The last line is one JSON object.
"""

# One BLAS thread must be asked for before NumPy is loaded.
# ruff: noqa: E402
import os

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import argparse
import json
import math
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import StudyError
from elastid.base.execution import ordered
from elastid.design.forecast import QUANTITIES
from elastid.design.limits import peaks_of_run, within_limits
from elastid.excitation.spec import MultisineSpec
from elastid.experiment.plan.plan import make_plan
from elastid.experiment.simulated.plant import closed_loop_of
from elastid.experiment.simulated.rig import SimulatedRig
from elastid.experiment.specs.disturbances import NoiseSpec
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.simulated import CarrierSpec, ControllerSpec, SimulatedSpec
from elastid.robot import Body, Joint, Limits, Motor, Placement, Robot, Spring


@dataclass(frozen=True)
class Outcome:
    """used (5,): largest part of a limit that was used, in the design and when measured; refused: why, if it was."""

    planned: FloatArray
    measured: FloatArray
    refused: str = ""


def random_robot(rng: np.random.Generator) -> Robot:
    """One to three driven elastic axes with friction under gravity, and limits of every kind."""
    bodies: list[Body] = []
    for i in range(int(rng.integers(1, 4))):
        size = 0.5**i * rng.uniform(0.5, 2)
        ratio = float(rng.uniform(90, 150) * rng.choice([-1, 1]))
        torque = 2500 * size
        limits = Limits(
            angle=(-rng.uniform(0.6, 2), rng.uniform(0.6, 2)),
            velocity=rng.uniform(0.2, 2),
            torque=torque,
            acceleration=rng.choice([math.inf, rng.uniform(5, 50)]),
        )
        joint = Joint(
            f"{i + 1}",
            str(rng.choice(["y", "z"])) if i else "z",  # type: ignore[arg-type]
            Spring(size * rng.uniform(1e5, 6e5), size * rng.uniform(50, 600)),
            Motor(size * rng.uniform(2e-3, 5e-3), ratio, 1e-3 * size, rng.uniform(0.005, 0.03) * torque / abs(ratio)),
            limits=limits,
        )
        bodies.append(
            Body(
                f"body {i + 1}",
                bodies[-1].name if bodies else "base",
                Placement((0.0, 0.0, 0.5 if i else 0.0)),
                (joint,),
                mass=60 * size,
                center_of_mass=(rng.uniform(0, 0.2), 0.0, rng.uniform(0.1, 0.3)),
                inertia=6 * size,
            )
        )
    return Robot("drawn", tuple(bodies))


def random_study(rng: np.random.Generator, robot: Robot) -> tuple[MultisineSpec, ExperimentSpec]:
    """An excitation scaled to the limits, and an experiment in one configuration."""
    phases: Any = rng.choice(["random", "random", "random", "schroeder", "optimised", "linear-sweep", "prbs"])
    grids = ["full", "odd"] if phases in ("linear-sweep", "prbs") else ["full", "odd", "odd-random", "odd-quasi-log"]
    low = rng.uniform(1, 4)
    excitation = MultisineSpec(
        rate_hz=500.0,
        period=float(rng.choice([1.0, 2.0])),
        band_hz=(low, rng.uniform(low + 12, 80)),
        torque_rms="limits",
        grid=str(rng.choice(grids)),  # type: ignore[arg-type]
        flat=str(rng.choice(["torque", "velocity", "acceleration"])),  # type: ignore[arg-type]
        power=rng.uniform(-1, 0.5),
        phases=str(phases),  # type: ignore[arg-type]
        orthogonal=str(rng.choice(["dft", "zippered"])),  # type: ignore[arg-type]
    )
    carriers = [
        None,
        CarrierSpec(amplitude=rng.uniform(0.005, 0.03)),
        CarrierSpec(kind="square", velocity=rng.uniform(0.02, 0.06)),
        CarrierSpec(kind="offset", velocity=rng.uniform(0.03, 0.1)),
    ]
    angles = tuple(0.6 * rng.uniform(*joint.limits.angle) for joint in robot.driven)
    simulated = SimulatedSpec(
        controller=ControllerSpec(bandwidth_hz=rng.uniform(0.8, 2.5)),
        carrier=carriers[int(rng.integers(4))],
        noise=NoiseSpec(torque_std=1.0, angle_std=1e-6, disturbance_std=1.0, encoder_counts=1 << 20),
        substeps=8,
    )
    realisations = 2 if excitation.is_new_in_every_realisation else 1
    return excitation, ExperimentSpec({"a": angles}, realisations, ramp=rng.uniform(0.2, 0.6), simulated=simulated)


def studied(truth: float, seed: int) -> Outcome:
    """One study, designed and measured."""
    rng = np.random.default_rng(seed)
    robot = random_robot(rng)
    excitation, experiment = random_study(rng, robot)
    nothing = np.zeros(len(QUANTITIES))
    try:
        loop = closed_loop_of(robot, experiment.as_simulated().controller, excitation.rate_hz)
        plan = make_plan(excitation, experiment, robot, seed, closed_loop=loop)
        plan, limit_use = within_limits(SimulatedRig(robot, experiment, plan, seed), excitation)
    except StudyError as error:
        return Outcome(nothing, nothing, str(error))
    springs = {name: value for name, (value, _) in robot.parameters().items() if name[:2] in ("k_", "d_")}
    true = {name: value * (1 + truth * rng.uniform(-1, 1)) for name, value in springs.items()}
    rig = SimulatedRig(robot, experiment.with_truth(true), plan, seed + 10**6)
    runs = [peaks_of_run(rig, rig.rehearse(e)) for e in plan.experiments]
    measured = (np.max(runs, axis=0) / limit_use.limit[0]).max(axis=1)
    return Outcome(limit_use.used[0].max(axis=1), measured)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--studies", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--truth", type=float, default=0.0)
    parser.add_argument("--quick", action="store_true", help="two studies, whatever --studies says")
    given = parser.parse_args()
    seeds = [given.seed + i for i in range(2 if given.quick else given.studies)]
    outcomes = ordered(partial(studied, given.truth), seeds, given.jobs)
    run = [o for o in outcomes if not o.refused]
    planned, measured = (np.array([getattr(o, name) for o in run]) for name in ("planned", "measured"))
    print(f"{len(outcomes)} studies, {len(outcomes) - len(run)} refused")
    print(f"{'part of the limit used':24}{'planned, median':>18}{'largest':>10}{'measured, largest':>20}{'beyond':>8}")
    for i, name in enumerate(QUANTITIES):
        row = np.median(planned[:, i]), planned[:, i].max(), measured[:, i].max()
        print(f"{name:24}{row[0]:18.3f}{row[1]:10.3f}{row[2]:20.3f}{(measured[:, i] > 1).sum():8d}")
    beyond = int((measured > 1).any(axis=1).sum())
    seeds_beyond = [s for s, o in zip(seeds, outcomes, strict=True) if (o.measured > 1).any()]
    for reason in sorted({o.refused.split(": ", 1)[-1][:90] for o in outcomes if o.refused})[:5]:
        print(f"  refused: {reason} ...")
    print(
        json.dumps(
            {
                "studies": len(outcomes),
                "refused": len(outcomes) - len(run),
                "beyond": beyond,
                "seeds_beyond": seeds_beyond,
                "largest": dict(zip(QUANTITIES, measured.max(axis=0).round(4).tolist(), strict=True)),
                "largest_planned": dict(zip(QUANTITIES, planned.max(axis=0).round(4).tolist(), strict=True)),
                "median_of_the_closest": round(float(np.median(planned.max(axis=1))), 4),
            }
        )
    )


if __name__ == "__main__":
    main()
