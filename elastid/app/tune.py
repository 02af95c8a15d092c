"""tune: references of the motors along a move of the fitted robot."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from elastid.app.identified_robot import with_found_friction
from elastid.app.run import Run
from elastid.app.use_fit import Used, use_fit
from elastid.base.display import Display, number, percent
from elastid.base.files import clear_folder
from elastid.experiment.simulated.plant import true_robot
from elastid.fit.posture import Asked
from elastid.fit.result import Result
from elastid.report.answer import Answer
from elastid.report.figures.use import move_figure
from elastid.robot import Robot
from elastid.store.files import write_rows
from elastid.store.measured import read_friction
from elastid.store.results import write_tune
from elastid.targets.fmu import write_move_fmu
from elastid.targets.move import write_move
from elastid.use.command.moves import KINDS, read_move
from elastid.use.command.tune import Given, TunedMove, tune_move
from elastid.use.draws import draw_robots, estimated_robot


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

    def work(result: Result) -> Used:
        given = _given(run, asked, result)
        move = read_move(asked.path, given.identified, given.frame, 0.0 if asked.fastest else asked.duration)
        with run.console.progress("tune") as progress:
            tuned = tune_move(given, move, run.study.name, progress)
        folder = clear_folder(run.folder, "tune")
        files = {
            "tune.h5": lambda path: write_tune(path, tuned, run.stamps["fit"]),
            "tune.csv": lambda path: write_table(path, tuned),
            "tune": lambda _: (write_move(folder, tuned), write_move_fmu(folder, given.identified, tuned)),
        }
        warnings = (tuned.advice,) if tuned.advice else ()
        return Used(answer(tuned), files, partial(move_figure, tuned), warnings=warnings)

    use_fit(run, "tune", work)


def _given(run: Run, asked: Command, result: Result) -> Given:
    """The robots of a study with the frame that is asked for."""
    study = run.study
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


def write_table(path: Path, tuned: TunedMove) -> None:
    """tune.csv: a row for each sample, link side, SI."""
    parts = ("position", "velocity", "torque")
    heads = ["t", *(f"{part} {joint}" for joint in tuned.joints for part in parts), "x", "y", "z", "planned error"]
    columns = [getattr(tuned, part)[:, i] for i in range(len(tuned.joints)) for part in parts]
    rows = zip(tuned.time_s, *columns, *tuned.target.T, tuned.planned, strict=True)
    write_rows(path, [heads, *([float(cell) for cell in row] for row in rows)])


def answer(tuned: TunedMove) -> Answer:
    """The time of a move, its exactness against rigid feedforward, its use of the motors' limits."""
    rigid, own, drawn = tuned.outcomes[0], tuned.outcomes[-1], bool(tuned.draws)
    used = np.array([np.abs(getattr(tuned, kind)).max(axis=0) for kind in KINDS]) / tuned.limits
    kind, i = np.unravel_index(int(np.argmax(used)), used.shape)
    most = f"the {list(KINDS)[kind]} of motor {tuned.joints[i]} is used most, {percent(used[kind, i], 3)} of it"
    kept = f"Yes: of all limits {most}." if used.any() else "No limit is given."
    exact = (
        f"{tuned.duration:.4g} s: {tuned.frame} stays within {number(1e3 * own.largest, 3)} mm of its path on the "
        f"{tuned.judge}, with rigid feedforward within {number(1e3 * rigid.largest, 3)} mm; its vibration after the "
        f"move is {number(rigid.residual / max(own.residual, 1e-12), 3)} times smaller."
    )
    on_draws = (
        f"On {tuned.draws} robots drawn from the fit, lengths and zeros within their tolerances, the largest error is "
        f"at most {number(1e3 * float(own.high.max()), 3)} mm (95 %), and torques take at most "
        f"{100 * (tuned.most / tuned.limits[3]).max():.0f} % of their limits."
        if own.high is not None and drawn
        else ""
    )
    advice = f"{tuned.advice}." if tuned.advice else "Give the drives tune.csv, or a file of the folder tune."
    errors = [(o.name, *(number(1e3 * v, 3) for v in (o.largest, o.rms, o.static, o.residual))) for o in tuned.outcomes]
    limits = []
    for joint, unit, motor in zip(tuned.joints, tuned.units, range(len(tuned.joints)), strict=True):
        cells = [f"{joint} ({unit})"]
        for name, limit in zip(KINDS, tuned.limits[:, motor], strict=True):
            value = number(float(np.abs(getattr(tuned, name)[:, motor]).max()), 3)
            cells.append(f"{value} of {number(float(limit), 3)}" if np.isfinite(limit) else value)
        limits.append((*cells, *[number(float(tuned.most[motor]), 4)] * drawn))
    return Answer(
        f"Move of {tuned.name}",
        (
            ("How exactly does the tool follow?", tuple(filter(None, (exact, on_draws)))),
            ("Do the motors keep their limits?", (kept,)),
            ("What next?", (advice[0].upper() + advice[1:],)),
        ),
        (
            Display("Error of the tool in mm", ("command", "largest", "rms", "at rest after it", "vibration"), errors),
            Display("Limits of the motors", ("motor", *KINDS, *["torque on draws"] * drawn), limits),
        ),
        (
            f"Judged in position loops of {tuned.bandwidth_hz:.3g} Hz. Grey: the move; {1e3 * tuned.margin_s:.0f} ms "
            "before and after it the motors wind the springs up and unwind them. Link side, SI: largest value and "
            "limit of the robot's file.",
        ),
    )
