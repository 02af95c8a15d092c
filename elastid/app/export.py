"""export: a fit -> export/<target>/ in the run folder, the identified model for another tool; or responses alone."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

from elastid.app.identified_robot import (
    robot_of_fit,
    robot_of_friction,
    with_effects,
    with_findings,
    with_identified_friction,
    with_linear_springs,
    with_terms_of,
)
from elastid.app.run import Run
from elastid.app.stages.fit import warn_of_distrust
from elastid.base.errors import StudyError, did_you_mean
from elastid.base.escape import file_name
from elastid.base.files import clear_folder
from elastid.fit.fitted_robot import FittedRobot, models_by_group, robots_by_group
from elastid.nonlinear.gear_result import GearResult, with_gears
from elastid.recorded.responses.table import geometry_of_files
from elastid.store.files import write_text
from elastid.store.friction_study import read_filter, read_friction_result
from elastid.store.measured import read_friction, read_responses
from elastid.store.results import read_fit, read_gears
from elastid.targets.code import write_c, write_casadi
from elastid.targets.control import write_control, write_responses_control
from elastid.targets.csv import write_csv, write_friction_csv, write_responses_csv
from elastid.targets.draws import write_draws
from elastid.targets.fmu import write_fmu
from elastid.targets.friction import Observer, write_compensation, write_observers
from elastid.targets.matlab import write_matlab, write_responses_matlab
from elastid.targets.mujoco import write_mujoco
from elastid.targets.numbers import interval_lines
from elastid.targets.uff import write_uff
from elastid.targets.urdf import write_urdf
from elastid.use.draws import draw_robots

Writer = Callable[[Path, FittedRobot], tuple[Path, ...]]
ResponseWriter = Callable[..., tuple[Path, ...]]

TARGETS: dict[str, Writer] = {
    "control": write_control, "matlab": write_matlab, "mujoco": write_mujoco, "fmu": write_fmu, "urdf": write_urdf,
    "casadi": write_casadi, "c": write_c, "csv": write_csv,
}  # fmt: skip
# Of measured responses: all that a study without a robot has. uff takes those of any study.
RESPONSE_TARGETS: dict[str, ResponseWriter] = {
    "control": write_responses_control, "matlab": write_responses_matlab, "csv": write_responses_csv, "uff": write_uff,
}  # fmt: skip
# Of these, targets that take the modes of a study without a robot too.
WITH_MODES = ("csv", "uff")
# The targets that are no other tool's: elastid's own, robots drawn from the fit, the filter of a study of friction.
ROBOT, DRAWS, OBSERVER, COMPENSATION = "robot", "draws", "observer", "compensation"


def export(run: Run, target: str, count: int = 1000) -> tuple[Path, ...]:
    """export/<target>/: the identified model for another tool; StudyError where there is no current fit or such target.

    count: of draws.

    Where robots, or other groups of configurations, have parameters of their own: a model of each in a folder below.
    """
    every = sorted({*TARGETS, *RESPONSE_TARGETS, ROBOT, DRAWS, OBSERVER, COMPENSATION})
    if target not in every:
        raise StudyError("export/target", f"{target} is no target of an export; {did_you_mean(target, every)}")
    if run.study.friction is not None:
        return _export_friction(run, target)
    if target == OBSERVER:
        raise StudyError(
            "study/stage", f"study {run.study.name} identifies no friction, and an observer follows friction"
        )
    if target == DRAWS and run.study.robot is not None:
        return _export_draws(run, count)
    if run.study.robot is None or target not in (*TARGETS, ROBOT, COMPENSATION):
        return _export_responses(run, target)
    run.require("validate")  # reads what an export reads
    responses, gears = read_responses(run.path("estimate")), gears_of(run)
    result, robot = with_gears(read_fit(run.path("fit")), gears), run.study.as_robot()
    found = None if gears is None else with_effects(robot, gears)
    if found is not None and target != ROBOT:
        robot = with_linear_springs(found) if target == "mujoco" else found
        result = with_terms_of(result, robot)
    folder = clear_folder(run.folder, "export", target)
    models = models_by_group(result, robot, responses, run.study.model, run.study.name)
    if any(models):
        groups = (f"{label} ({', '.join(G.configuration.name for G in m.measured)})" for label, m in models.items())
        run.console.say(f"export: a model for each of {', '.join(groups)}, which have parameters of their own")
    own = {ROBOT: partial(_write_robot, run, gears), COMPENSATION: partial(_write_compensation, run, gears)}
    write = (own | TARGETS)[target]
    if target == "mujoco" and found is not None:
        write = partial(write_mujoco, found=found)
    if gears is not None and gears.effects and target not in (ROBOT, "fmu"):
        words = "k and d as found beside the effects of the gears, some of which are left out: robot and fmu have all"
        run.console.say(f"export: {target} has {words}")
    paths = tuple(path for label, model in models.items() for path in write(folder / file_name(label), model))
    warn_of_distrust(run, "export", result)
    return _reported(run, paths)


def _export_draws(run: Run, count: int) -> tuple[Path, ...]:
    run.require_result("fit")
    gears = gears_of(run)
    result = with_gears(read_fit(run.path("fit")), gears)
    if gears is not None and result.robot is not None:
        found = with_effects(result.robot, gears)
        result = with_terms_of(replace(result, robot=found), found)
        run.console.say("export: all draws have the effects of gears that were found, and no other")
    folder = clear_folder(run.folder, "export", DRAWS)
    paths: list[Path] = []
    groups = robots_by_group(result, run.study.as_robot(), result.configurations)
    for label, (_, members) in groups.items():
        draws = draw_robots(result, count, run.study.seed or 0, members[0])
        written, lacking = write_draws(folder / file_name(label), draws, run.study.name)
        paths += written
        if lacking:
            run.console.warn(f"export: no MJCF of the draws: {lacking}")
        if draws.held:
            run.console.warn(f"export: the data do not reach {', '.join(draws.held)}, which all draws share")
    warn_of_distrust(run, "export", result)
    return _reported(run, tuple(paths))


def gears_of(run: Run) -> GearResult | None:
    """The effects of gears, where the study asks for them and they could be looked for."""
    if "gears" not in run.stages:
        return None
    run.require_result("gears")
    gears = read_gears(run.path("gears"))
    return None if gears is None or gears.refused else gears


def _write_robot(run: Run, gears: GearResult | None, folder: Path, model: FittedRobot) -> tuple[Path, ...]:
    friction = read_friction(run.path("estimate"))
    return _written(folder, robot_of_fit(model.name, model.robot, friction, interval_lines(model), gears))


def _write_compensation(run: Run, gears: GearResult | None, folder: Path, model: FittedRobot) -> tuple[Path, ...]:
    robot = with_findings(model.robot, read_friction(run.path("estimate")), gears)
    return write_compensation(folder, robot, model.name, interval_lines(model))


def _export_friction(run: Run, target: str) -> tuple[Path, ...]:
    """The robot with the identified law, tables of its numbers, or as C the filter of each joint that was followed."""
    if target == OBSERVER:
        run.require_stage("follow")
        run.require_result("follow")
        joints = read_filter(run.path("follow"))
        observers = {joint.joint: Observer(joint.filtered, joint.noise, joint.rate_hz) for joint in joints}
        return _reported(run, write_observers(clear_folder(run.folder, "export", target), observers))
    if target not in (ROBOT, COMPENSATION, "csv"):
        raise StudyError(
            "study/stage",
            f"study {run.study.name} identifies friction, and {target} takes a fitted elastic model: export to robot, "
            "and take that file as the robot of an elastic study, to csv, to compensation, or to observer, which "
            "follows friction",
        )
    run.require_result("friction")
    result = read_friction_result(run.path("friction"))
    if target == "csv":
        return _reported(run, write_friction_csv(clear_folder(run.folder, "export", target), result))
    if target == COMPENSATION:
        robot = with_identified_friction(run.study.as_robot(), result)
        return _reported(run, write_compensation(clear_folder(run.folder, "export", target), robot, run.study.name, ()))
    text = robot_of_friction(run.study.name, run.study.as_robot(), result)
    return _reported(run, _written(clear_folder(run.folder, "export", target), text))


def _written(folder: Path, text: str) -> tuple[Path]:
    write_text(folder / "robot.yml", text)
    return (folder / "robot.yml",)


def _export_responses(run: Run, target: str) -> tuple[Path, ...]:
    """The measured responses, of a study without a robot or for a target that takes them alone."""
    if target not in RESPONSE_TARGETS:
        raise StudyError(
            "study/stage",
            f"study {run.study.name} has no robot, and {target} takes the model of one; export its responses to "
            f"{', '.join(RESPONSE_TARGETS)}, or give the robot and fit it",
        )
    run.require_result("estimate")
    folder, responses = clear_folder(run.folder, "export", target), read_responses(run.path("estimate"))
    write = RESPONSE_TARGETS[target]
    if target in WITH_MODES and run.study.robot is None:
        from elastid.modal.estimate import modes_of_responses  # SciPy's linear algebra

        write = partial(write, modes=modes_of_responses(responses, run.study.modal))
        if target == "uff":
            spec = run.study.experiment.responses
            write = partial(write, geometry=run.study.modal.geometry or geometry_of_files(spec, run.loaded.base))
    return _reported(run, write(folder, run.study.name, responses))


def _reported(run: Run, paths: tuple[Path, ...]) -> tuple[Path, ...]:
    for path in paths:
        run.console.say(f"export: {path}")
    return paths
