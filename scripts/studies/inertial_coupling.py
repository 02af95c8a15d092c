"""How large is the inertial coupling S of motors and links, and what does a fit lose that leaves it out?

    python scripts/studies/inertial_coupling.py [--quick] [--robot configs/robots/manutec_r3.yml] [--seed 0]

Where the motors sit is not published; two placements stand for what is built: `before`, each motor on the link before
its joint, parallel to the joint's axis, and `forearm`, motors 1 and 3 on the links that they move, 4 to 6 along the
forearm. Gear ratios are the published ones (60 to 210), divided by 1, 3 and 10 with the motors' inertias on the link
side kept: S / M_m grows as 1 / ratio. Printed are S normalised row by row with the diagonal of M, as in chapter 3.1 of
Niglis & Oberg (2015), its largest values over the range of joints 2 and 3, and normalised by both sides,
S_ij / sqrt(M_ii M_m,jj); then what leaving S out does to frequency responses and to fitted stiffnesses and dampings.

FINDING, Manutec r3, five random configurations, 1 to 60 Hz (first number `before`, second `forearm`)

At the published ratios S is at most 0.4 % and 1.2 % of the diagonal of M, 0.6 % and 1.2 % normalised by both sides.
Without it responses of motors to their own torque are off by 0.05 and 0.14 dB rms (up to 0.3 and 2.2 dB beside sharp
antiresonances), resonances by up to 0.3 % and 0.5 %, fitted stiffnesses by up to 0.2 % and 0.7 %, dampings by about 1
%. A fit to responses with 1 % noise sees the difference (residuals of 3 sigma instead of 1), one with the usual model
error of 1 to 3 % does not: the reduced model does for such a robot. All of it grows as 1 / ratio: at a third of the
ratios stiffnesses are off by 0.7 % and 2.2 %, at a tenth (6 to 21) by 3 % and 7 %, dampings by 50 % and 16 %,
resonances by 3 % and 5 %; there the complete model is needed. The largest part is not the coupling between axes but
motors that ride on the link that they drive, about the joint's own axis: such a rotor turns with ratio + 1 instead of
ratio.
"""

# One BLAS thread must be asked for before NumPy is loaded.
# ruff: noqa: E402
import os

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import argparse
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
from pydantic import TypeAdapter
from ruamel.yaml import YAML

from elastid.base.arrays import FloatArray
from elastid.fit.identify import identify
from elastid.fit.result import FitResult
from elastid.fit.spec import FitSpec, ParameterSpec, WeightSpec
from elastid.linear.linearise import Linearisation
from elastid.linear.modes import modes
from elastid.linear.response.transfer import to_response
from elastid.model.formulation import serial
from elastid.record import Configuration
from elastid.response import Covariance, FrequencyResponse
from elastid.robot import BASE, Body, Joint, Robot, Spring, unit_axis

MANUTEC = Path(__file__).parents[2] / "configs" / "robots" / "manutec_r3.yml"
FREQ_HZ = np.linspace(1, 60, 119)
PLACEMENTS = ("before", "forearm")
# Relative standard deviation of the responses that are fitted.
NOISE = 0.01


def read_robot(path: Path) -> Robot:
    robot: Robot = TypeAdapter(Robot).validate_python(YAML(typ="safe").load(path.read_text()))
    return robot


def changed(robot: Robot, change: Callable[[Body, Joint], Joint]) -> Robot:
    """The robot with other driven joints."""
    return replace(
        robot,
        bodies=tuple(
            replace(body, joints=tuple(change(body, j) if j.motor is not None else j for j in body.joints))
            for body in robot.bodies
        ),
    )


def placed(robot: Robot, placement: str) -> Robot:
    """The robot with its motors on bodies, as FINDING says; of each body the first joint is the driven one."""
    moved = {joint.name: body for body in robot.bodies for joint in body.joints if joint.motor is not None}
    order = list(moved)
    arm = moved[order[min(2, len(order) - 1)]].name

    def riding(body: Body, joint: Joint) -> Joint:
        place = order.index(joint.name)
        axis = unit_axis(joint.axis)
        carrier, seen = body.parent, tuple(body.placement.rotation @ axis)
        if placement == "forearm" and place in (0, 2):
            carrier, seen = body.name, tuple(axis)
        elif placement == "forearm" and place > 2:
            fourth = next(b for b in robot.bodies if b.name == moved[order[3]].name)
            carrier, seen = arm, tuple(fourth.placement.rotation @ unit_axis(fourth.joints[0].axis))
        return replace(joint, motor=replace(joint.motor, on=carrier, axis=seen))

    return changed(robot, riding)


def reduced(robot: Robot) -> Robot:
    """Without S: rotors turn about their own axes only, and the carriers hold what the rotors add to them, locked."""
    added: dict[str, FloatArray] = {}
    for joint in robot.driven:
        axis = unit_axis(joint.motor.axis)
        more = joint.motor.inertia * np.outer(axis, axis)
        added[joint.motor.on] = added.get(joint.motor.on, np.zeros((3, 3))) + more
    alone = changed(robot, lambda _, joint: replace(joint, motor=replace(joint.motor, on="", axis=None)))

    def heavier(body: Body) -> Body:
        if body.name not in added or body.name == BASE:
            return body
        I = body.inertia_matrix + added[body.name]  # noqa: E741
        return replace(body, inertia=(I[0, 0], I[1, 1], I[2, 2], I[0, 1], I[0, 2], I[1, 2]))

    return replace(alone, bodies=tuple(heavier(body) for body in alone.bodies))


def geared_down(robot: Robot, factor: float) -> Robot:
    """Gear ratios divided by `factor`, the motors the same as seen from the link."""

    def slower(_: Body, joint: Joint) -> Joint:
        motor = joint.motor
        return replace(
            joint,
            motor=replace(
                motor,
                ratio=motor.ratio / factor,
                inertia=motor.inertia * factor**2,
                viscous=motor.viscous * factor**2,
                coulomb=motor.coulomb * factor,
            ),
        )

    return changed(robot, slower)


def normalised(robot: Robot, angles: FloatArray) -> tuple[FloatArray, FloatArray]:
    """S_ij / M_ii and S_ij / sqrt(M_ii M_m,jj) (n_u, n_u) of the driven joints at angles (n_u,), link side."""
    elastic = changed(robot, lambda _, joint: replace(joint, spring=joint.spring or Spring(1e6)))
    model = serial(elastic)
    q = np.zeros(model.n_q)
    links = [model.index(f"joint {joint.name}") for joint in elastic.driven]
    motors = [model.index(f"motor {joint.name}") for joint in elastic.driven]
    q[links] = q[motors] = angles
    M = model.mass(q, model.theta).full()
    S, M_l, M_m = M[np.ix_(links, motors)], np.diag(M)[links], np.diag(M)[motors]
    return S / M_l[:, None], S / np.sqrt(np.outer(M_l, M_m))


def responses(robot: Robot, configurations: list[Configuration]) -> list[FrequencyResponse]:
    """Exact, with the standard deviation that is pretended."""
    model = serial(robot)
    linearisation = Linearisation.of(model)
    found = []
    for configuration in configurations:
        linear = linearisation.at(configuration, model.theta, robot.motor_locations, "acceleration")
        exact = to_response(linear, linear.theta_ref, FREQ_HZ)
        std = NOISE * (np.abs(exact.G) + 0.01 * np.abs(exact.G).max(axis=0))
        found.append(replace(exact, total=Covariance(std**2, np.inf)))
    return found


def frequencies(robot: Robot, configuration: Configuration) -> FloatArray:
    model = serial(robot)
    linear = Linearisation.of(model).at(configuration, model.theta, robot.motor_locations, "acceleration")
    return modes(replace(linear, D=0 * linear.D), linear.theta_ref).freq_hz


def effect(complete: Robot, without: Robot, configurations: list[Configuration]) -> dict[str, float]:
    """Of S on frequency responses of motors to their own torque (dB), to others, and on resonances (%)."""
    own, cross, shift = [], [], []
    for with_S, bare, configuration in zip(
        responses(complete, configurations), responses(without, configurations), configurations, strict=True
    ):
        diagonal = np.abs(np.diagonal(with_S.G, axis1=1, axis2=2))
        own.append(20 * np.log10(diagonal / np.abs(np.diagonal(bare.G, axis1=1, axis2=2))))
        relative = np.abs(with_S.G - bare.G) / np.sqrt(diagonal[:, :, None] * diagonal[:, None, :])
        cross.append(relative[:, ~np.eye(relative.shape[1], dtype=bool)])
        f, f_bare = frequencies(complete, configuration), frequencies(without, configuration)
        shift.append(100 * np.abs(f / f_bare - 1).max())
    return {
        "own_db_rms": float(np.sqrt(np.mean(np.square(own)))),
        "own_db_largest": float(np.abs(own).max()),
        "cross_relative_median": float(np.median(np.concatenate(cross))),
        "cross_relative_largest": float(np.concatenate(cross).max()),
        "resonance_percent_largest": float(max(shift)),
    }


def fitted(robot: Robot, measured: list[FrequencyResponse], seed: int) -> FitResult:
    """Every stiffness and damping, from the true ones: where the optimum lies, not whether it is found."""
    spec = FitSpec(parameters={"k_*": ParameterSpec(), "d_*": ParameterSpec()}, starts=1, weights=WeightSpec(floor=0.0))
    return identify(measured, robot, replace(spec, seed=seed))


def bias(complete: Robot, without: Robot, configurations: list[Configuration], seed: int) -> dict[str, float]:
    """Of the fitted stiffnesses and dampings in percent where S is left out; error over sigma of the best fit."""
    measured = responses(complete, configurations)
    result = fitted(without, measured, seed)
    truth = complete.parameters()
    off = {name: 100 * (result.values[name] / truth[name][0] - 1) for name in result.parameters.free_names}
    k, d = ([abs(v) for name, v in off.items() if name[0] == letter] for letter in "kd")
    own = fitted(complete, measured, seed)
    return {
        "stiffness_percent_largest": max(k),
        "damping_percent_largest": max(d),
        "error_over_sigma": float(np.sqrt(result.cost / result.dof)),
        "error_over_sigma_complete": float(np.sqrt(own.cost / own.dof)),
    }


def show(title: str, matrix: FloatArray) -> None:
    print(f"  {title}")
    for i, row in enumerate(matrix, start=1):
        print(f"    row {i} " + "".join(f"{100 * value:9.3f}" for value in row))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="one ratio, two configurations")
    parser.add_argument("--robot", type=Path, default=MANUTEC)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    robot = read_robot(given.robot)
    n_u, rng = len(robot.driven), np.random.default_rng(given.seed)
    count = 2 if given.quick else 5
    configurations = [Configuration(f"c{i}", tuple(rng.uniform(-1.2, 1.2, n_u))) for i in range(count)]
    extremes = [np.array([0.0, 0.0, sign * np.pi / 2, *[0.0] * n_u])[:n_u] for sign in (1, -1)]
    side = 3 if given.quick else 9
    grid = [np.array([0.0, a, b, *[0.3] * n_u])[:n_u] for a in np.linspace(-1.5, 1.5, side)
            for b in np.linspace(-2, 2, side)]  # fmt: skip
    found: dict[str, dict[str, float]] = {}
    for placement in PLACEMENTS:
        at_ratio = placed(robot, placement)
        print(f"{robot.name}, motors placed `{placement}`, published ratios; in percent")
        for angles, name in zip(extremes, ("q3 = +90 deg", "q3 = -90 deg"), strict=True):
            show(f"S_ij / M_ii at {name}", normalised(at_ratio, angles)[0])
        both = [normalised(at_ratio, angles) for angles in (*grid, *extremes)]
        show("largest |S_ij| / M_ii over joints 2 and 3", np.max([np.abs(a) for a, _ in both], axis=0))
        show("largest |S_ij| / sqrt(M_ii M_m,jj)", np.max([np.abs(b) for _, b in both], axis=0))
        for factor in (1.0,) if given.quick else (1.0, 3.0, 10.0):
            complete = geared_down(at_ratio, factor)
            without = reduced(complete)
            row = {"largest_normalised_percent": 100 * float(np.max([np.abs(b) for _, b in both])) * factor}
            row |= effect(complete, without, configurations)
            row |= bias(complete, without, configurations, given.seed)
            found[f"{placement}, ratios / {factor:g}"] = {key: float(f"{value:.4g}") for key, value in row.items()}
    print(f"\n{'':24}" + "".join(f"{name:>22}" for name in found))
    for key in next(iter(found.values())):
        print(f"{key:28}" + "".join(f"{row[key]:>22.4g}" for row in found.values()))
    print(json.dumps({"robot": robot.name, "noise": NOISE, "effects": found}))


if __name__ == "__main__":
    main()
