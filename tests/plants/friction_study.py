"""The result of a friction study of two joints, made up: an elbow with everything, a lift with a motion alone."""

import math
from dataclasses import replace

import numpy as np

from elastid.base.errors import Note
from elastid.experiment.plan.friction import FrictionPlan, JointPassDesign, PassLimits
from elastid.friction_record import FrictionRecords
from elastid.friction_study.constant_velocity import FrictionCurve
from elastid.friction_study.inverse_dynamics_regression import MotionFriction, regress_motion
from elastid.friction_study.motion_signals import Motion
from elastid.friction_study.presliding import Elements, PreslidingFit
from elastid.friction_study.result import FrictionNumber, FrictionResult, JointFriction, identify_friction
from elastid.friction_study.sliding_friction import identify_sliding_friction
from elastid.friction_study.spec import FrictionSpec, LawSpec
from elastid.friction_study.static_model_fit import StaticLaw, UnidentifiedTerm
from elastid.friction_study.warm_up import ThermalModel
from elastid.report.friction_content import FrictionContent
from elastid.robot import Robot

RATE, MASS = 250.0, 95.0


def friction_study(robot: Robot, measured: FrictionRecords, spec: FrictionSpec | None = None) -> FrictionResult:
    """The result of a study of all joints."""
    sliding = identify_sliding_friction(robot, robot.driven, measured)
    return identify_friction(robot, sliding, measured, spec or FrictionSpec())


def levels() -> FrictionCurve:
    """Ten speeds in both directions, 1 % of noise, and what all passes share."""
    v, s = (x.ravel() for x in np.meshgrid(np.geomspace(0.02, 2, 10), (1.0, -1.0), indexing="ij"))
    exact = 9.0 + (6.0 + 0.8 * s) * v
    noise = 0.01 * np.random.default_rng(0).standard_normal(len(v))
    found = FrictionCurve("joint elbow", v, s, exact * (1 + noise), 0.01 * exact, 0 * v, np.full(len(v), np.nan))
    shared = {"inertia": 2.0, "slope": 6.0, "gravity.cos": 40.0, "gravity.sin": 0.0, "offset": 0.5}
    shared |= {"ripple.1c": 0.0, "ripple.1s": 0.3, "ripple.2c": 0.0, "ripple.2s": 0.0}
    return replace(found, shared={name: (value, 0.01) for name, value in shared.items()})


def motion() -> MotionFriction:
    """Of a lift of 95 kg, 20 N and 200 N s/m: it slides, two sines for 10 s."""
    t = np.arange(round(10 * RATE)) / RATE
    waves = [(0.2, 2 * np.pi * 0.4), (0.05, 2 * np.pi * 1.1)]
    q, v, a = (sum(A * w**k * np.sin(w * t + k * np.pi / 2) for A, w in waves) for k in range(3))
    noise = 0.5 * np.random.default_rng(2).standard_normal(len(t))
    u = MASS * np.asarray(a) + 20 * np.sign(v) + 200 * np.asarray(v) + noise
    return regress_motion(Motion("joint lift", RATE, np.asarray(q), u, slides=True))


def number(name: str, symbol: str, value: float, std: float, truth: float | None) -> FrictionNumber:
    return FrictionNumber(
        name, symbol, "a meaning", "N*m", value, std, value - 2 * std, value + 2 * std, "10 levels", truth
    )


def friction_result() -> FrictionResult:
    elbow = JointFriction(
        "elbow", False, levels(), static=StaticLaw.of(levels(), LawSpec(stribeck="no")),
        presliding=Elements(np.array([300.0, 500.0]), np.array([1e-3, 3e-3]), 0.1),
        presliding_test=PreslidingFit(1.0e4, 10.0, np.diag([100.0, 1.0]) ** 2, 2),
        thermal=ThermalModel(np.array([2700.0]), np.ones(1), math.nan, np.full(2, 0.02), 20.0, 20),
        numbers=(number("Fc_melbow", "F_c", 9.02, 0.03, 9.0), number("f_melbow", "f", 6.3, 0.1, 6.0)),
        unidentified=(
            UnidentifiedTerm("stribeck", "no speed below nu_s / 3"), UnidentifiedTerm("quadratic", "not asked for"),
        ),
        notes=(Note("friction/constant-velocity-runs", "it sticks", "pass 1"),),
    )  # fmt: skip
    lift = JointFriction("<lift>", True, motion=motion(), numbers=(number("Fc_mlift", "F_c", 20.1, 0.2, None),))
    return FrictionResult((elbow, lift), (Note("a-note", "a note on the study"),), "partly", "2 joints are identified.")


def friction_content() -> FrictionContent:
    """The page of both joints, with a plan of twelve passes of the elbow at three speeds."""
    limits = PassLimits("joint elbow", (-1.0, 1.0), 2.5, 10.0, 0.06, 8.0)
    design = JointPassDesign("elbow", limits, np.array([0.01, 0.3, 2.0]), np.array([4.0, 3, 5]), 0.987)
    plan = FrictionPlan(1000.0, (), (design,), 141.0, assumed_friction=("Coulomb friction to 1 %",))
    return FrictionContent("friction of <an arm>", friction_result(), "name: <arm>", {"elastid": "1.0"}, plan)
