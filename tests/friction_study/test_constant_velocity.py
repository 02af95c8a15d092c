"""Levels of friction from passes there and back under gravity, ripple and an offset.

Passes under several loads have gravity of their own and one curve of friction.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from plants.friction_records import records, simulated, template
from plants.marks import slow
from plants.refusals import refused

from elastid.app.commanded_robot import robot_of_friction
from elastid.base.arrays import FloatArray
from elastid.friction_record import FrictionRecord, FrictionRecords
from elastid.friction_study.constant_velocity import FrictionCurve, Pass, estimate_friction_curve, passes_of
from elastid.friction_study.result import FrictionResult, SlidingFriction, identify_friction, law_numbers, true_numbers
from elastid.friction_study.sliding_friction import identify_sliding_friction
from elastid.friction_study.spec import LawSpec
from elastid.friction_study.static_model_fit import StaticLaw
from elastid.robot import Body, Friction, Joint, LoadDependence, Motor, Robot, TemperatureDependence
from elastid.robot.friction_numbers import friction_numbers
from elastid.study import load_robot

# A motor of a large robot: rad/s and Nm on its side, gravity 3.7 times its friction.
GRAVITY, OFFSET, RIPPLE, INERTIA = 3.5, 0.05, (0.06, 0.04), 7e-3
F_C, F_S, NU_S, VISCOUS = 0.95, 1.5, 14.4, 3.4e-3
SPEEDS = tuple(np.geomspace(1.0, 250.0, 12))
RATIO = 242.73


def level(v: FloatArray) -> FloatArray:
    return F_C + (F_S - F_C) * np.exp(-((v / NU_S) ** 2)) + VISCOUS * v


def passes(
    seed: int, speeds: Sequence[float] = SPEEDS, noise: float = 0.05, memory: float = 0.0, uneven: float = 0.0
) -> list[Pass]:
    """There and back over 1 rad of the joint (at most 10 s), still settling; noise correlated over memory s."""
    rng, rate, found = np.random.default_rng(seed), 250.0, []
    for v in speeds:
        n = int(min(10.0, 1.0 * RATIO / v) * rate)
        t = np.arange(n) / rate
        for s in (1.0, -1.0):
            velocity = s * v * (1 - 0.04 * np.exp(-t / 0.1))
            q = 0.3 + np.cumsum(velocity) / rate
            white = rng.standard_normal(n + 500)
            coloured = white[500:]
            if memory:
                kernel = np.exp(-np.arange(500) / (memory * rate))
                coloured = np.convolve(white, kernel / np.linalg.norm(kernel))[500 : 500 + n]
            acceleration = np.gradient(velocity, 1 / rate)
            u = (
                s * level(np.abs(velocity)) + uneven * np.abs(velocity) + OFFSET + INERTIA * acceleration
                + GRAVITY * np.cos(q / RATIO) + RIPPLE[0] * np.cos(q) + RIPPLE[1] * np.sin(2 * q) + noise * coloured
            )  # fmt: skip
            angle = q / RATIO
            found.append(Pass("motor 2", f"{v:.4g}", angle, velocity, acceleration, u, slides=False))
    return found


def test_levels_are_right_under_gravity_of_four_times_the_friction() -> None:
    """Without noise within 0.2 %, with 5 % of noise within 0.4 % at the median speed and as stated elsewhere."""
    quiet = estimate_friction_curve(passes(0, noise=0.0), True, 2 * np.pi / RATIO)
    np.testing.assert_allclose(quiet.torque, level(quiet.speed), rtol=2e-3)
    found = estimate_friction_curve(passes(1), True, 2 * np.pi / RATIO)
    error = found.torque / level(found.speed) - 1
    assert np.median(np.abs(error)) < 0.004
    assert np.max(np.abs(error) * found.torque / found.std) < 4
    assert found.shared["gravity.cos"][0] == pytest.approx(GRAVITY, rel=0.01)
    offset, std = found.shared["offset"]
    assert abs(offset - OFFSET) < 4 * std < 0.02
    assert found.notes == ()


@pytest.mark.slow
@pytest.mark.parametrize("memory", [slow(0.0), 0.03])
def test_levels_are_covered_whatever_the_noise_remembers(memory: float) -> None:
    """12 campaigns of 12 speeds: 95 % intervals hold 91 % or more."""
    held = []
    for seed in range(12):
        levels = estimate_friction_curve(passes(seed, memory=memory), True, 2 * np.pi / RATIO)
        held += list(np.abs(levels.torque - level(levels.speed)) < 1.96 * levels.std)
    assert 0.91 < np.mean(held) < 0.99


def test_slopes_of_two_directions_are_no_offset() -> None:
    levels = estimate_friction_curve(passes(2, uneven=6e-4), True, 2 * np.pi / RATIO)
    assert set(levels.direction) == {1.0, -1.0}
    assert StaticLaw.of(levels, LawSpec()).values["directions.viscous"] == pytest.approx(6e-4, rel=0.15)
    assert set(estimate_friction_curve(passes(3), True, 2 * np.pi / RATIO).direction) == {0.0}


@pytest.mark.parametrize(
    ("wrong", "code"),
    [
        ([one for one in passes(0, SPEEDS[:3]) if one.direction > 0], "friction/constant-velocity"),
        (
            [
                replace(one, velocity=one.velocity * np.cos(np.arange(len(one.velocity))))
                for one in passes(0, SPEEDS[:3])
            ],
            "friction/constant-velocity-runs",
        ),
        (passes(0, SPEEDS[-2:], noise=30.0), "friction/constant-velocity"),
    ],
)
def test_passes_that_tell_nothing_are_refused(wrong: list[Pass], code: str) -> None:
    """One direction, velocities that vary, noise of five times the friction."""
    with refused(code):
        estimate_friction_curve(wrong, True)


# Growth of Coulomb friction with the load, Nm per Nm.
BY_LOAD = 0.04
SMALL = ("friction.rate_hz=250", "friction.constant_velocity.count=5", "friction.constant_velocity.repeat=1")


def loaded(record: FrictionRecord, load: float) -> FrictionRecord:
    """The same pass with a further torque of gravity, and friction that grows with it."""
    assert record.velocity is not None
    further = -load * np.sin(record.position) + BY_LOAD * load * np.sign(record.velocity)
    return replace(record, torque=record.torque + further, load=f"{load:g}", load_torque=load)


def test_gravity_of_one_load_is_not_friction_of_another() -> None:
    """Levels grow by what friction does, to its noise, although gravity grows by far more."""
    _, measured = records(template(*SMALL))
    loads = (0.0, 100.0, 200.0)
    every = [loaded(one, load) for load in loads for one in measured.records]
    levels = estimate_friction_curve([each for record in every for each in passes_of(record)], True)
    n = levels.n_conditions // 3
    assert not levels.direction.any()
    for i in (1, 2):
        more = levels.torque[i * n : (i + 1) * n] - levels.torque[:n]
        # The noise of the three is one and the same.
        assert more == pytest.approx(np.full(n, BY_LOAD * loads[i]), abs=0.02)
        assert levels.load[i * n] == loads[i]


@pytest.fixture(scope="module")
def found() -> FrictionResult:
    loaded = template()
    study, (_, measured) = loaded.study, records(loaded)
    levels = identify_sliding_friction(study.as_robot(), study.friction_joints, measured)
    return identify_friction(study.as_robot(), levels, measured, study.as_friction(), simulated(loaded))


@pytest.mark.slow
def test_the_numbers_are_those_of_the_truth(found: FrictionResult) -> None:
    """Each within its interval of 99.9 %; parts that one load and no thermometer cannot show are held with reasons."""
    numbers = {number.name: number for number in found.numbers}
    assert {"Fc_m1", "Fs_m1", "vs_m1", "f_m1"} <= set(numbers)
    for name in ("Fc_m1", "Fs_m1", "vs_m1", "f_m1"):
        one = numbers[name]
        assert one.truth is not None
        assert abs(one.value - one.truth) < 3.3 * one.std + 2e-3 * one.truth, name
        assert one.std < 0.05 * one.value
    assert found.status == "identified"
    assert {held.term for held in found.at("1").unidentified} >= {"load", "temperature"}


def test_the_robots_file_has_the_law_and_its_ranges(found: FrictionResult, tmp_path: Path) -> None:
    """Read back, it is the robot whose friction has the numbers of the table, on the side of the motor."""
    text = robot_of_friction(template().study.name, template().study.as_robot(), found)
    assert all(f"#   {number.name} = " in text for number in found.numbers)
    (tmp_path / "robot.yml").write_text(text)
    numbers = friction_numbers(load_robot(tmp_path / "robot.yml"))
    table = {number.name: number.value for number in found.numbers}
    for name in ("Fc_m1", "Fs_m1", "vs_m1", "f_m1"):
        assert numbers[name][0] == pytest.approx(table[name], rel=1e-9)
    motor = load_robot(tmp_path / "robot.yml").driven[0].motor
    assert motor.friction.measured.speed == pytest.approx((0.87, 157.1), rel=0.02)


def test_numbers_that_no_contact_has_make_no_law() -> None:
    """Viscous friction that would drive backwards: no number of it is stated, and a note says why."""
    v, s = (x.ravel() for x in np.meshgrid(np.geomspace(0.02, 2, 10), (1.0, -1.0), indexing="ij"))
    one = np.ones_like(v)
    levels = FrictionCurve("joint 1", v, s, 9 + (0.5 + 3 * s) * v, 0.01 * one, 0 * one, np.nan * one)
    found = SlidingFriction("1", False, levels)
    study = template().study
    result = identify_friction(study.as_robot(), [found], FrictionRecords(()), study.as_friction())
    assert (result.status, result.at("1").friction) == ("failed", None)
    assert result.numbers == ()
    assert [note.code for note in result.at("1").notes] == ["friction/law"]


def test_runs_at_one_speed_give_its_torque_and_no_law() -> None:
    """At 1.2 rad/s from 25 to 45 degC: the torque there and its change with temperature, without Coulomb friction."""
    (scatter, noise), degc = np.random.default_rng(4).standard_normal((2, 40)), np.linspace(25, 45, 40)
    v, torque = 1.2 * (1 + 3e-3 * scatter), 9.6 - 0.05 * (degc - 35) + 0.05 * noise
    levels = FrictionCurve("joint 1", v, 0 * v, torque, 0.05 + 0 * v, 0 * v, degc)
    study, joints = template().study, [SlidingFriction("1", False, levels)]
    found = identify_friction(study.as_robot(), joints, FrictionRecords(()), study.as_friction())
    numbers = {row.name: row.value for row in found.numbers}
    assert numbers == {"tau_m1": pytest.approx(9.6, abs=0.05), "tauT_m1": pytest.approx(-0.05, abs=0.01)}
    assert (found.status, found.at("1").friction) == ("partly", None)


def test_warm_loaded_joint_has_numbers_of_its_torques() -> None:
    """20 K above the reference and under 30 Nm; the file's numbers where nothing is compared."""
    warm = TemperatureDependence(25.0, stiction=0.002, viscous=1e-3, decay=20.0)
    law = Friction(0.2, 0.3, 5.0, load=LoadDependence(0.05, 0.08), temperature=warm)
    joint = Joint("1", motor=Motor(1e-3, 100.0, viscous=2e-3, friction=law))
    robot = Robot("axis", (Body("arm", joints=(joint,), mass=3.0, inertia=1.0),))
    speed = np.geomspace(0.01, 1.0, 8)
    same = np.ones_like(speed)
    levels = FrictionCurve("joint 1", speed, 0 * same, 20 + 10 * speed, 0.1 * same, 30 * same, 45 * same)
    found = true_numbers(robot, "1", StaticLaw.of(levels, LawSpec()))
    fading = math.exp(-1.0)
    expected = {"Fc_m1": 20 + 1.5, "Fs_m1": 30 + 0.2 * 20 + 2.4, "f_m1": 20 + 10 * (fading - 1), "fT_m1": 10 * fading}
    assert {name: found[name] for name in expected} == pytest.approx(expected)
    assert true_numbers(robot, "1")["Fc_m1"] == pytest.approx(20.0)


def test_direction_intervals_scale_with_std_as_mean() -> None:
    """F_c forwards 24, backwards 20, and as many std to each end as of F_c itself."""
    speed = np.tile(np.geomspace(0.01, 1.0, 8), 2)
    way = np.repeat([1.0, -1.0], 8)
    levels = FrictionCurve("joint 1", speed, way, 22 + 2 * way + 9 * speed, 0.1 + 0 * speed, 0 * speed, np.nan * speed)
    rows = {row.name: row for row in law_numbers("1", StaticLaw.of(levels, LawSpec()), {})}
    mean, forwards, backwards = (rows[name] for name in ("Fc_m1", "Fc_m1+", "Fc_m1-"))
    assert (forwards.value, backwards.value) == (pytest.approx(24.0, abs=0.1), pytest.approx(20.0, abs=0.1))
    for row in (forwards, backwards):
        assert (row.high - row.value) / row.std == pytest.approx((mean.high - mean.value) / mean.std)
