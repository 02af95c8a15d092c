"""Code in C of a move, of friction's compensation and of a filter is what Python does; ROS 2 and MATLAB too."""

import ctypes
import subprocess
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from plants.commanded_arm import arm
from plants.hostile_names import HOSTILE
from plants.lugre_joint import COUNT, FOLLOWED, RATE_HZ, TORQUE_STD, rich, simulate
from plants.marks import needs_compiler
from ruamel.yaml import YAML
from scipy.interpolate import CubicHermiteSpline
from scipy.io import loadmat

from elastid.friction.robot_friction import frictions
from elastid.friction_study.extended_kalman_filter import FilterNoise, KalmanFilter
from elastid.robot import Friction
from elastid.robot.simplified import with_joints
from elastid.targets.friction import write_compensation, write_observers
from elastid.targets.move import write_move, write_move_c
from elastid.use.tune import Outcome, TunedMove


def tuned() -> TunedMove:
    """A smooth motion of two joints; figures that no export reads are zero."""
    t = np.arange(-20, 121) / 100
    phase = np.pi * np.clip(t, 0, 1)[:, None] * [1.0, 2.0]
    q, v, a = np.cos(phase), -np.sin(phase) * np.pi * [1.0, 2.0], -np.cos(phase) * (np.pi * np.array([1.0, 2.0])) ** 2
    inside = ((t >= 0) & (t <= 1))[:, None]
    zero, outcome = np.zeros(len(t)), Outcome("none", np.zeros(len(t)), None, None, 0, 0, 0, 0)
    return TunedMove(
        t, q, v * inside, a * inside, 0 * a, 100 * a * inside, "a */ move", "tool", ("1", "axis: 2"), ("rad", "m"),
        "twin", 4.0, 1.0, 0.2, np.zeros((len(t), 3)), zero, np.full((4, 2), np.inf), (outcome,), 0,
        np.zeros(2), 0.0,
    )  # fmt: skip


def library(folder: Path, source: Path) -> ctypes.CDLL:
    built = folder / "built.so"
    flags = ["-std=c99", "-O2", "-Wall", "-Werror", "-shared", "-fPIC"]
    subprocess.run(["cc", *flags, source, "-o", built, "-lm"], check=True)
    return ctypes.CDLL(str(built))


def interpolate(tuned: TunedMove, t: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Position, velocity, torque (N, n_u) at times (N,) from the first sample; at rest before and after the move.

    Position by cubic Hermite polynomials, velocity their derivative, torque held from sample to sample.
    """
    step = float(np.diff(tuned.time_s).mean())
    ends = step * np.arange(len(tuned.time_s))
    curve, at = CubicHermiteSpline(ends, tuned.position, tuned.velocity), np.clip(t, 0.0, ends[-1])
    return curve(at), curve(at, 1), tuned.torque[(at / step + 1e-6).astype(int)]


@needs_compiler
def test_c_interpolates_as_python_does(tmp_path: Path) -> None:
    """Before, within, on the samples, and after the move, to rounding; it says when it is over."""
    move = tuned()
    source, _ = write_move_c(tmp_path, move)
    c = library(tmp_path, source)
    last = float(np.diff(move.time_s).mean()) * (len(move.time_s) - 1)
    times = np.r_[-1.0, 0.0, np.random.default_rng(0).uniform(0, last, 50), 0.005, last, last + 1]
    expected = interpolate(move, times)
    buffers = [(ctypes.c_double * 2)() for _ in range(3)]
    for i, t in enumerate(times.tolist()):
        assert c.move_at(ctypes.c_double(t), *buffers) == (t >= last)
        for own, value in zip(buffers, expected, strict=True):
            np.testing.assert_allclose(np.array(own), value[i], rtol=1e-12, atol=1e-12)
    q, v, u = interpolate(move, move.time_s - move.time_s[0])
    np.testing.assert_allclose(q, move.position, atol=1e-12)
    np.testing.assert_allclose(v, move.velocity, atol=1e-9)
    np.testing.assert_allclose(u, move.torque)


def test_ros_trajectory_and_mat_file_have_samples(tmp_path: Path) -> None:
    """Times from the first sample, rising; names as they are."""
    move = tuned()
    write_move(tmp_path, move)
    message = YAML(typ="safe").load(tmp_path / "trajectory.yaml")
    assert message["joint_names"] == ["1", "axis: 2"]
    assert message["header"]["stamp"] == {"sec": 0, "nanosec": 0}  # it begins at once
    points = message["points"]
    for key, values in (("positions", move.position), ("velocities", move.velocity), ("effort", move.torque)):
        np.testing.assert_array_equal([point[key] for point in points], values)
    since = [p["time_from_start"]["sec"] + 1e-9 * p["time_from_start"]["nanosec"] for p in points]
    np.testing.assert_allclose(since, move.time_s - move.time_s[0], atol=1e-9)
    held = loadmat(tmp_path / "move.mat")
    np.testing.assert_array_equal(held["position"], move.position)
    np.testing.assert_array_equal(held["torque"], move.torque)


@needs_compiler
def test_friction_compensation_in_c_is_the_law_of_the_robot(tmp_path: Path) -> None:
    """Coulomb, viscous and quadratic friction of each motor, link side, opposite for opposite velocities."""
    law = Friction(0.2, quadratic=1e-6)
    robot = with_joints(
        arm(), lambda joint: replace(joint, motor=joint.motor and replace(joint.motor, coulomb=0.0, friction=law))
    )
    source, _, table = write_compensation(tmp_path, robot, "arm", ())
    c = library(tmp_path, source)
    u = (ctypes.c_double * 2)()
    laws = {law.place: law for law in frictions(robot)}
    for speed in (-2.0, -0.1, 0.5, 3.0):
        c.friction_torque((ctypes.c_double * 2)(speed, -speed), u)
        level = laws["motor 1"].sliding(abs(speed)) + 1e-3 * 100**2 * abs(speed)
        np.testing.assert_allclose(np.array(u), [np.sign(speed) * level, -np.sign(speed) * level], rtol=1e-7)
    rows = [line.split(",") for line in table.read_text(encoding="utf-8").splitlines()[1:]]
    assert len(rows) == 402
    assert max(float(speed) for _, speed, _ in rows) == pytest.approx(robot.driven[0].limits.velocity)


NOISE = FilterNoise(angle=COUNT / np.sqrt(12), torque=TORQUE_STD, drift={"Fc": 6e-3, "f": 25e-3, "offset": 1e-3})
OBSERVED = SimpleNamespace(filtered=FOLLOWED, noise=NOISE, rate_hz=RATE_HZ)


@pytest.mark.slow
@needs_compiler
def test_c_compiles_whatever_the_joints_are_called(tmp_path: Path) -> None:
    """CasADi refuses two underscores in a row in the name of a function, C much else."""
    names = (*HOSTILE[:: 1 + len(HOSTILE) // 10], "axis - 1", "axis 1", "x*/ #error pwn")
    source, _ = write_observers(tmp_path, dict.fromkeys(names, OBSERVED))
    command = ["cc", "-std=c99", "-Wall", "-Werror", "-fsyntax-only", source]
    compiled = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (compiled.returncode, compiled.stderr) == (0, "")


@pytest.mark.slow
@needs_compiler
def test_c_follows_friction_as_the_filter_does(tmp_path: Path) -> None:
    """States and covariance of a second, to rounding."""
    source, header = write_observers(tmp_path, {"2": OBSERVED})
    assert "x[5] Fc, x[6] f, x[7] offset" in header.read_text()
    assert "Fc 0.5554 to 1.8, f 0.003003 to 0.02132, offset -0.98 to 0.98" in header.read_text()
    samples = simulate(rich(1.0), seed=2).samples
    c, n, m = library(tmp_path, source), len(FOLLOWED.states), len(FOLLOWED.consider_parameters)
    doubles = ctypes.c_double * n, ctypes.c_double * (n * (n + m))
    x, P = doubles[0](), doubles[1]()
    c.joint_2_start(x, P, ctypes.c_double(samples.angle[0]), ctypes.c_double(0.0))
    # The other starts from the velocity of its first samples.
    velocity = np.diff(samples.angle[[0, 5, 10]]) * RATE_HZ / 5
    for i in (2, 3):
        x[i], P[i * (n + 1)] = velocity[0], 1e-4 + (velocity[1] - velocity[0]) ** 2
    for u, g, y in zip(samples.torque, samples.load, samples.angle, strict=True):
        c.joint_2_follow(x, P, *(ctypes.c_double(value) for value in (u, g, y)), None, None)
    track = KalmanFilter(FOLLOWED, RATE_HZ).run([samples], NOISE)
    np.testing.assert_allclose(np.array(x)[-3:], track.x[-1], rtol=1e-9, atol=1e-12)
    std = np.sqrt(np.diag(np.array(P).reshape(n, n + m, order="F")))
    np.testing.assert_allclose(std[-3:], track.std[-1], rtol=1e-6, atol=1e-9)
