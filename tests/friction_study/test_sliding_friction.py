"""Levels by logs: the gain of a drive by a payload, and run-downs of a rotor, by integrators of their own."""

import math
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from plants.friction_logs import COULOMB, INERTIA, RATE, RATIO, ROBOT, logs, sliding_torque, trapezoids, write_log
from plants.friction_study import friction_study
from plants.refusals import refused

from elastid.base.statistics import QUANTILE_95
from elastid.experiment.specs.channels import ChannelSpec
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.logs import FileSpec, RecordedSpec
from elastid.friction_record import FrictionRecords
from elastid.friction_study.result import FrictionResult
from elastid.friction_study.sliding_friction import identify_sliding_friction
from elastid.logs.friction_logs import read_friction_logs
from elastid.robot import Body, Frame, Joint, Motor, Placement, Robot
from elastid.validation.friction_simulation import friction_balances

LENGTH, PAYLOAD = 0.8, 5.0
ROBOT_WITH_TOOL = replace(ROBOT, frames=(Frame("tool", "arm", Placement((LENGTH, 0.0, 0.0))),))
Q = trapezoids([0.2, 0.5, 0.35])


def identified(folder: Path, gain: float, loads: tuple[str, ...], seed: int = 0) -> FrictionResult:
    a = np.gradient(np.gradient(Q, 1 / RATE), 1 / RATE)
    carried = PAYLOAD * (LENGTH**2 * a - 9.81 * LENGTH * np.cos(Q))
    for i, load in enumerate(loads):
        write_log(folder / f"{i}.csv", Q, gain * (sliding_torque(Q, seed + i) + (carried if load == "full" else 0.0)))
    files = [FileSpec(f"{i}.csv", load=load) for i, load in enumerate(loads)]
    payloads = {"empty": 0.0, "full": PAYLOAD}
    return friction_study(ROBOT_WITH_TOOL, read_friction_logs(ROBOT_WITH_TOOL, logs(*files), folder, ["1"], payloads))


@pytest.mark.slow
@pytest.mark.parametrize("gain", [0.9, 1.0, 1.15])
def test_a_payload_on_and_off_gives_the_gain_with_its_interval(gain: float, tmp_path: Path) -> None:
    """Inside its interval in 7 of 8 draws and within 1 % in all; the order of the logs does not matter."""
    inside = []
    for seed in range(0, 16, 2):
        result = identified(tmp_path, gain, ("full", "empty"), seed)
        number = next(number for number in result.numbers if number.name == "gain_u_motor_1")
        assert number.value == pytest.approx(gain, rel=0.01)
        inside.append(number.low <= gain <= number.high)
    assert sum(inside) >= 7
    symbols = {number.symbol: number.value for number in result.numbers}
    assert symbols["J"] == pytest.approx(gain * INERTIA, rel=0.02)
    assert symbols["F_c"] == pytest.approx(gain * COULOMB, rel=0.05)


@pytest.mark.parametrize("loads", [("empty", "empty"), ("full", "full")])
def test_without_a_difference_no_gain_is_known(loads: tuple[str, ...], tmp_path: Path) -> None:
    """All other parameters have intervals; inertia includes the payload."""
    result = identified(tmp_path, 1.1, loads)
    assert not any(number.name.startswith("gain") for number in result.numbers)
    for number in result.numbers:
        reach = QUANTILE_95 * number.std
        assert (number.value - number.low, number.high - number.value) == pytest.approx((reach, reach), rel=0.2)
    inertia = INERTIA + PAYLOAD * LENGTH**2 * (loads[0] == "full")
    (joint,) = result.joints
    assert joint.shared["inertia"][0] == pytest.approx(1.1 * inertia, rel=0.05)
    assert (joint.misfit, [part.term for part in joint.missing], result.status) == ("", ["stribeck"], "partly")


@pytest.mark.parametrize("inertia", [0.0, 0.3 * INERTIA])
def test_unrelated_torque_gives_status_failed(inertia: float, tmp_path: Path) -> None:
    """Noise in place of the torque of friction and gravity; a significant inertia is no friction."""
    torque = inertia * np.gradient(np.gradient(Q, 1 / RATE), 1 / RATE)
    write_log(tmp_path / "0.csv", Q, torque + 20 * np.random.default_rng(3).standard_normal(len(Q)))
    result = friction_study(ROBOT, read_friction_logs(ROBOT, logs(FileSpec("0.csv")), tmp_path, ["1"], {}))
    assert result.status == "failed"


@pytest.mark.parametrize("factor", [1 / RATIO, 1 / RATIO**2, RATIO])
def test_mixed_sides_of_a_gear_are_refused(factor: float, tmp_path: Path) -> None:
    with refused("friction/rigid-body", place="0.csv"):
        identified(tmp_path, factor, ("empty",))


RATE_RUN_DOWN, COUNTS = 1000, 65536
MASS, LEVER, INERTIA_RUN_DOWN = 4.0, 0.05, 2.0
F_C, F_S, NU_S, VISCOUS = 3.0, 4.2, 2.0, 0.05
SPINDLE = Robot(
    "spindle",
    (
        Body(
            "rotor", joints=(Joint("1", "y", motor=Motor(0.5)),), mass=MASS, center_of_mass=(LEVER, 0.0, 0.0),
            inertia=INERTIA_RUN_DOWN - 0.5 - MASS * LEVER**2,
        ),
    ),
)  # fmt: skip
CHANNELS = ChannelSpec("u", "motor 1", "torque"), ChannelSpec("y", "motor 1", "angle", quantity="position")


@cache
def coasting(start: float, drive: float = 0.0) -> np.ndarray:
    """Angle (n,) of a run-down to standstill, semi-implicit at 50 kHz; drive: torque until it is switched off."""
    q, v, h, angles = 0.3, start, 1 / (50 * RATE_RUN_DOWN), []
    s = np.sign(start)
    while s * v > 0:
        angles.append(q)
        for _ in range(50):
            friction = s * (F_C + (F_S - F_C) * math.exp(-((v / NU_S) ** 2))) + VISCOUS * v
            # About y a positive angle lowers the rotor's centre of mass.
            v += h * (drive + 9.81 * MASS * LEVER * math.cos(q) - friction) / INERTIA_RUN_DOWN
            q += h * v
    return np.concatenate([angles, np.full(RATE_RUN_DOWN, q)])


def read_spindle(folder: Path, *files: FileSpec) -> FrictionRecords:
    spec = ExperimentSpec(recorded=RecordedSpec(float(RATE_RUN_DOWN), CHANNELS, files))
    return read_friction_logs(SPINDLE, spec, folder, ["1"], {})


def identified_run_down(folder: Path, starts: tuple[float, ...], seed: int = 0, drive: float = 0.0) -> FrictionResult:
    rng = np.random.default_rng(seed)
    for i, start in enumerate(starts):
        angle = coasting(start, drive)
        angle = np.round((angle + 2e-5 * rng.standard_normal(len(angle))) * COUNTS / (2 * np.pi)) * 2 * np.pi / COUNTS
        rows = "\n".join(f"{drive},{x:.9g}" for x in angle)
        (folder / f"{i}.csv").write_text(f"torque,angle\n{rows}\n")
    files = (FileSpec(f"{i}.csv", purpose="coast_down") for i in range(len(starts)))
    return friction_study(SPINDLE, read_spindle(folder, *files))


@pytest.mark.slow
def test_a_run_down_gives_friction_over_speed_with_intervals(tmp_path: Path) -> None:
    """Coulomb, viscous and Stribeck friction of 6 draws: 95 % intervals hold at least 14 of 18, none is useless."""
    inside = []
    for seed in range(6):
        result = identified_run_down(tmp_path, (40.0, 40.0, 15.0, 6.0), seed)
        numbers = {number.symbol: number for number in result.numbers}
        for symbol, truth in (("F_c", F_C), ("f", VISCOUS), ("F_s", F_S)):
            number = numbers[symbol]
            inside.append(number.low <= truth <= number.high)
            assert number.high - number.low < 0.3 * truth, (symbol, number)
    assert sum(inside) >= 14


@pytest.mark.slow
def test_run_downs_both_ways_have_the_law_and_no_balance(tmp_path: Path) -> None:
    result = identified_run_down(tmp_path, (40.0, -40.0))
    numbers = {number.symbol: number.value for number in result.numbers}
    v = np.geomspace(0.5, 40, 20)
    truth = F_C + (F_S - F_C) * np.exp(-((v / NU_S) ** 2)) + VISCOUS * v
    fall = (numbers["F_s"] - numbers["F_c"]) * np.exp(-((v / numbers["nu_s"]) ** numbers.get("a", 2.0)))
    np.testing.assert_allclose(numbers["F_c"] + fall + numbers["f"] * v, truth, rtol=0.03)
    assert friction_balances(result.joints, FrictionRecords(())) == ()


@pytest.mark.slow
def test_a_known_torque_that_brakes_is_no_friction(tmp_path: Path) -> None:
    result = identified_run_down(tmp_path, (40.0,), drive=-1.0)
    number = next(number for number in result.numbers if number.symbol == "F_c")
    assert number.value == pytest.approx(F_C, abs=0.15)


def test_a_motion_one_way_names_the_run_down(tmp_path: Path) -> None:
    """As a motion it is refused; a torque of zeros too."""
    identified_run_down(tmp_path, (40.0,), drive=-1.0)
    with refused("records/values"):
        read_spindle(tmp_path, FileSpec("0.csv"))
    measured = read_spindle(tmp_path, FileSpec("0.csv", purpose="coast_down"))
    as_motion = replace(measured, records=tuple(replace(record, purpose="motion") for record in measured.records))
    with refused("friction/no-record", holds="coast_down"):
        identify_sliding_friction(SPINDLE, SPINDLE.driven, as_motion)
