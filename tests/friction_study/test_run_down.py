"""Run-downs of an axis with a known, unbalanced rotor: friction over speed, against an integrator of its own."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from plants.refusals import refused

from elastid.experiment.specs.channels import ChannelSpec
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.recorded import FileSpec, RecordedSpec
from elastid.friction_study.joint_levels import find_joint_levels
from elastid.friction_study.result import FrictionResult, identify_friction
from elastid.friction_study.spec import FrictionSpec
from elastid.record import FrictionRecords
from elastid.recorded.friction_logs import read_friction_logs
from elastid.robot import Body, Joint, Motor, Robot
from elastid.validation.friction_twin import friction_balances

RATE, COUNTS = 1000, 65536
MASS, LEVER, INERTIA = 4.0, 0.05, 2.0
F_C, F_S, NU_S, VISCOUS = 3.0, 4.2, 2.0, 0.05
ROBOT = Robot(
    "spindle",
    (
        Body(
            "rotor", joints=(Joint("1", "y", motor=Motor(0.5)),), mass=MASS, center_of_mass=(LEVER, 0.0, 0.0),
            inertia=INERTIA - 0.5 - MASS * LEVER**2,
        ),
    ),
)  # fmt: skip
CHANNELS = (
    ChannelSpec("u", "motor 1", "torque"),
    ChannelSpec("y", "motor 1", "angle", quantity="position"),
)


@cache
def coasting(start: float, drive: float = 0.0) -> np.ndarray:
    """Angle (n,) of a run-down to standstill, semi-implicit at 50 kHz; drive: torque until it is switched off."""
    q, v, h, angles = 0.3, start, 1 / (50 * RATE), []
    s = np.sign(start)
    while s * v > 0:
        angles.append(q)
        for _ in range(50):
            friction = s * (F_C + (F_S - F_C) * np.exp(-((v / NU_S) ** 2))) + VISCOUS * v
            # About y a positive angle lowers the rotor's centre of mass.
            v += h * (drive + 9.81 * MASS * LEVER * np.cos(q) - friction) / INERTIA
            q += h * v
    return np.concatenate([angles, np.full(RATE, q)])


def identified(folder: Path, starts: tuple[float, ...], seed: int = 0, drive: float = 0.0) -> FrictionResult:
    rng = np.random.default_rng(seed)
    for i, start in enumerate(starts):
        angle = coasting(start, drive)
        angle = np.round((angle + 2e-5 * rng.standard_normal(len(angle))) * COUNTS / (2 * np.pi)) * 2 * np.pi / COUNTS
        rows = "\n".join(f"{drive},{x:.9g}" for x in angle)
        (folder / f"{i}.csv").write_text(f"torque,angle\n{rows}\n")
    files = tuple(FileSpec(f"{i}.csv", purpose="run_down") for i in range(len(starts)))
    spec = ExperimentSpec(recorded=RecordedSpec(float(RATE), CHANNELS, files))
    measured = read_friction_logs(ROBOT, spec, folder, ["1"], {})
    levels = find_joint_levels(ROBOT, ROBOT.driven, measured)
    return identify_friction(ROBOT, levels, measured, FrictionSpec())


@pytest.mark.slow
def test_a_run_down_gives_friction_over_speed_with_intervals(tmp_path: Path) -> None:
    """Coulomb, viscous and Stribeck friction of 6 draws: 95 % intervals hold at least 14 of 18, none is useless."""
    inside = []
    for seed in range(6):
        result = identified(tmp_path, (40.0, 40.0, 15.0, 6.0), seed)
        numbers = {number.symbol: number for number in result.numbers}
        for symbol, truth in (("F_c", F_C), ("f", VISCOUS), ("F_s", F_S)):
            number = numbers[symbol]
            inside.append(number.low <= truth <= number.high)
            assert number.high - number.low < 0.3 * truth, (symbol, number)
    assert sum(inside) >= 14


@pytest.mark.slow
def test_run_downs_both_ways_have_the_law_and_no_balance(tmp_path: Path) -> None:
    result = identified(tmp_path, (40.0, -40.0))
    numbers = {number.symbol: number.value for number in result.numbers}
    v = np.geomspace(0.5, 40, 20)
    truth = F_C + (F_S - F_C) * np.exp(-((v / NU_S) ** 2)) + VISCOUS * v
    fall = (numbers["F_s"] - numbers["F_c"]) * np.exp(-((v / numbers["nu_s"]) ** numbers.get("a", 2.0)))
    np.testing.assert_allclose(numbers["F_c"] + fall + numbers["f"] * v, truth, rtol=0.03)
    assert friction_balances(result.joints, FrictionRecords(())) == ()


def test_a_known_torque_that_brakes_is_no_friction(tmp_path: Path) -> None:
    result = identified(tmp_path, (40.0,), drive=-1.0)
    number = next(number for number in result.numbers if number.symbol == "F_c")
    assert number.value == pytest.approx(F_C, abs=0.15)


def test_a_motion_one_way_names_the_run_down(tmp_path: Path) -> None:
    """As a motion it is refused; a torque of zeros too."""
    identified(tmp_path, (40.0,), drive=-1.0)
    spec = ExperimentSpec(recorded=RecordedSpec(float(RATE), CHANNELS, (FileSpec("0.csv"),)))
    with refused("records/values"):
        read_friction_logs(ROBOT, spec, tmp_path, ["1"], {})
    measured = read_friction_logs(
        ROBOT,
        ExperimentSpec(recorded=RecordedSpec(float(RATE), CHANNELS, (FileSpec("0.csv", purpose="run_down"),))),
        tmp_path, ["1"], {},
    )  # fmt: skip
    as_motion = replace(measured, records=tuple(replace(record, purpose="motion") for record in measured.records))
    with refused("friction/no-record", holds="run_down"):
        find_joint_levels(ROBOT, ROBOT.driven, as_motion)
