"""Cases of advice in the messages of checks and commands, which no log is needed for."""

from __future__ import annotations

import re
import shlex
import tomllib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from conftest import TINY_ROBOT, TINY_STUDY

from elastid.app import cli
from elastid.experiment.simulated.friction_rig import SimulatedFrictionRig
from elastid.experiment.specs.channels import ChannelSpec, Structure, channel_refusal
from elastid.experiment.specs.recorded import FileSpec, RecordedSpec
from elastid.linear.linearise import linearise
from elastid.linear.statespace import state_space
from elastid.model.formulation import formulate
from elastid.record import Configuration
from elastid.recorded.files.formats import naming
from elastid.report.overview import COMMANDS
from elastid.robot import Body, Frame, Joint, Motor, Placement, Robot
from elastid.robot.simplified import with_point_mass
from elastid.store.files import write_checksum
from elastid.store.friction_study import read_friction_plan
from elastid.store.results import read_fit
from elastid.study import load
from elastid.use.command.moves import read_move
from elastid.use.postures import grid_postures, random_postures
from plants.advice import PACKAGE, Case, Desk, case, pasted, refusal, rendered
from plants.commanded_arm import arm
from plants.friction_logs import SPEEDS, sliding_torque, trapezoids, write_log, write_study
from plants.friction_study import friction_content
from plants.two_axes import ROBOT, STUDY

# (module, advice): overrides that provoke the message at `check`, the section of the advice, what it tells besides.
AT_CHECK: dict[tuple[str, str], tuple[Sequence[str], str, Sequence[str]]] = {
    ("excitation/spec.py", "grid: full"): (
        ["excitation.phases=prbs", "experiment.realisations=1", "excitation.grid=odd-odd"], "excitation.", []),
    ("excitation/spec.py", "experiment.realisations: 1"): (
        ["excitation.phases=schroeder", "experiment.realisations=2"], "", []),
    ("excitation/spec.py", "phases: random"): (
        ["excitation.phases=schroeder", "experiment.realisations=2"], "excitation.", []),
    ("model/spec.py", "formulation: minimal"): (
        ["model.independent=[joint 1, joint 2, joint 1x, joint 2x]"], "model.", []),
    ("experiment/specs/simulated.py", "kind: cascade"): (
        ["experiment.simulated.controller={kind: pd, bandwidth_hz: 2, integral_time: 2}"],
        "experiment.simulated.controller.", []),
    ("experiment/specs/simulated.py", "limits: {torque: ...}"): (
        ["experiment.simulated.saturation=true"], "robot.bodies.0.joints.0.", []),
    ("fit/spec.py", "fixed: true"): (
        ["fit.parameters.k_1={prior: {std: 0}}"], "", ["fit.parameters.k_1={fixed: true}"]),
    ("fit/parameter_choice.py", "fit.robots: {A: [c1, c2], B: [c3]}"): (
        ["experiment.configurations={c1: [0, 0.2], c2: [0.5, 0.9], c3: [1, 1.4]}", "fit.parameters.k_1={per: robot}"],
        "", []),
    ("fit/parameter_choice.py", "per: robot"): (
        ["fit.parameters={k_*: {}, k_1@A: {start: 1e4}}"], "fit.parameters.k_1.",
        ["fit.robots={A: [a, b], B: [c, d]}"]),
    ("fit/parameter_choice.py", "start: 1"): (["fit.parameters.f_2x={start: 0}"], "fit.parameters.f_2x.", []),
    ("fit/parameter_choice.py", "tie: {to: k_1, by: ‹›}}"): (
        ["fit.ratios={rho: {start: 2}}"], "fit.parameters.k_2.", []),
    ("study/checks/experiment.py", "excitation.grid: odd"): (
        ["estimator.friction=coulomb", "experiment.realisations=1", "excitation.grid=full"], "", []),
    ("study/checks/experiment.py", "experiment.realisations: 2"): (
        ["estimator.friction=coulomb", "experiment.realisations=1", "excitation.grid=full"], "", []),
    ("study/checks/experiment.py", "orthogonal: zippered"): (
        ["experiment.experiments=1", "experiment.realisations=1", "excitation.phases=schroeder",
         "estimator.method=auto"], "excitation.", []),
    ("robot/measurement_chain.py", "sign: -1"): (
        ["robot.chain={gains: [{role: y, at: motor 1, gain: -1}]}"], "", ["robot.chain={}"]),
    ("robot/friction.py", "damping_velocity: ‹›"): (
        ["robot.bodies.0.joints.0.motor.friction={coulomb: 1, stiction: 2, stribeck_velocity: 0.1, "
         "lugre: {stiffness: 1e4, damping: 10}}"], "robot.bodies.0.joints.0.motor.friction.lugre.", []),
    ("robot/joint.py", "motion: translation"): (
        ["robot.bodies.0.joints.1.spring.stiffness=40 kN/m"], "robot.bodies.0.joints.1.", []),
}  # fmt: skip


def _at_check(module: str, text: str) -> Case:
    def followed(desk: Desk) -> None:
        faults, section, further = AT_CHECK[module, text]
        study = desk.write(study=STUDY, robot=ROBOT)
        advice = rendered(text, refusal(lambda: load(study, faults)))
        own = [pasted(advice, section)] if section or "." in advice.partition(":")[0] else []
        assert refusal(lambda: load(study, [*faults, *own, *further])) == ""

    followed.__name__ = f"{module}: {text}"
    return followed


for key in AT_CHECK:
    case(*key)(_at_check(*key))


@case("study/loading.py", "--set fit.starts=5", "--set key.path=value")
def override_without_a_value(desk: Desk) -> None:
    study = desk.write(study=STUDY, robot=ROBOT)
    said = desk.elastid("check", study, "--set", "fit.starts")
    assert "--set key.path=value" in said
    assert desk.elastid("check", study, *rendered("--set fit.starts=5", said).split()) == ""


@case("study/loading.py", "elastid new DIR", slow=True)
@case("app/cli.py", "elastid check ‹›", "elastid run ‹›", slow=True)
def new_study(desk: Desk) -> None:
    assert rendered("elastid new DIR", desk.elastid("check", desk.write(study="")))
    code, said = desk.said("new", str(desk.folder / "demo"))
    assert code == 0
    _, command, path = rendered("elastid check ‹›", said).split()
    assert desk.elastid(command, path) == ""
    _, command, path = rendered("elastid run ‹›", said).split()
    assert parsed(command, path)["study"] == Path(path)


def parsed(command: str, *words: str) -> dict[str, object]:
    """The arguments of a command by name, as the command line reads them, without running it."""
    return cli.cli.commands[command].make_context(command, list(words)).params


@case("study/reference.py", "elastid explain fit", "elastid explain fit.criterion")
def keys_explained(desk: Desk) -> None:
    code, said = desk.said("explain")
    assert code == 0
    for text in ("elastid explain fit.criterion", "elastid explain fit"):
        assert desk.elastid(*rendered(text, said).split()[1:]) == ""


@case("app/scaffold.py", "--from before it", slow=True)
def logs_without_their_option(desk: Desk) -> None:
    logs = [str(desk.folder / f"{name}.csv") for name in "ab"]
    for path in logs:
        write_log(Path(path), trapezoids(SPEEDS), sliding_torque(trapezoids(SPEEDS)))
    folder = str(desk.folder / "study")
    assert rendered("--from before it", desk.elastid("new", folder, *logs))
    assert desk.elastid("new", folder, "--from", logs[0], "--from", logs[1]) == ""


@case("app/run.py", "elastid ‹› ‹›", slow=True)
@case("store/artefacts.py", "elastid ‹› STUDY", "elastid inspect ‹›", slow=True)
@case("app/cli.py", "--run")
def folder_of_others(desk: Desk) -> None:
    """One that the system refuses to make, whoever runs the tests."""
    study, mkdir = desk.write(study=TINY_STUDY, robot=TINY_ROBOT), Path.mkdir

    def guarded(folder: Path, *rest: int, **options: bool) -> None:
        if "locked" in folder.parts:
            raise PermissionError(13, "Permission denied", str(folder))
        mkdir(folder, *rest, **options)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Path, "mkdir", guarded)
        option = rendered("--run", desk.elastid("design", study, "--run", str(desk.folder / "locked")))
        assert desk.elastid("design", study, option, str(desk.folder / "own")) == ""


@case("report/overview.py", "elastid export STUDY --run FOLDER --to ‹›", slow=True)
def stages_of_a_run(desk: Desk) -> None:
    """A stage before its time, a file of an older version, one of another kind, and the exports that the page names."""
    study, run = desk.write(study=TINY_STUDY, robot=TINY_ROBOT), desk.folder / "run"
    for stage in ("measure", "estimate", "fit"):
        said = desk.elastid(stage, study, "--run", str(run))
        while "first, with the same options" in said:
            _, command, path = rendered("elastid ‹› ‹›", said.partition("run `")[2]).split()
            assert desk.elastid(command, path, "--run", str(run)) == ""
            said = desk.elastid(stage, study, "--run", str(run))
        assert said == ""
    with h5py.File(run / "fit.h5", "r+") as file:
        del file.attrs["format"]
    write_checksum(run / "fit.h5")
    _, command, _ = rendered("elastid ‹› STUDY", refusal(lambda: read_fit(run / "fit.h5"))).split()
    (run / "fit.h5").unlink()
    assert desk.elastid(command, study, "--run", str(run)) == ""
    other = refusal(lambda: read_fit(run / "frf.h5"))
    assert desk.elastid(*rendered("elastid inspect ‹›", other).split()[1:]) == ""
    for _, line in COMMANDS:
        assert desk.elastid(*line.replace("STUDY", study).replace("FOLDER", str(run)).split()[1:]) == "", line


@case("study/checks/experiment.py", "elastid estimate STUDY")
def measurement_that_is_not_there(desk: Desk) -> None:
    study = Path(desk.write(study=STUDY, robot=ROBOT))
    said = refusal(lambda: load(study, ["design={count: 2, measured: [run]}"]))
    _, command, _ = rendered("elastid estimate STUDY", said).split()
    assert parsed(command, str(study))["study"] == study


@case("app/stages/estimate.py", "elastid inspect ‹›")
@case("recorded/rig.py", "elastid inspect ‹›")
def file_that_cannot_be_used(desk: Desk) -> None:
    """Both messages come from one place, whatever fails beyond it."""
    path = desk.folder / "log.csv"
    write_log(path, trapezoids((0.5,)), sliding_torque(trapezoids((0.5,))))

    def attempt() -> None:
        with naming(path, f"look at them with `elastid inspect {path}`"):
            raise ZeroDivisionError

    assert desk.elastid(*rendered("elastid inspect ‹›", refusal(attempt)).split()[1:]) == ""


@case("app/predict.py", "--run", "--set ‹›", "--log takes the channels of experiment.recorded")
def robot_of_another_fit(desk: Desk) -> None:
    write_log(desk.folder / "log.csv", trapezoids((0.5,)), sliding_torque(trapezoids((0.5,))))
    study, fit = write_study(desk.folder), desk.folder / "fit of it"
    fit.mkdir()
    (fit / "fit.h5").touch()
    (fit / "identified_robot.yml").write_text((desk.folder / "robot.yml").read_text("utf-8"), encoding="utf-8")
    said = desk.elastid("predict", str(study), "--with", str(fit), "--run", str(desk.folder / "run"))
    words = shlex.split(rendered("--set ‹›)", said).rstrip(")"))
    assert desk.elastid("check", str(study), *words) == ""
    own = desk.elastid("predict", str(study), "--with", str(desk.folder / "friction.h5"), "--run", str(desk.folder))
    assert "--with" in own
    assert {"folder", "logs"} <= {*parsed("predict", str(study), "--with", "run", "--run", "other", "--log", "log.csv")}


@case("app/fleet.py", "--run", "--jobs")
@case("base/files.py", "--run")
@case("store/files.py", "--run")
@case("base/execution.py", "--jobs", "--dask out")
def options(desk: Desk) -> None:
    """They are those of the commands whose messages name them: by one of them a run ends elsewhere."""
    for command in ("run", "design", "measure", "estimate", "fit", "validate", "compare"):
        given = parsed(command, "study.yml", "--run", "other", "--jobs", "1")
        assert (given["folder"], given["jobs"]) == (Path("other"), 1)
        assert "dask" in given


@case("app/map.py", "--grid and --random exclude one another")
@case("app/use_commands.py", "--normal")
@case("app/cli.py", "--to draws.")
@case("fit/result.py", "elastid fit STUDY")
def options_of_maps_draws_and_fits(desk: Desk) -> None:
    """One of them is taken where all three are refused; the others are those of their commands."""
    study = desk.write(study=TINY_STUDY, robot=TINY_ROBOT)
    both = ["--random", "3", "--grid", "4"]
    assert "--grid and --random exclude one another" in desk.elastid("map", study, "--run", str(desk.folder), *both)
    assert parsed("map", study, *both[:2], "--normal", "0", "0", "1")["random"] == 3
    assert parsed("export", study, "--to", "draws", "--count", "10")["count"] == 10
    assert parsed("fit", study)["study"] == Path(study)


@case("use/command/moves.py", "--time for the duration of the move", "--fastest")
@case("use/command/tune.py", "--error", "--bandwidth", "--time ‹›")
@case("use/command/replay.py", "--bandwidth", "--rate", "--draws 0")
@case("app/loops.py", "--rate")
def options_of_moves(desk: Desk) -> None:
    """A way without times is refused until a time is given, 0 for the shortest; the others are options of tune."""
    path = desk.folder / "move.csv"
    path.write_text("1,2\n0,0\n0.4,0.2\n", encoding="utf-8")
    assert "--time for the duration of the move, or --fastest" in refusal(lambda: read_move(path, arm(), "tool"))
    given = parsed("tune", "study.yml", "--path", str(path), "--time", "1.2", "--error", "2", "--bandwidth", "3",
        "--rate", "1000", "--draws", "0")  # fmt: skip
    assert parsed("loops", "study.yml", "--rate", "1000")["rate_hz"] == 1000
    assert (given["error_mm"], given["bandwidth_hz"], given["rate_hz"], given["draws"]) == (2.0, 3.0, 1000.0, 0)
    assert read_move(path, arm(), "tool", given["duration"]).duration == 1.2
    assert parsed("tune", "study.yml", "--path", str(path), "--fastest")["fastest"]
    assert read_move(path, arm(), "tool", 0.0).duration == 0.0


@case("use/postures.py", "--frame", "--random")
def frames_that_have_no_grid(desk: Desk) -> None:
    """One on the axis moves nowhere, one beyond it on a circle: another frame, or random postures, are mapped."""
    robot = Robot("axis", (Body("arm", joints=(Joint("1", "z", None, Motor(1e-3, 100.0)),), inertia=1.0),), frames=(
        Frame("hub", "arm"), Frame("tip", "arm", Placement((0.5, 0.0, 0.0)))))  # fmt: skip
    assert "another with --frame" in refusal(lambda: grid_postures(robot, "hub"))
    on_a_circle = refusal(lambda: grid_postures(robot, "tip"))
    assert on_a_circle == "" or "take --random" in on_a_circle
    assert random_postures(robot, 5).shape == (5, 1)
    assert {"frame", "random"} <= {*parsed("map", "study.yml", "--frame", "tip", "--random", "5")}


@case("study/checks/recorded.py", "at: ‹›")
def disturbance_at_a_rigid_joint(desk: Desk) -> None:
    log = np.random.default_rng(0).standard_normal((300, 3))
    np.savetxt(desk.folder / "log.csv", log, header="u,q,d", comments="", delimiter=",")
    text = (
        "name: pushed\nrobot: robot.yml\nfriction: {passes: detect}\nexperiment:\n  recorded:\n    rate_hz: 100\n"
        "    channels:\n      - {role: u, at: motor 1, channel: u}\n"
        "      - {role: y, at: motor 1, channel: q, quantity: position}\n"
        "      - {role: d, at: joint 1, channel: d}\n    files:\n      - {path: log.csv}\n"
    )
    arm = "{name: arm, joints: [{name: 1, axis: z, motor: {inertia: 1e-3, ratio: 50}}], inertia: 1}"
    study = Path(desk.write(study=text, robot=f"name: one\nbodies: [{arm}]"))
    advice = rendered("at: ‹›, which is the same", refusal(lambda: load(study)).partition("give ")[2]).partition(",")[0]
    study.write_text(text.replace("at: joint 1, channel: d", f"{advice}, channel: d"), encoding="utf-8")
    said = refusal(lambda: load(study))
    assert said == "", said


@case("study/reference.py", "elastid inspect FILE")
def arrays_of_a_result(desk: Desk) -> None:
    """A file of a run has the array that the word was found in; any file of numbers is inspected alike."""
    (desk.folder / "log.csv").write_text("t,coherence\n0,1\n1,1\n", encoding="utf-8")
    assert rendered("elastid inspect FILE", desk.said("explain", "coherence")[1])
    assert desk.elastid("inspect", str(desk.folder / "log.csv")) == ""


@case("report/friction_content.py", "elastid export STUDY --run FOLDER --to robot")
def law_for_the_robot(desk: Desk) -> None:
    """As the command line reads it; tests/app/test_export.py carries it out."""
    content = friction_content()
    content = replace(content, result=replace(content.result, status="identified", joints=()))
    (advice,) = content.questions[-1][1]
    words = rendered("elastid export STUDY --run FOLDER --to robot", advice).split()[2:]
    words = [{"STUDY": desk.write(study=STUDY, robot=ROBOT), "FOLDER": str(desk.folder)}.get(w, w) for w in words]
    assert cli.cli.commands["export"].make_context("export", words).params["target"] == "robot"


@case("base/display.py", "--extra notebook")
@case("app/from_robot.py", "--extra mjcf")
@case("recorded/files/log.py", "--extra ‹›")
@case("base/kernels/__init__.py", "--reinstall-package elastid")
def packages(desk: Desk) -> None:
    """Extras are those of the project, and so is the name of the package."""
    project = tomllib.loads((PACKAGE.parent / "pyproject.toml").read_text("utf-8"))["project"]
    readers = [path.read_text("utf-8") for path in (PACKAGE / "recorded").rglob("*.py")]
    named = {match for text in readers for match in re.findall(r'imported\([^)]*"(\w+)"\)', text)}
    assert project["name"] == "elastid"
    assert len(named) > 2
    assert named | {"notebook", "mjcf"} <= {*project["optional-dependencies"]}


def designed(desk: Desk, template: str, *overrides: str) -> str:
    """Why the study of a template cannot be designed under some overrides; empty where it can."""
    folder = desk.folder / template
    if not folder.exists():
        assert desk.elastid("new", str(folder), "--template", template) == ""
    sets = [word for override in overrides for word in ("--set", override)]
    return desk.elastid("design", str(folder / "study.yml"), "--run", str(desk.folder / "run"), "--jobs", "1", *sets)


@case("excitation/phases.py", "orthogonal: dft", slow=True)
def no_hadamard_matrix(desk: Desk) -> None:
    fault = "excitation.orthogonal=hadamard"
    text = rendered("orthogonal: dft", designed(desk, "serial", fault))
    assert designed(desk, "serial", fault, pasted(text, "excitation.")) == ""


@case("design/limits.py", "limits: {torque: ..., velocity: ...}", slow=True)
def torque_of_the_limits(desk: Desk) -> None:
    study = desk.write(study=STUDY, robot=ROBOT)
    words = ["--run", str(desk.folder / "run"), "--set", "excitation.torque_rms=limits"]
    text = rendered("limits: {torque: ..., velocity: ...}", desk.elastid("design", study, *words))
    own = [word for i in (0, 1) for word in ("--set", pasted(text, f"robot.bodies.{i}.joints.0."))]
    assert desk.elastid("design", study, *words, *own) == ""


@case("design/friction.py", "law.presliding: maxwell_slip", slow=True)
def bristles_from_slow_loops(desk: Desk) -> None:
    faults = [
        "friction.presliding={torque: [0.05, 0.95], loops: 12, frequency_hz: 0.5}",
        "friction.law.presliding=lugre",
    ]
    text = rendered("law.presliding: maxwell_slip", designed(desk, "friction", *faults))
    assert designed(desk, "friction", *faults, pasted(text, "friction.")) == ""


@case("experiment/simulated/friction_rig.py", "heat: {conductance: 8 W/K, time_constant: 45 min}", slow=True)
def warm_up_without_heat(desk: Desk) -> None:
    faults = ["friction.warm_up={speed: 60 deg/s, time: 2 h, test_every: 5 min}"]
    assert designed(desk, "friction", *faults) == ""
    plan, path = read_friction_plan(desk.folder / "run" / "plan.h5"), desk.folder / "friction" / "study.yml"

    def rig(*overrides: str) -> SimulatedFrictionRig:
        study = load(path, overrides).study
        return SimulatedFrictionRig(study.as_robot(), study.experiment, plan, 0)

    text = rendered("heat: {conductance: 8 W/K, time_constant: 45 min}", refusal(lambda: rig(*faults)))
    assert refusal(lambda: rig(*faults, pasted(text, "experiment.simulated."))) == ""


@case("study/checks/friction.py", "frames: [{name: tool, body: ‹›}]")
@case("robot/simplified.py", "frames: [{name: tool, body: ‹›}]")
def nothing_to_carry_a_payload(desk: Desk) -> None:
    write_log(desk.folder / "log.csv", trapezoids((0.5,)), sliding_torque(trapezoids((0.5,))))
    study, fault = write_study(desk.folder), "friction.loads=[{name: full, payload: 20 kg}]"
    text = rendered("frames: [{name: tool, body: ‹›}]", refusal(lambda: load(study, [fault])))
    assert refusal(lambda: load(study, [fault, pasted(text, "robot.")])) == ""
    robot = load(study).study.as_robot()
    text = rendered("frames: [{name: tool, body: ‹›}]", refusal(lambda: with_point_mass(robot, 20.0)))
    carrying = load(study, [pasted(text, "robot.")]).study.as_robot()
    assert refusal(lambda: with_point_mass(carrying, 20.0)) == ""


@case("experiment/specs/channels.py", "scale: 9.80665", "unit: ‹›")
def units_of_channels(desk: Desk) -> None:
    grams = ChannelSpec("y", "tip x", "a", quantity="acceleration", unit="g")
    assert rendered("scale: 9.80665 and unit: m/s^2", refusal(lambda: grams.unit_factor(slides=True)))
    assert replace(grams, scale=9.80665, unit="m/s^2").unit_factor(slides=True) == 1.0
    bare = replace(grams, unit="")
    _, said = channel_refusal(bare, (bare,), Structure((), ()))
    unit = rendered("unit: ‹›", said).partition(": ")[2]
    named = replace(bare, unit=unit)
    assert channel_refusal(named, (named,), Structure((), ())) == ("", "")


@case("experiment/specs/recorded.py", "rate_hz: unknown")
def period_of_an_unknown_rate(desk: Desk) -> None:
    channels = (ChannelSpec("u", "motor 1", "u"), ChannelSpec("y", "motor 1", "y", quantity="position"))
    files, keys = (FileSpec("log.csv", "a"),), {"rate_hz": "unknown"}
    said = refusal(lambda: RecordedSpec(channels=channels, files=files, period=2.0, **keys))
    assert rendered("rate_hz: unknown", said)
    assert refusal(lambda: RecordedSpec(channels=channels, files=files, period_samples=200, **keys)) == ""


@case("linear/statespace.py", "estimator.quantity: acceleration")
def gravity_that_would_be_integrated(desk: Desk) -> None:
    study = Path(desk.write(study=STUDY, robot=ROBOT))

    def attempt(*overrides: str) -> None:
        loaded = load(study, overrides).study
        model = formulate(loaded.as_robot())
        posture = Configuration("a", loaded.experiment.configurations["a"])
        linear = linearise(model, posture, model.theta, ("accelerometer tool x",), loaded.estimator.quantity)
        state_space(linear, np.append(model.theta, 0.0))

    faults = "robot.frames=[{name: tool, body: fore}]", "estimator.quantity=velocity"
    text = rendered("estimator.quantity: acceleration", refusal(lambda: attempt(*faults)))
    assert refusal(lambda: attempt(*faults, pasted(text))) == ""
