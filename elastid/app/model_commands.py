"""Commands map, tune and loops, which use a fitted model: each writes files, a page and a figure, and an answer."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, TypeAlias

from matplotlib.figure import Figure

from elastid.app.identified_robot import with_identified_effects
from elastid.app.run import Run
from elastid.app.stages.fit import current_fit, gears_of, warn_of_distrust
from elastid.base.display import Answer
from elastid.base.errors import StudyError
from elastid.base.execution import Execution
from elastid.base.files import clear_folder
from elastid.experiment.simulated.plant import true_robot
from elastid.fit import posture
from elastid.fit.fitted_robot import estimated_robot
from elastid.fit.result import Result
from elastid.nonlinear.gear_result import with_gears
from elastid.report.command_summaries import answer_of_loops, answer_of_map, answer_of_move
from elastid.report.figures.use import loops_figure, move_figure, workspace_figure
from elastid.report.page.page_of_use import map_data, write_page_of_answer
from elastid.robot import Robot
from elastid.store.files import save_checksums, write_rows, write_text
from elastid.store.measured import read_friction
from elastid.store.results import write_loops, write_map, write_map_table, write_tune
from elastid.study.robots import yaml_text
from elastid.targets.fmu import write_move_fmu
from elastid.targets.move import write_move
from elastid.use.draws import draw_robots
from elastid.use.loops import Loops, design_loops
from elastid.use.map import map_workspace
from elastid.use.moves import read_move
from elastid.use.path_table import read_path
from elastid.use.plants import PostureFamily
from elastid.use.posture_values import Cut
from elastid.use.postures import grid_postures, random_postures
from elastid.use.tune import MoveRobots, TunedMove, tune_move

Vector: TypeAlias = tuple[float, float, float]


@dataclass(frozen=True)
class ModelOutputs:
    """Answer, files (name -> write(path)), figure of the page, and data of an interactive map."""

    answer: Answer
    files: Mapping[str, Callable[[Path], Any]]
    figure: Callable[[], Figure]
    data: str = ""


def use_fit(run: Run, name: str, work: Callable[[Result], ModelOutputs]) -> None:
    """Run the command `name` on the fit of a study, and write and print its results; StudyError without a fit."""
    result = current_fit(run)
    with run.open_folder():
        results, made_by = work(result), run.stamps["fit"].entries["made by"]
        for file, write in results.files.items():
            write(run.folder / file)
        write_page_of_answer(results.answer, results.figure, run.folder / f"{name}.html", made_by, results.data)
        names = (*results.files, f"{name}.html", f"{name}.png")
        save_checksums(run.folder, names)
        for table in results.answer.tables:
            run.console.detail(table.text)
        for sentence in (*results.answer.sentences, ", ".join(str(run.folder / name) for name in names)):
            run.console.say(f"{name}: {sentence}")
        warn_of_distrust(run, name, result)


def map_study(
    run: Run, frame: str | None, path: Path | None, grid: int | None, random: int | None, load: Vector, cutting: float,
    normal: Vector | None, force: Vector | None
) -> None:  # fmt: skip
    """Map the stiffness at the postures of a path, on a grid (points along its longest side), or at random."""
    if sum(option is not None for option in (path, grid, random)) > 1:
        raise StudyError("options/invalid", "--path, --grid and --random are exclusive. Give one of them")
    try:
        cut = Cut(load, cutting, normal or None, force or None)
    except ValueError as error:
        raise StudyError("options/invalid", str(error)) from None

    def work(fit: Result) -> ModelOutputs:
        """Map the fitted robot."""
        ports, seed = posture.PredictionPorts(frame=frame, axes="world"), run.study.seed
        family = with_gears(fit, gears_of(run)).family(ports)
        if path is not None:
            angles, remarks = read_path(path, family.robot, family.frame)
            for remark in remarks:
                run.console.warn(f"map: {remark}")
        elif grid is not None:
            angles = grid_postures(family.robot, family.frame, grid, seed)
        else:
            angles = random_postures(family.robot, random or 1000, seed)
        with run.console.progress("map") as progress:
            execution = Execution(run.jobs if len(angles) > 10_000 else 0, progress)
            workspace = map_workspace(
                family, angles, cut, name=run.study.name, is_path=path is not None, execution=execution
            )
        files = {
            "map.h5": lambda path: write_map(path, workspace, run.stamps["fit"]),
            "map.csv": lambda path: write_map_table(path, workspace),
        }
        return ModelOutputs(answer_of_map(workspace), files, partial(workspace_figure, workspace), map_data(workspace))

    use_fit(run, "map", work)


def tune_study(
    run: Run, path: Path, duration: float | None, fastest: bool, error_mm: float, frame: str | None,
    rate_hz: float | None, bandwidth_hz: float, samples: int
) -> None:  # fmt: skip
    """Optimise motor references for a move of the fitted robot."""
    if duration is not None and fastest:
        raise StudyError("options/invalid", "--time and --fastest are exclusive. Give one of them")

    def work(result: Result) -> ModelOutputs:
        """Tune the move of the fitted robot."""
        robots = _move_robots(run, result, frame, samples, rate_hz, bandwidth_hz, error_mm / 1e3)
        move = read_move(path, robots.identified, robots.frame, 0.0 if fastest else duration)
        with run.console.progress("tune") as progress:
            tuned_move = tune_move(robots, move, run.study.name, progress)
        folder = clear_folder(run.folder, "tune")
        files = {
            "tune.h5": lambda path: write_tune(path, tuned_move, run.stamps["fit"]),
            "tune.csv": lambda path: write_table(path, tuned_move),
            "tune": lambda _: (write_move(folder, tuned_move), write_move_fmu(folder, robots.identified, tuned_move)),
        }
        if tuned_move.advice:
            run.console.warn(f"tune: {tuned_move.advice}")
        return ModelOutputs(answer_of_move(tuned_move), files, partial(move_figure, tuned_move))

    use_fit(run, "tune", work)


def _move_robots(
    run: Run, result: Result, frame: str | None, draws: int, rate_hz: float | None, bandwidth_hz: float, error_m: float
) -> MoveRobots:
    """Return the identified robot, posterior samples and the robot that judges the move, with the requested frame."""
    study, family = run.study, result.family(posture.PredictionPorts(frame=frame))
    friction = read_friction(run.path("estimate"))

    def with_frame(robot: Robot) -> Robot:
        return replace(robot, frames=family.robot.frames)

    identified = with_frame(with_identified_effects(estimated_robot(result), friction))
    judge, judge_name = identified, "simulation with the identified parameters"
    simulated = study.experiment.simulated
    if simulated is not None:
        judge, judge_name = (
            with_frame(true_robot(study.as_robot(), simulated.truth)),
            "simulation with the true parameters",
        )
    samples = draw_robots(result, draws, study.seed).robots if draws else ()
    # 500 Hz is typical if the study has no rate of the controller.
    study_rate = study.excitation.rate_hz if study.excitation is not None else 500.0
    return MoveRobots(
        identified, with_frame(study.as_robot()), judge, judge_name, tuple(map(with_frame, samples)), family.frame,
        rate_hz or study_rate, bandwidth_hz, error_m
    )  # fmt: skip


def write_table(path: Path, tuned_move: TunedMove) -> None:
    """Write tune.csv: a row for each sample, link side, SI."""
    kinds = ("position", "velocity", "torque")
    heads = ["t", *(f"{kind} {joint}" for joint in tuned_move.joints for kind in kinds), "x", "y", "z", "planned error"]
    columns = [getattr(tuned_move, kind)[:, i] for i in range(len(tuned_move.joints)) for kind in kinds]
    rows = zip(tuned_move.time_s, *columns, *tuned_move.target.T, tuned_move.predicted_error, strict=True)
    write_rows(path, [heads, *([float(cell) for cell in row] for row in rows)])


def loops_study(run: Run, rate_hz: float | None, delay: int | None, samples: int) -> None:
    """Analyse and design the joint controllers, by default at the rate and delay of the study."""
    experiment, study_hz, today = run.study.experiment, None, None
    if (recorded := experiment.recorded) is not None:
        study_hz = None if recorded.rate_hz == "unknown" else recorded.known_rate_hz
        today = None if recorded.controller is None else recorded.controller.spec
    elif experiment.simulated is not None:
        study_hz = None if run.study.excitation is None else run.study.excitation.rate_hz
        today = experiment.simulated.controller
    hz = rate_hz or study_hz
    if hz is None:
        raise StudyError("options/invalid", "the study has no rate of the controller. Give --rate", run.loaded.path)

    def work(result: Result) -> ModelOutputs:
        """Analyse and design the loops of the fitted robot."""
        family = PostureFamily.of(result, [linear.configuration for linear in result.linear], hz)
        delay_samples = (0 if today is None else today.delay_samples) if delay is None else delay
        loops = design_loops(run.study.name, result, family, delay_samples, samples, run.study.seed, today, study_hz)
        files = {
            "loops.h5": lambda path: write_loops(path, loops, run.stamps["fit"]),
            "loops.yml": lambda path: write_text(path, loops_section(loops)),
        }
        answer, figure = replace(answer_of_loops(loops), text=loops_section(loops)), partial(loops_figure, loops)
        return ModelOutputs(answer, files, figure)

    use_fit(run, "loops", work)


def loops_section(loops: Loops) -> str:
    """Return the designed controller as a section of a study."""
    head = (
        f"Gains for {loops.name} by `elastid loops`, at {loops.rate_hz:g} Hz, link side, SI: the section",
        "experiment.simulated.controller of a study whose excitation.rate_hz is that rate.",
    )
    return yaml_text({"controller": loops.controller}, head)
