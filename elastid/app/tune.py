"""tune: references of the motors along a move of the fitted robot."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from elastid.app.identified_robot import with_found_friction
from elastid.app.run import Run, logged_in
from elastid.app.stages.fit import current_fit, warn_of_distrust
from elastid.base.display import number
from elastid.base.files import clear_folder
from elastid.experiment.simulated.plant import true_robot
from elastid.export.fmu import write_move_fmu
from elastid.export.move import write_move
from elastid.fit.posture import Asked
from elastid.report.page.page_of_use import write_page_of_move
from elastid.robot import Robot
from elastid.store.files import keep_checksums, write_rows
from elastid.store.measured import read_friction
from elastid.store.results import read_fit, write_tune
from elastid.use.command.moves import read_move
from elastid.use.command.tune import Given, TunedMove, tune_move
from elastid.use.draws import draw_robots, estimated_robot

RESULTS = ("tune.h5", "tune.csv", "tune.html", "tune.png")


@dataclass(frozen=True)
class Command:
    """A move as the command line asks for it."""

    path: Path
    duration: float | None
    fastest: bool
    error_m: float
    frame: str | None
    rate_hz: float | None
    bandwidth_hz: float
    draws: int


def tune_study(run: Run, asked: Command) -> None:
    """tune.h5, tune.csv and further files of a move on the study's fit; StudyError without a current one."""
    result = current_fit(run)
    with logged_in(run.folder, run.jobs, run.console):
        given = _given(run, asked)
        move = read_move(asked.path, given.identified, given.frame, 0.0 if asked.fastest else asked.duration)
        with run.console.progress("tune") as progress:
            tuned = tune_move(given, move, run.study.name, progress)
        _write(run, tuned, given.identified)
        run.console.table(table(tuned))
        for line in sentences(tuned):
            run.console.say(f"tune: {line}")
        if tuned.advice:
            run.console.warn(f"tune: {tuned.advice}")
        warn_of_distrust(run, "tune", result)


def _given(run: Run, asked: Command) -> Given:
    """The robots of a study with the frame that is asked for."""
    result, study = read_fit(run.path("fit")), run.study
    family = result.family(Asked(frame=asked.frame))
    friction = read_friction(run.path("estimate")) if run.path("estimate").exists() else None

    def framed(robot: Robot) -> Robot:
        return replace(robot, frames=family.robot.frames)

    identified = framed(with_found_friction(estimated_robot(result), friction))
    judge, judge_name = identified, "twin with the identified numbers"
    simulated = study.experiment.simulated
    if simulated is not None:
        judge, judge_name = framed(true_robot(study.as_robot(), simulated.truth)), "twin with the true numbers"
    draws = draw_robots(result, asked.draws, study.seed or 0).robots if asked.draws else ()
    # Where the rate of the study's controller is not known 500 Hz are usual.
    own_rate = study.excitation.rate_hz if study.excitation is not None else 500.0
    return Given(
        identified, framed(study.as_robot()), judge, judge_name, tuple(map(framed, draws)), family.frame,
        asked.rate_hz or own_rate, asked.bandwidth_hz, asked.error_m,
    )  # fmt: skip


def _write(run: Run, tuned: TunedMove, identified: Robot) -> None:
    write_tune(run.folder / "tune.h5", tuned, run.stamps["fit"])
    write_table(run.folder / "tune.csv", tuned)
    write_page_of_move(tuned, run.folder, run.stamps["fit"].shown)
    keep_checksums(run.folder, RESULTS)
    folder = clear_folder(run.folder, "tune")
    files = (*write_move(folder, tuned), *write_move_fmu(folder, identified, tuned))
    results = ", ".join(str(run.folder / name) for name in RESULTS)
    run.console.say(f"tune: {results}, and {len(files)} files for controllers and simulators in {folder}")


def write_table(path: Path, tuned: TunedMove) -> None:
    """tune.csv: a row for each sample, link side, SI."""
    parts = ("position", "velocity", "torque")
    heads = ["t", *(f"{part} {joint}" for joint in tuned.joints for part in parts), "x", "y", "z", "planned error"]
    columns = [getattr(tuned, part)[:, i] for i in range(len(tuned.joints)) for part in parts]
    rows = zip(tuned.time_s, *columns, *tuned.target.T, tuned.planned, strict=True)
    write_rows(path, [heads, *([float(cell) for cell in row] for row in rows)])


def table(tuned: TunedMove) -> list[list[str]]:
    """Errors of the tool in mm, and torques, by command."""
    rows = [["command", "judged on", "largest mm", "rms mm", "static mm", "vibration mm", "peak torque N*m"]]
    for own in tuned.outcomes:
        figures = [number(1e3 * value, 3) for value in (own.largest, own.rms, own.static, own.residual)]
        rows.append([own.name, tuned.judge, *figures, ", ".join(number(float(each), 4) for each in own.torque)])
    return rows


def sentences(tuned: TunedMove) -> tuple[str, ...]:
    """The move in words: its time, its exactness against rigid feedforward, and its use of the torque limits."""
    first, last = tuned.outcomes[0], tuned.outcomes[-1]
    lines = [
        f"{tuned.duration:.4g} s, {1e3 * tuned.margin_s:.0f} ms more before and after it; the largest error of "
        f"{tuned.frame} is {number(first.largest / max(last.largest, 1e-12), 3)} times smaller than with {first.name}, "
        f"its vibration after the move {number(first.residual / max(last.residual, 1e-12), 3)} times"
    ]
    if tuned.draws and last.high is not None:
        used, error = (tuned.most / tuned.limits[3]).max(), number(1e3 * float(last.high.max()), 3)
        lines.append(
            f"on {tuned.draws} robots drawn from the fit the largest error is at most {error} mm (95 %), and torques "
            f"take at most {100 * used:.0f} % of their limits"
        )
    return tuple(lines)
