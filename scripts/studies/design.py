"""Planned against random plans of the same robot time, through simulation, estimation and fit.

    python scripts/studies/design.py [--quick] [--jobs N] [--robot three-axis] [--robot six-axis]

For the demo's three-axis arm and for a six-axis arm, a plan is designed for a given robot time: configurations, how
often each, how many periods, and the spectrum of each. It is measured again and again on the simulated rig, with new
phases and new noise each time, and fitted from the nominal robot, which is the true one. It prints the standard
deviations over the repetitions against those that the forecast stated before, and their geometric mean against that of
plans of the same robot time with random configurations (admissible ones, as many as fit in with the study's own two
periods) and a spectrum that is flat in torque, of the same RMS. The forecast also gives the gain of configurations
alone and of spectra alone.

Coulomb friction is a twentieth of the demo's and the sensors' noise is raised, so that noise and not the model's error
(Coulomb friction fitted as viscous) is what spreads the estimates; for the same reason the fit's floor is lower than by
default. Frictions are fitted but not compared: what Coulomb friction adds to them is the excitation's affair.

The noise of the logged torque acts on the log alone, so that one simulation serves for several draws of it. With K
simulations (phases, friction, encoder) of B draws each, the variance of an estimate is that within a simulation and
what the means of the simulations scatter beyond it; the stated chance error is that of this estimate.
"""

from __future__ import annotations

import argparse
import json
import math
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from importlib.resources import files
from pathlib import Path

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.execution import Execution, ordered
from elastid.design.choice import draw_candidates
from elastid.design.design import Design, design
from elastid.design.problem import DesignProblem
from elastid.design.spec import CandidateSpec, DesignSpec
from elastid.excitation.spec import MultisineSpec
from elastid.experiment.plan.plan import ChosenConfiguration, Plan, make_plan
from elastid.experiment.simulated.rig import SimulatedRig
from elastid.experiment.specs.disturbances import NoiseSpec
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.simulated import CarrierSpec, SimulatedSpec
from elastid.fit.identify import identify
from elastid.fit.spec import FitSpec, ParameterSpec, WeightSpec
from elastid.frf.estimate import estimate
from elastid.frf.spec import EstimatorSpec
from elastid.robot import Axis, Body, Joint, Limits, Motor, Placement, Robot, Spring
from elastid.study import load

FRICTION = 0.05
CANDIDATES = CandidateSpec(random=500, floor=0.0, clearance=0.05)
PERIODS = (2, 4, 8)


@dataclass(frozen=True)
class Programme:
    """What is measured in every repetition, with phases of its own: configurations, periods, and the amplitudes
    (Q, F, n_u) that their lines had in the design, limits kept.
    """

    problem: DesignProblem
    configurations: tuple[ChosenConfiguration, ...]
    amplitude: FloatArray

    @classmethod
    def of(cls, problem: DesignProblem, design: Design) -> Programme:
        """The plan of a design."""
        experiment = replace(problem.experiment, periods=design.plan.periods, configurations={})
        chosen = tuple(
            ChosenConfiguration(c, M) for c, M in zip(design.plan.configurations, design.plan.realisations, strict=True)
        )
        amplitude = np.sqrt(np.mean(np.abs(design.plan.R[:, 0]) ** 2, axis=1))
        return cls(replace(problem, experiment=experiment), chosen, amplitude)

    def plan(self, seed: int) -> Plan:
        """With the phases of this seed."""
        problem = self.problem
        each = zip(self.configurations, self.amplitude, strict=True)
        spectra = {one.configuration.name: amplitude for one, amplitude in each}
        found = replace(problem.excitation, flat="information")
        return make_plan(found, problem.experiment, problem.robot, seed, self.configurations, spectra)


@dataclass(frozen=True)
class Outcome:
    """Of one robot, for the parameters (n,) that are compared, relative: stated and reached standard deviations of the
    plan and the chance error of these; reached ones (plans, n) of random plans, what the forecasts stated for those and
    for those with the best spectra; (n,) for the best configurations with a flat spectrum.
    """

    names: tuple[str, ...]
    stated: FloatArray
    reached: FloatArray
    chance: FloatArray
    random: FloatArray
    random_stated: FloatArray
    random_shaped: FloatArray
    chosen_flat: FloatArray
    repetitions: tuple[int, int]

    @property
    def ratio(self) -> FloatArray:
        """Reached over stated (n,)."""
        return self.reached / self.stated

    @property
    def gain(self) -> float:
        """How many times smaller the planned geometric mean is than the median of the random plans."""
        return against_median(self.random, self.reached)

    @property
    def predicted(self) -> dict[str, float]:
        """The same by the forecasts: of the plan, of its configurations and of its spectra alone."""
        return {
            "both": against_median(self.random_stated, self.stated),
            "configurations": against_median(self.random_stated, self.chosen_flat),
            "spectra": float(np.median(geometric_mean(self.random_stated) / geometric_mean(self.random_shaped))),
        }


def against_median(random: FloatArray, planned: FloatArray) -> float:
    """Median geometric mean of random plans (B, n) over that of a plan (n,)."""
    return float(np.median(geometric_mean(random)) / geometric_mean(planned))


def geometric_mean(std: FloatArray) -> FloatArray:
    """Over the last axis."""
    mean: FloatArray = np.exp(np.mean(np.log(std), axis=-1))
    return mean


def slippery(robot: Robot) -> Robot:
    """The robot with a part of its Coulomb friction."""

    def joint(one: Joint) -> Joint:
        return (
            one if one.motor is None else replace(one, motor=replace(one.motor, coulomb=FRICTION * one.motor.coulomb))
        )

    bodies = tuple(replace(body, joints=tuple(joint(one) for one in body.joints)) for body in robot.bodies)
    return replace(robot, bodies=bodies)


def three_axes(count: int) -> DesignProblem:
    """The demo's arm: 17 unknowns, stiffness and damping of seven springs and the friction of three motors."""
    template = Path(str(files("elastid"))) / "app" / "templates" / "serial" / "study.yml"
    robot = load(template).study.robot
    return problem_of(robot, (160.0, 160.0, 80.0), count)


def six_axes(count: int) -> DesignProblem:
    """An arm with a spherical wrist: six elastic gears, four further elastic joints, 26 unknowns."""

    def axis(name: str, about: Axis, ratio: float, motor: float, k: float, d: float, limit: float) -> Joint:
        limits = Limits((-math.radians(limit), math.radians(limit)), 3.0, 4000.0)
        return Joint(name, about, Spring(k, d), Motor(motor, ratio, 1e-3, 0.2), limits=limits)

    def bearing(name: str, about: Axis, k: float, d: float) -> Joint:
        return Joint(name, about, Spring(k, d))

    turret = (bearing("1y", "y", 1.6e6, 1500), axis("1", "z", 120, 2.4e-3, 3.2e5, 450, 170))
    upper = (axis("2", "y", 125, 2.8e-3, 3.6e5, 500, 80), bearing("2x", "x", 4.5e5, 500))
    fore = (axis("3", "y", 110, 1.6e-3, 1.8e5, 220, 80), bearing("3x", "x", 9e4, 80), bearing("3z", "z", 2.2e5, 200))
    roll = (axis("4", "x", 80, 6e-4, 3.2e4, 30, 170),)
    pitch = (axis("5", "y", 75, 5e-4, 2.2e4, 20, 110),)
    hand = (axis("6", "x", 60, 4e-4, 1.2e4, 10, 170),)
    robot = Robot(
        "six-axis arm",
        (
            Body("turret", "base", Placement((0, 0, 0.4)), turret, 150, (0.1, 0, 0.1), (8, 9, 9)),
            Body("upper", "turret", Placement((0.2, 0, 0.3)), upper, 60, (0.05, 0, 0.4), (6, 6, 0.8)),
            Body("fore", "upper", Placement((0, 0, 0.85)), fore, 45, (0.15, 0.03, 0.1), (1, 3, 3)),
            Body("roll", "fore", Placement((0.4, 0, 0.1)), roll, 20, (0.2, 0, 0), (0.4, 0.7, 0.7)),
            Body("pitch", "roll", Placement((0.4, 0, 0)), pitch, 8, (0.05, 0, 0), (0.1, 0.15, 0.1)),
            Body("hand", "pitch", Placement((0.1, 0, 0)), hand, 18, (0.12, 0.06, 0.04), (0.3, 0.4, 0.45)),
        ),
    )
    return problem_of(robot, (160.0, 160.0, 80.0, 25.0, 20.0, 12.0), count)


def problem_of(robot: Robot, torque_rms: tuple[float, ...], count: int) -> DesignProblem:
    """A study in which the design chooses all, in the robot time of `count` configurations of two periods of 2 s."""
    noise = NoiseSpec(torque_std=6.0, encoder_counts=65536)
    simulated = SimulatedSpec(carrier=CarrierSpec(math.radians(1)), noise=noise, substeps=2)
    return DesignProblem(
        robot=slippery(robot),
        excitation=MultisineSpec(500.0, 2.0, (2.0, 60.0), torque_rms, flat="information"),
        experiment=ExperimentSpec(realisations=2, periods=2, ramp=0.0, simulated=simulated),
        fit=FitSpec(
            parameters={name: ParameterSpec() for name in ("k_*", "d_*", "fm_*")},
            starts=1,
            weights=WeightSpec(floor=0.002),
        ),
        quantity="acceleration",
        seed=1,
        design=DesignSpec(robot_time=count * 2 * len(robot.driven) * 3 * 2.0, periods=PERIODS, candidates=CANDIDATES),
    )


def fitted(programme: Programme, draws: int, seed: int) -> FloatArray:
    """Measured once, then fitted with several draws of the torque's noise: the estimates x (B, n)."""
    problem, plan = programme.problem, programme.plan(seed)
    simulated = problem.experiment.as_simulated()
    quiet = replace(simulated, noise=replace(simulated.noise, torque_std=0.0))
    rig = SimulatedRig(problem.robot, replace(problem.experiment, simulated=quiet), plan, seed)
    records = [rig.measure(run) for run in plan.experiments]
    x = []
    for draw in range(draws):
        rng = np.random.default_rng([seed, draw])
        noisy = [
            replace(one, u=one.u + simulated.noise.torque_std * rng.standard_normal(one.u.shape)) for one in records
        ]
        there = [[one for one in noisy if one.configuration.name == c.name] for c in plan.configurations]
        responses = [estimate(each, EstimatorSpec(), plan.lines) for each in there]
        x.append(identify(responses, problem.robot, problem.fit).x)
    return np.array(x)


def spread(x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Standard deviations (n,) from K simulations of B draws each, x (K, B, n); their relative chance errors."""
    K, B, _ = x.shape
    within = x.var(axis=1, ddof=1).mean(axis=0)
    between = B * x.mean(axis=1).var(axis=0, ddof=1)
    variance = within * (1 - 1 / B) + between / B
    parts = (within * (1 - 1 / B)) ** 2 / (K * (B - 1)) + (between / B) ** 2 / (K - 1)
    chance = np.sqrt(2 * parts) / variance / 2
    # The logarithm of a sample variance lies too low in the mean, by about its relative variance over two.
    std: FloatArray = np.sqrt(variance) * np.exp(chance**2)
    return std, chance


def random_choice(problem: DesignProblem, count: int, seed: int) -> DesignProblem:
    """With configurations drawn from the candidates that the design chooses from, and a flat spectrum."""
    assert problem.design is not None
    there = draw_candidates(problem.design.candidates, problem.robot, problem.seed, math.radians(1)).configurations
    drawn = np.random.default_rng(seed).choice(len(there), count, replace=False)
    only = {f"r{i}": tuple(there[k].angles.tolist()) for i, k in enumerate(drawn)}
    return replace(flat(problem), design=None, experiment=replace(problem.experiment, configurations=only))


def flat(problem: DesignProblem) -> DesignProblem:
    """With the same torque at all lines."""
    return replace(problem, excitation=replace(problem.excitation, flat="torque"))


def stated(design: Design) -> FloatArray:
    """What the forecast says of the standard deviations of the parameters that are compared."""
    std: FloatArray = np.sqrt(np.diag(design.forecast.covariance))
    return std[compared(design.forecast.parameters)]


def compared(names: Sequence[str]) -> list[int]:
    """All but frictions."""
    return [i for i, name in enumerate(names) if not name.startswith("fm_")]


def study(
    problem: DesignProblem, count: int, repetitions: tuple[int, int], plans: int, of_random: int, jobs: int
) -> Outcome:
    """Planned against random plans of `count` configurations; simulations and draws of noise, those of random plans."""
    found = design(problem, Execution(jobs))
    print(f"{problem.robot.name}: {found.plan.robot_time_s:g} s of robot time; {found.forecast.choice}", flush=True)
    names = found.forecast.parameters
    here = compared(names)
    reached, chance = measured(Programme.of(problem, found), repetitions, 100, jobs)
    print(f"  measured, fitted: {100 * geometric_mean(reached[here]):.3g} %", flush=True)
    random, random_stated, random_shaped = [], [], []
    for plan in range(plans):
        drawn = random_choice(problem, count, plan)
        random_plan = design(drawn, Execution(jobs))
        random_stated.append(stated(random_plan))
        random_shaped.append(stated(design(replace(drawn, excitation=problem.excitation), Execution(jobs))))
        random.append(measured(Programme.of(drawn, random_plan), (of_random, repetitions[1]), 200, jobs)[0][here])
        means = (100 * geometric_mean(one[-1]) for one in (random, random_stated))
        print("  random plan {} of {}: {:.3g} % (forecast {:.3g} %)".format(plan + 1, plans, *means), flush=True)
    outcome = Outcome(
        tuple(names[i] for i in here),
        stated(found),
        reached[here],
        chance[here],
        np.array(random),
        np.array(random_stated),
        np.array(random_shaped),
        stated(design(flat(problem), Execution(jobs))),
        repetitions,
    )
    say(outcome)
    return outcome


def measured(
    programme: Programme, repetitions: tuple[int, int], first: int, jobs: int
) -> tuple[FloatArray, FloatArray]:
    """Standard deviations over the repetitions, and their chance errors (n,)."""
    simulations, draws = repetitions
    seeds = range(first, first + simulations)
    return spread(np.array(ordered(partial(fitted, programme, draws), seeds, jobs)))


def say(outcome: Outcome) -> None:
    """The numbers."""
    print("  parameter  stated %  reached %  ratio")
    for name, a, b in zip(outcome.names, outcome.stated, outcome.reached, strict=True):
        print(f"  {name:9}  {100 * a:8.3f}  {100 * b:9.3f}  {b / a:5.2f}")
    print(
        f"  reached / stated: geometric mean {geometric_mean(outcome.ratio):.2f}, from {outcome.ratio.min():.2f} to "
        f"{outcome.ratio.max():.2f} (one standard deviation of chance in each: {np.median(outcome.chance):.2f})"
    )
    by_random, predicted = geometric_mean(outcome.random), outcome.predicted
    print(
        f"  geometric mean of std: planned {100 * geometric_mean(outcome.reached):.3g} %, random plans "
        f"{100 * by_random.min():.3g} to {100 * by_random.max():.3g} %, median {100 * np.median(by_random):.3g} %: "
        f"planned {outcome.gain:.2f} times smaller (forecast: {predicted['both']:.2f}; configurations alone "
        f"{predicted['configurations']:.2f}, spectra alone {predicted['spectra']:.2f})"
    )


# What is run for each robot: configurations of the robot time; simulations and draws of noise; random plans and their
# simulations.
STUDIES = {"three-axis": (three_axes, 4, (25, 6), 7, 4), "six-axis": (six_axes, 2, (8, 8), 5, 2)}


def main(quick: bool, jobs: int, robots: Sequence[str] = tuple(STUDIES)) -> list[Outcome]:
    if quick:
        arm = three_axes(1)
        assert arm.design is not None
        few = replace(arm.design, candidates=replace(CANDIDATES, random=12), periods=())
        return [study(replace(arm, design=few), 1, (2, 2), 1, 2, jobs)]
    outcomes = []
    for make, count, repetitions, plans, of_random in (STUDIES[name] for name in robots):
        outcomes.append(study(make(count), count, repetitions, plans, of_random, jobs))
    return outcomes


def in_numbers(outcome: Outcome) -> dict[str, object]:
    """For programs."""
    return {
        "reached_over_stated": dict(zip(outcome.names, outcome.ratio.round(3).tolist(), strict=True)),
        "chance": round(float(np.median(outcome.chance)), 3),
        "gain": round(outcome.gain, 3),
        "predicted": {name: round(value, 3) for name, value in outcome.predicted.items()},
        "repetitions": outcome.repetitions,
    }


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="one configuration of the three-axis arm")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--robot", action="append", choices=list(STUDIES), help="this one alone; may be repeated")
    arguments = parser.parse_args()
    found = main(arguments.quick, arguments.jobs, arguments.robot or tuple(STUDIES))
    print(json.dumps({str(len(one.names)) + " parameters": in_numbers(one) for one in found}))
