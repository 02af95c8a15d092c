"""export: a fit -> export/<target>/ in the run folder, the identified model for another tool; or responses alone."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

from elastid.app.commanded_robot import command_delay, robot_of_friction, with_armatures
from elastid.app.identified_robot import (
    robot_of_fit,
    with_findings,
    with_identified_friction,
)
from elastid.app.run import Run
from elastid.app.stages.fit import warn_of_distrust
from elastid.base.errors import StudyError, did_you_mean
from elastid.base.escape import file_name
from elastid.base.files import clear_folder
from elastid.fit.fitted_robot import FittedRobot, models_by_group, robots_by_group
from elastid.logs.responses.table import geometry_of_files
from elastid.nonlinear.gear_result import GearResult, with_effects, with_gears, with_linear_springs, with_terms_of
from elastid.simulation.controller import loop_of
from elastid.store.files import write_text
from elastid.store.friction_study import read_filter, read_friction_result
from elastid.store.measured import read_friction, read_responses
from elastid.store.results import read_fit, read_gears
from elastid.study import Study
from elastid.targets.actuators import (
    actuators_of,
    fit_intervals,
    friction_intervals,
    with_total_inertias,
    write_actuators,
)
from elastid.targets.code import write_c, write_casadi
from elastid.targets.control import write_control, write_responses_control
from elastid.targets.csv import write_csv, write_friction_csv, write_responses_csv
from elastid.targets.draws import write_draws
from elastid.targets.fmu import write_fmu
from elastid.targets.friction import write_compensation, write_observers
from elastid.targets.matlab import write_matlab, write_responses_matlab
from elastid.targets.mujoco import write_mujoco
from elastid.targets.numbers import interval_lines
from elastid.targets.uff import write_uff
from elastid.targets.urdf import write_urdf
from elastid.use.draws import draw_robots

Writer = Callable[[Path, FittedRobot], tuple[Path, ...]]
ResponseWriter = Callable[..., tuple[Path, ...]]
Export = Callable[[Run, str, Path], Iterable[Path]]

TARGETS: dict[str, Writer] = {
    "control": write_control, "matlab": write_matlab, "mujoco": write_mujoco, "fmu": write_fmu, "urdf": write_urdf,
    "casadi": write_casadi, "c": write_c, "csv": write_csv,
}  # fmt: skip
# Of measured responses: all that a study without a robot has. uff takes those of any study.
RESPONSE_TARGETS: dict[str, ResponseWriter] = {
    "control": write_responses_control, "matlab": write_responses_matlab, "csv": write_responses_csv, "uff": write_uff,
}  # fmt: skip
# Of these, targets that take the modes of a study without a robot too.
WITH_MODES = ("control", "csv", "uff")
# The targets that are no other tool's: elastid's own, robots drawn from the fit, the filter of a study of friction.
ROBOT, SAMPLES, OBSERVER, COMPENSATION = "robot", "samples", "observer", "compensation"
ACTUATORS = "actuators"  # numbers of joints for several simulators


def export(run: Run, target: str, count: int = 1000) -> tuple[Path, ...]:
    """export/<target>/: the identified model for another tool; StudyError where there is no current fit or such target.

    count: of draws.

    Where robots, or other groups of configurations, have parameters of their own: a model of each in a folder below.
    """
    targets = _targets(run.study, count)
    if target not in targets:
        of_others = target in {*TARGETS, *RESPONSE_TARGETS, ROBOT, SAMPLES, OBSERVER, COMPENSATION, ACTUATORS}
        code, known = "study/stage" if of_others else "export/target", did_you_mean(target, sorted(targets))
        raise StudyError(code, f"study {run.study.name} of kind {run.study.kind}: {known}", f"--to {target}")
    stages, write = targets[target]
    for stage in stages:
        run.require_stage(stage)
        run.require_result(stage)
    paths = tuple(write(run, target, clear_folder(run.folder, "export", target)))
    for path in paths:
        run.console.say(f"export: {path}")
    return paths


def _targets(study: Study, count: int) -> dict[str, tuple[tuple[str, ...], Export]]:
    """Targets of a kind of study: the stages whose results each takes, and its function (run, target, folder)."""
    if study.friction is not None:
        of_law: tuple[tuple[str, ...], Export] = (("friction",), _export_friction)
        return dict.fromkeys((ROBOT, "csv", COMPENSATION, ACTUATORS), of_law) | {
            OBSERVER: (("follow",), _export_observers)
        }
    measured: tuple[tuple[str, ...], Export] = (("estimate",), _export_responses)
    if study.robot is None:
        return dict.fromkeys(RESPONSE_TARGETS, measured)
    fitted: tuple[tuple[str, ...], Export] = (("estimate", "fit"), _export_fit)
    draws: tuple[tuple[str, ...], Export] = (("fit",), partial(_export_draws, count))
    return dict.fromkeys((*TARGETS, ROBOT, COMPENSATION, ACTUATORS), fitted) | {"uff": measured, SAMPLES: draws}


def _export_fit(run: Run, target: str, folder: Path) -> Iterable[Path]:
    responses, gears = read_responses(run.path("estimate")), gears_of(run)
    result, robot = with_gears(read_fit(run.path("fit")), gears), run.study.as_robot()
    geared = None if gears is None else with_effects(robot, gears)
    if geared is not None and target != ROBOT:
        robot = with_linear_springs(geared) if target == "mujoco" else geared
        result = with_terms_of(result, robot)
    models = models_by_group(result, robot, responses, run.study.model, run.study.name)
    if any(models):
        groups = (f"{label} ({', '.join(G.configuration.name for G in m.measured)})" for label, m in models.items())
        run.console.say(f"export: one model for each group with its own parameters: {', '.join(groups)}")
    friction = read_friction(run.path("estimate"))
    own: dict[str, Writer] = {
        ROBOT: lambda folder, m: _written(folder, robot_of_fit(m.name, m.robot, friction, interval_lines(m), gears)),
        COMPENSATION: lambda folder, m: write_compensation(
            folder, with_findings(m.robot, friction, gears), m.name, interval_lines(m)
        ),
    }
    own[ACTUATORS] = lambda folder, m: write_actuators(
        folder,
        actuators_of(m.name, with_findings(m.robot, friction, gears), fit_intervals(m, friction), _gains(run.study)),
    )
    write = (own | TARGETS)[target]
    if target == "mujoco":
        write = partial(write_mujoco, rubbing=geared)
    if gears is not None and gears.effects and target not in (ROBOT, "fmu"):
        words = "some effects of the gears are omitted (k and d are as estimated with them); robot and fmu have all"
        run.console.say(f"export: {target}: {words}")
    warn_of_distrust(run, "export", result)
    return [path for label, model in models.items() for path in write(folder / file_name(label), model)]


def _export_draws(count: int, run: Run, target: str, folder: Path) -> Iterator[Path]:
    gears = gears_of(run)
    result = with_gears(read_fit(run.path("fit")), gears)
    if gears is not None and result.robot is not None:
        geared = with_effects(result.robot, gears)
        result = with_terms_of(replace(result, robot=geared), geared)
        run.console.say("export: all samples have the same effects of the gears")
    for label, (_, members) in robots_by_group(result, run.study.as_robot(), result.configurations).items():
        draws = draw_robots(result, count, run.study.seed, members[0])
        written, lacking = write_draws(folder / file_name(label), draws, run.study.name)
        yield from written
        if lacking:
            run.console.warn(f"export: no MJCF of the samples: {lacking}")
        if draws.fixed:
            run.console.warn(f"export: {', '.join(draws.fixed)} not identifiable: the same in all samples")
    warn_of_distrust(run, "export", result)


def _gains(study: Study) -> tuple[tuple[float, float], ...]:
    """kp and kd of each joint, link side, by the controller of a study; none if its gains are not stated."""
    simulated, recorded = study.experiment.simulated, study.experiment.recorded
    controller = recorded.controller if recorded else simulated.controller.gains if simulated else None
    if controller is None:
        return ()
    loop = loop_of(controller, len(study.as_robot().driven))
    return tuple(zip(loop.kp.tolist(), loop.kd.tolist(), strict=True))


def gears_of(run: Run) -> GearResult | None:
    """The effects of gears, where the study asks for them and they could be looked for."""
    if "gears" not in run.stages:
        return None
    run.require_result("gears")
    gears = read_gears(run.path("gears"))
    return None if gears is None or gears.refused else gears


def _export_friction(run: Run, target: str, folder: Path) -> Iterable[Path]:
    """The robot with the identified law, tables of its numbers, or its torque over velocity in C."""
    name, robot, result = run.study.name, run.study.as_robot(), read_friction_result(run.path("friction"))
    if target == "csv":
        return write_friction_csv(folder, result)
    if target == COMPENSATION:
        return write_compensation(folder, with_identified_friction(robot, result), name, ())
    if target == ACTUATORS:
        delay_s, intervals = command_delay(result), friction_intervals(result)
        numbers = actuators_of(name, with_armatures(robot, result), intervals, _gains(run.study), delay_s)
        return write_actuators(folder, with_total_inertias(numbers, result))
    return _written(folder, robot_of_friction(name, robot, result))


def _export_observers(run: Run, target: str, folder: Path) -> Iterable[Path]:
    return write_observers(folder, {row.joint: row for row in read_filter(run.path("follow"))})


def _written(folder: Path, text: str) -> tuple[Path]:
    write_text(folder / "robot.yml", text)
    return (folder / "robot.yml",)


def _export_responses(run: Run, target: str, folder: Path) -> Iterable[Path]:
    write, responses = RESPONSE_TARGETS[target], read_responses(run.path("estimate"))
    if target in WITH_MODES and run.study.robot is None:
        from elastid.modal.estimate import modes_of_responses  # SciPy's linear algebra

        write = partial(write, modes=modes_of_responses(responses, run.study.modal))
        if target == "uff":
            of_files = geometry_of_files(run.study.experiment, run.loaded.path.parent)
            write = partial(write, geometry=run.study.modal.geometry or of_files)
    return write(folder, run.study.name, responses)
