"""Cases of advice to lower or to raise a number: too large or too small it is refused, changed it is not."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from elastid.base.note import Note
from elastid.design.choice import draw_candidates
from elastid.design.design import design, sticking
from elastid.design.spec import CandidateSpec
from elastid.excitation.grids import grid_lines
from elastid.experiment.plan.plan import make_plan
from elastid.experiment.simulated.rig import SimulatedRig
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.recorded import FileSpec
from elastid.experiment.specs.simulated import SimulatedSpec
from elastid.fit.identify import identify
from elastid.fit.spec import FitSpec, ParameterSpec
from elastid.friction_study.spec import FrictionSpec, PassesSpec, WarmUpSpec
from elastid.linear.linearise import Linearisation
from elastid.linear.response.transfer import to_response
from elastid.model.formulation import formulate
from elastid.model.kinematics import frame_poses
from elastid.record import Configuration
from elastid.response import Covariance, FrequencyResponse
from elastid.robot import Frame, Limits, Placement, Robot
from elastid.robot.friction import LoadDependence
from elastid.study import load
from elastid.use.command.moves import read_move
from plants.advice import Case, Desk, case, refusal, rendered
from plants.advice_of_logs import estimated, lab_log, noise, said_of
from plants.commanded_arm import arm
from plants.friction_axis import axis, planned
from plants.lab_logs import N, save_csv
from plants.two_axes import ROBOT, STUDY

MOTOR = "robot.bodies.0.joints.0.motor"
LUGRE = (f"{MOTOR}.friction={{coulomb: 1, stiction: 2, stribeck_velocity: 0.1, "
         "lugre: {stiffness: 1e4, damping: 10}}")  # fmt: skip
# (module, advice): overrides that provoke the message at `check`, the change.
AT_CHECK: dict[tuple[str, str], tuple[Sequence[str], str]] = {
    ("excitation/spec.py", "lower rate_hz"): (["excitation.rate_hz=1e9"], "excitation.rate_hz=500"),
    ("excitation/spec.py", "lower band_hz"): (["excitation.band_hz=[2, 300]"], "excitation.band_hz=[2, 200]"),
    ("excitation/spec.py", "raise rate_hz"): (["excitation.band_hz=[2, 300]"], "excitation.rate_hz=1000"),
    ("robot/friction.py", "lower damping"): ([LUGRE], f"{MOTOR}.friction.lugre.damping=0.01"),
    ("robot/friction.py", "raise viscous"): ([LUGRE], f"{MOTOR}.viscous=20"),
}


def _at_check(module: str, text: str) -> Case:
    def followed(desk: Desk) -> None:
        faults, change = AT_CHECK[module, text]
        study = Path(desk.write(study=STUDY, robot=ROBOT))
        assert rendered(text, refusal(lambda: load(study, faults)))
        assert refusal(lambda: load(study, [*faults, change])) == ""

    followed.__name__ = f"{module}: {text}"
    return followed


for key in AT_CHECK:
    case(*key)(_at_check(*key))


@case("excitation/grids.py", "widen band_hz")
def band_between_two_lines(desk: Desk) -> None:
    def lines(high: float) -> str:
        return refusal(lambda: grid_lines("full", (2.1, high), 500.0, 1000))

    assert rendered("widen band_hz", lines(2.2))
    assert lines(2.6) == ""


@case("robot/friction.py", "raise stiction")
def stiction_that_nothing_falls_from(desk: Desk) -> None:
    def law(stiction: float) -> str:
        return refusal(lambda: LoadDependence(coulomb=0.1, stiction=stiction, stribeck_velocity=0.1))

    assert rendered("raise stiction", law(0.05))
    assert law(0.2) == ""


@case("study/checks/logs.py", "lower rate_hz")
def rate_of_another_log(desk: Desk) -> None:
    t = np.arange(400) / 100.0
    log = np.column_stack([t, np.random.default_rng(0).standard_normal((400, 2))])
    np.savetxt(desk.folder / "log.csv", log, header="t,u,q", comments="", delimiter=",")
    text = (
        "name: late\nrobot: robot.yml\nfriction: {passes: detect}\nexperiment:\n  recorded:\n    rate_hz: 500\n"
        "    time: t\n    channels:\n      - {role: u, at: motor 1, channel: u}\n"
        "      - {role: y, at: motor 1, channel: q, quantity: position}\n    files:\n      - {path: log.csv}\n"
    )
    arm = "{name: arm, joints: [{name: 1, axis: z, motor: {inertia: 1e-3, ratio: 50}}], inertia: 1}"
    study = desk.write(study=text, robot=f"name: one\nbodies: [{arm}]")
    assert rendered("lower rate_hz", desk.elastid("check", study))
    assert desk.elastid("check", study, "--set", "experiment.recorded.rate_hz=100") == ""


@case("frf/local/response.py", "widen band_hz", slow=True)
def band_narrower_than_a_window(desk: Desk) -> None:
    noise(desk, 3000, 3000)
    files = tuple(FileSpec(f"{i}.csv", "home", i) for i in range(2))
    assert rendered("widen band_hz", estimated(desk, files, method="local_rational", band_hz=(10.0, 10.05)))
    assert estimated(desk, files, method="local_rational", band_hz=(5.0, 20.0)) == ""


@case("recorded/repair/__init__.py", "raise band_hz")
def wander_below_the_excited_lines(desk: Desk) -> None:
    """The slow part moves as it did; it leaks less into lines that are farther from it."""
    wander = 5 * np.sin(2 * np.pi * 1.37 * np.arange(4 * N) / N)

    def said(first: int) -> str:
        log = lab_log(desk, first=first)
        log["phi"] = log["phi"] + wander
        save_csv(desk.folder / "log.csv", log)
        return said_of(desk)

    assert rendered("raise band_hz", said(3))
    assert "band_hz" not in said(50)


@case("design/choice.py", "lower singular")
def postures_that_are_all_near_a_singular_one(desk: Desk) -> None:
    def refused(singular: float) -> str:
        return refusal(lambda: draw_candidates(CandidateSpec(random=20, singular=singular), arm(), 1))

    said = refused(0.99)
    assert rendered("lower singular", said)
    best = float(re.findall(r"the best of them has ([\d.]+)", said)[0])
    assert refused(0.9 * best) == ""


@case("design/design.py", "lower count", slow=True)
def more_configurations_than_candidates(desk: Desk) -> None:
    from tests.design.test_design import PROBLEM

    def refused(count: int) -> str:
        assert PROBLEM.design is not None
        section = replace(PROBLEM.design, count=count, candidates=CandidateSpec(random=8))
        return refusal(lambda: design(replace(PROBLEM, design=section)))

    said = refused(90)
    assert rendered("lower count", said)
    assert refused(int(re.findall(r"lower count to (\d+)", said)[0])) == ""


def one_joint_as(robot: Robot, **changes: Any) -> Robot:
    """The robot with other numbers of its first joint's motor or spring."""
    body, *others = robot.bodies
    joint = replace(body.joints[0], **changes)
    return replace(robot, bodies=(replace(body, joints=(joint, *body.joints[1:])), *others))


@case("design/design.py", "raise excitation.torque_rms")
def motor_that_friction_holds(desk: Desk) -> None:
    from tests.design.test_design import PROBLEM, TWO

    motor = TWO.bodies[0].joints[0].motor
    assert motor is not None
    robot = one_joint_as(TWO, motor=replace(motor, coulomb=0.1))
    experiment = ExperimentSpec({"a": (0.1, 0.2)}, simulated=SimulatedSpec())

    def said(torque: float) -> str:
        excitation = replace(PROBLEM.excitation, torque_rms=(torque, 2.0))
        return " ".join(map(str, sticking(make_plan(excitation, experiment, robot, 1), robot, None)))

    assert rendered("raise excitation.torque_rms", said(5.0))
    assert said(12.0) == ""


@case("design/design.py", "lower excitation.torque_rms", slow=True)
def amplitude_that_stiffens_a_spring(desk: Desk) -> None:
    from tests.design.test_design import PROBLEM, TWO

    spring = TWO.bodies[0].joints[0].spring
    assert spring is not None
    robot = one_joint_as(TWO, spring=replace(spring, cubic=1e9))
    experiment = replace(PROBLEM.experiment, configurations={"a": (0.1, 0.6)})

    def said(part: float) -> str:
        excitation = replace(PROBLEM.excitation, torque_rms=(5.0 / part, 2.0 / part))
        problem = replace(PROBLEM, robot=robot, experiment=experiment, excitation=excitation, design=None)
        return " ".join(str(note) for note in design(problem).forecast.notes if note.code == "design/forecast")

    by = float(re.findall(r"by a factor of ([\d.]+) or more", said(1.0))[0])
    assert rendered("lower excitation.torque_rms", said(1.0))
    assert said(1.1 * by) == ""


def pass_refused(passes: dict[str, Any], bandwidth_hz: float = 8.0, **keys: Any) -> str:
    """Why passes of an axis cannot be planned."""
    spec = FrictionSpec(passes=PassesSpec(**passes), **keys)
    return refusal(lambda: planned(spec, axis(), bandwidth_hz))


@case("design/friction.py", "widen friction.passes.window", slow=True)
def window_too_narrow_for_a_warm_up(desk: Desk) -> None:
    def refused(window: tuple[float, float]) -> str:
        warm_up = WarmUpSpec(speed=1.5, time=600.0, test_every=300.0)
        return pass_refused({"speeds": (0.02, 0.5), "window": window}, warm_up=warm_up)

    assert rendered("widen friction.passes.window", refused((-0.2, 0.2)))
    assert refused((-1.8, 1.8)) == ""


@case("design/friction_axis.py", "raise experiment.simulated.controller.bandwidth_hz")
def loop_too_slow_for_slow_passes(desk: Desk) -> None:
    said = pass_refused({"speeds": (0.01, 1.0)}, 0.5)
    assert rendered("raise experiment.simulated.controller.bandwidth_hz", said)
    assert pass_refused({"speeds": (0.01, 1.0)}, float(re.findall(r"from 0.5 to ([\d.]+) Hz", said)[0])) == ""


def simulated(torque_rms: float, limits: Limits, saturation: bool = False) -> str:
    """Why an axis cannot be measured under a multisine, or the notes on its record."""
    from tests.design.test_design import PROBLEM, TWO

    robot = one_joint_as(TWO, limits=limits)
    experiment = ExperimentSpec({"a": (0.1, 0.2)}, ramp=0.0, simulated=SimulatedSpec(saturation=saturation))
    plan = make_plan(replace(PROBLEM.excitation, torque_rms=(torque_rms, 2.0)), experiment, robot, 1)
    rig, notes = SimulatedRig(robot, experiment, plan, 1), list[Note]()
    return refusal(lambda: notes.extend(rig.measure(rig.experiments[0]).notes)) or " ".join(map(str, notes))


@case("experiment/simulated/rig.py", "Lower excitation.torque_rms", slow=True)
def robot_that_a_multisine_tears_loose(desk: Desk) -> None:
    assert rendered("Lower excitation.torque_rms", simulated(3e4, Limits((-2.0, 2.0))))
    assert simulated(5.0, Limits((-2.0, 2.0))) == ""


@case("experiment/simulated/rig.py", "lower excitation.torque_rms", slow=True)
def multisine_beyond_the_limits(desk: Desk) -> None:
    weak = Limits((-2.0, 2.0), torque=12.0)
    for torque, saturation, word in ((40.0, True, "cannot control"), (7.0, True, "clipped"), (7.0, False, "beyond")):
        said = simulated(torque, weak, saturation)
        assert word in said, said
        assert rendered("lower excitation.torque_rms", said)
    assert simulated(1.5, weak, True) == simulated(1.5, weak) == ""


@case("use/command/moves.py", "widen robot.bodies.joints.limits.angle", slow=True)
def path_beyond_the_limits_of_a_joint(desk: Desk) -> None:
    from tests.design.test_design import TWO

    wide = replace(TWO, frames=(Frame("tool", "fore", Placement((0.4, 0, 0))),))
    narrow = one_joint_as(wide, limits=Limits((-2.0, 0.3)))
    angles = np.column_stack([np.linspace(0, 0.6, 30), np.linspace(0.7, 0.3, 30)])
    rows = frame_poses(wide, angles, "tool").position.tolist()
    text = "t,x,y,z\n" + "".join(f"{t}," + ",".join(map(str, row)) + "\n" for t, row in enumerate(rows))
    path = desk.folder / "move.csv"
    path.write_text(text, encoding="utf-8")
    assert rendered("widen robot.bodies.joints.limits.angle", refusal(lambda: read_move(path, narrow, "tool")))
    assert refusal(lambda: read_move(path, wide, "tool")) == ""


@case("fit/diagnosis/status.py", "raise fit.starts", "lower fit.start_factor", slow=True)
def optimum_that_one_start_reached(desk: Desk) -> None:
    from tests.design.test_design import TWO

    rng, model = np.random.default_rng(0), formulate(TWO)
    responses, freq_hz = list[FrequencyResponse](), np.linspace(3, 60, 40)
    for name, angles in (("a", (0.0, 0.3)), ("b", (0.2, 1.2))):
        linear = Linearisation.of(model).at(
            Configuration(name, angles), model.theta, TWO.motor_locations, "acceleration"
        )
        exact = to_response(linear, np.append(model.theta, 0.0), freq_hz)
        std = 0.01 * np.abs(exact.G)
        noisy = exact.G + std * (rng.standard_normal(std.shape) + 1j * rng.standard_normal(std.shape)) / np.sqrt(2)
        responses.append(replace(exact, G=noisy, total=Covariance(std**2, np.inf)))
    far = TWO.with_parameters({"k_1": 2e4, "k_2": 80.0})
    free = {name: ParameterSpec() for name in ("k_*", "d_*")}

    def said(**keys: Any) -> str:
        spec = FitSpec(parameters=free, seed=0, log_first=False, **keys)
        return " ".join(str(note) for note in identify(responses, far, spec).notes if note.code == "fit/starts")

    once = said(starts=2, start_factor=3.0)
    assert rendered("raise fit.starts", once)
    assert rendered("lower fit.start_factor", once)
    assert said(starts=8, start_factor=3.0) == said(starts=2, start_factor=1.5) == ""
