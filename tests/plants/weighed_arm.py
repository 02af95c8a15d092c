"""A six-axis robot with equations of its own, its responses, and load tests on its flange."""

from __future__ import annotations

import numpy as np

import elastid as ei
from elastid.fit.identify import fit_parameters
from elastid.fit.load_tests import LoadTest
from elastid.fit.problem.static_loads import placed_tests
from elastid.fit.spec import FitSpec, ParameterSpec, PriorSpec, WeightSpec
from elastid.response import Covariance
from elastid.robot import Frame, Placement
from plants.outside_arm import Joint, Outside

LINES = np.linspace(2, 60, 40)
NOISE = 2e-2  # of the largest element of a row on a line
ANGLES = np.radians([
    [0, 40, -10, 10, 30, 0], [30, -10, 40, -60, 50, 40], [-40, 20, -40, 90, -60, 80], [60, 60, -60, 20, 80, -50],
    [-10, 10, 20, -120, -40, 120],
])  # fmt: skip
LEVER = (0.25, 0.15, 0.12)  # of the hook on the flange
NAMES = tuple(f"p{i}" for i in range(len(ANGLES)))
# Axis, place (m), k (N m/rad), motor inertia and ratio; mass (kg), centre of mass, inertia of the body behind it.
AXES = (
    ("z", (0, 0, 0.4), 9e5, 5e-3, 150, 160, (0.05, 0, 0.2), (8, 8, 6)),
    ("y", (0.2, 0, 0.3), 8e5, 5e-3, 150, 90, (0, 0, 0.45), (7, 7, 1)),
    ("y", (0, 0, 0.9), 4e5, 4e-3, 140, 60, (0.05, 0, 0.1), (1.5, 1.5, 0.8)),
    ("x", (0.5, 0, 0.15), 1.2e5, 1e-3, 110, 18, (0.15, 0, 0), (0.2, 0.4, 0.4)),
    ("y", (0.5, 0, 0), 9e4, 8e-4, 110, 12, (0.04, 0, 0), (0.1, 0.12, 0.12)),
    ("x", (0.1, 0, 0), 5e4, 6e-4, 90, 10, (0.05, 0, 0.04), (0.1, 0.12, 0.12)),
)


def nominal() -> ei.Robot:
    """The robot as its file has it."""
    bodies, parent = [], "base"
    for i, (axis, place, k, inertia, ratio, mass, center, moments) in enumerate(AXES, start=1):
        joint = ei.Joint(str(i), axis, ei.Spring(float(k), k * 1.5e-3), ei.Motor(inertia, float(ratio), 1e-3))
        here = Placement(tuple(map(float, place)))
        own = {"mass": float(mass), "center_of_mass": tuple(map(float, center)), "inertia": tuple(map(float, moments))}
        bodies.append(ei.Body(f"b{i}", parent, here, (joint,), **own))
        parent = f"b{i}"
    frames = (Frame("hook", parent, Placement(LEVER)),)
    return ei.Robot("six axes", tuple(bodies), frames=frames, tolerances="exact")


def outside(robot: ei.Robot) -> Outside:
    """Its numbers, and none of its equations."""
    joints = []
    for b, body in enumerate(robot.bodies):
        (joint,) = body.joints
        ratio, spring = joint.motor.ratio, joint.spring
        drive = joint.motor.inertia * ratio**2, joint.motor.viscous * ratio**2
        place = np.array(body.placement.xyz)
        joints.append(Joint(place, "xyz".index(joint.axis), spring.stiffness, spring.damping, 0.0, drive, b))
    return Outside(
        tuple(joints),
        np.array([body.mass for body in robot.bodies]),
        np.array([body.center_of_mass for body in robot.bodies]),
        np.array([body.inertia_matrix for body in robot.bodies]),
    )


def responses(robot: Outside, rng: np.random.Generator) -> list[ei.Response]:
    """Of all postures, with noise of known covariance."""
    every = []
    places = tuple(f"motor {i}" for i in range(1, 7))
    for name, angles in zip(NAMES, ANGLES, strict=True):
        M, D, K, _ = robot.matrices(angles)
        s = 2j * np.pi * LINES[:, None, None]
        G = (s**2 * np.linalg.inv(s**2 * M + s * D + K))[:, 6:, 6:]
        std = NOISE * np.broadcast_to(np.abs(G).max(axis=2, keepdims=True), G.shape)
        G = G + std * (rng.standard_normal(G.shape) + 1j * rng.standard_normal(G.shape)) / np.sqrt(2)
        noise = Covariance(std**2, 1e4)
        every.append(ei.Response(LINES, G, places, places, "acceleration", ei.Configuration(name, angles), noise=noise))
    return every


def deflection(robot: Outside, angles: np.ndarray, force: np.ndarray) -> np.ndarray:
    """Of the hook under a force, by Newton's method on k (q - angles) + weight - J^T F = 0."""
    k, ends = np.array([joint.k for joint in robot.joints]), []
    for load in (np.zeros(3), force):
        q = angles.copy()
        for _ in range(60):
            J = robot.jacobian(q, 5, np.array(LEVER))[0]
            q = angles - (robot.gradient(q) - J.T @ load) / k
        T = robot.frames(q)[5]
        ends.append(T[:3, :3] @ np.array(LEVER) + T[:3, 3])
    return ends[1] - ends[0]


FAULTS = {
    "factor": lambda y, force: 1.1 * y,
    "hysteresis": lambda y, force: y + 40e-6 * y / np.linalg.norm(y),
    "base": lambda y, force: y + force / 5e6,
}


def load_tests(robot: Outside, rng: np.random.Generator, changed=lambda y, force: y) -> list[LoadTest]:
    """20 of them, trackers and dials in turn."""
    tests = []
    for i in range(20):
        force = rng.standard_normal(3)
        force *= rng.uniform(200, 500) / np.linalg.norm(force)
        y = changed(deflection(robot, ANGLES[i % 5], force), force)
        common = {"configuration": NAMES[i % 5], "frame": "hook", "force": tuple(force.tolist())}
        if i % 2:
            axis = int(np.argmax(np.abs(y)))
            reading = float(y[axis] + 3e-6 * rng.standard_normal())
            tests.append(LoadTest(**common, along="xyz"[axis], deflection=reading, std=3e-6))
        else:
            tests.append(LoadTest(**common, deflection=tuple((y + 1e-5 * rng.standard_normal(3)).tolist()), std=1e-5))
    return tests


def one_fit(seed: int, fault: str = "") -> tuple[ei.Result, ei.Result | None, dict[str, float]]:
    """With load tests; without them, too, where these are clean; the true springs."""
    rng = np.random.default_rng([seed, len(fault)])
    robot = nominal()
    numbers = {n: v * np.exp(0.1 * rng.standard_normal()) for n, (v, _) in robot.parameters().items() if n[0] in "kd"}
    true = outside(robot.with_parameters(numbers))
    measured = responses(true, rng)
    tests = placed_tests(load_tests(true, rng, FAULTS.get(fault, lambda y, force: y)), {
        response.configuration.name: response.configuration for response in measured
    })  # fmt: skip
    spec = FitSpec(
        parameters={"k_*": ParameterSpec(), "d_*": ParameterSpec(prior=PriorSpec(0.1))}, starts=1, seed=seed,
        weights=WeightSpec(floor=0.0),
    )  # fmt: skip
    with_loads = fit_parameters(measured, robot, spec, loads=tests)
    return with_loads, None if fault else fit_parameters(measured, robot, spec), numbers
