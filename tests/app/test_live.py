"""A live identification from the command line: to its goal, killed and begun again, and with logs that are wrong."""

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from plants.arm_study import LIVE, TRUTH

from elastid.app import cli
from elastid.app.console import Console
from elastid.app.live import Session, write_simulated_log
from elastid.app.run import Run
from elastid.design.next_experiment import read_goal
from elastid.experiment.plan.plan import Plan
from elastid.experiment.simulated.rig import SimulatedRig
from elastid.store.plan import read_plan
from elastid.store.results import read_fit
from elastid.study import load

GOAL = "k_*: 0.2 %"


@pytest.fixture(scope="module")
def study(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("arm") / "study.yml"
    path.write_text(LIVE)
    return path


def session(study: Path, folder: Path, *goals: str, jobs: int = 1, robot_time: float | None = None) -> Session:
    return Session.of(Run(load(study), folder, jobs, Console(-2)), goals or (GOAL,), True, robot_time)


@pytest.fixture(scope="module")
def measured(study) -> Path:
    """The folder of a session that has reached its goal, its final results not yet made."""
    folder = study.parent / "measured"
    _, reached, words = session(study, folder).work()
    assert reached, words
    return folder


def command(study: Path, folder: Path, *words: str) -> int:
    return cli.run_command(["live", str(study), "--run", str(folder), "--jobs", "1", "-q", *words])


def contents(folder: Path) -> dict[str, bytes]:
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in sorted((folder / "live").rglob("*"))
        if path.suffix in (".csv", ".h5")
    }


@pytest.mark.slow
def test_live_reaches_goal_in_less_time_than_plan(study: Path, measured: Path) -> None:
    """The folder is that of an ordinary run, whose intervals are as narrow as was asked for and hold the truth."""
    folder = study.parent / "finished"
    shutil.copytree(measured, folder)
    assert command(study, folder, "--goal", GOAL, "--simulate") == 0
    result = read_fit(folder / "fit.h5")
    assert max(read_goal([GOAL], result.parameters.free_names).reached(result).values()) <= 1
    for name, value in TRUTH.items():
        low, high = result.interval(name)
        assert low < value < high
    plans = [read_plan(path) for path in sorted((folder / "live").glob("x?.h5"))]
    # Three configurations, two realisations, two experiments of a period of transient, two periods and two ramps.
    assert sum(plan.robot_time_s for plan in plans) <= 0.67 * 3 * 2 * 2 * (3 * 1 + 2 * 0.5)
    assert (folder / "report.html").is_file()


@pytest.mark.slow
def test_a_session_that_was_killed_ends_with_the_same_bytes(study: Path, measured: Path) -> None:
    """Whatever was there when it was killed, and however many processes it has."""
    folder = study.parent / "killed"
    shutil.copytree(measured, folder)
    last = max(int(path.stem[1:]) for path in (folder / "live").glob("x?.h5"))
    (folder / "live" / f"x{last}.h5").unlink()
    shutil.rmtree(folder / "live" / f"x{last}")
    (folder / "live" / "logs" / f"x{last}-r1-e1.csv").unlink()
    (folder / "live" / ".x9.h5.unfinished").write_bytes(b"half")
    session(study, folder, jobs=2).work()
    assert contents(folder) == contents(measured)


def spoilt(measured: Path, folder: Path, spoil: Callable[[Path], None]) -> Path:
    """A session whose first logs are yet to be fitted, the first of them spoilt."""
    shutil.copytree(measured, folder)
    shutil.rmtree(folder / "live" / "x1")
    spoil(folder / "live" / "logs" / "x1-r0-e0.csv")
    return folder


def change(path: Path, rows: Callable[[np.ndarray], np.ndarray]) -> None:
    values = np.loadtxt(path, delimiter=",", skiprows=1)
    head = path.read_text().partition("\n")[0]
    np.savetxt(path, rows(values), fmt="%.12g", delimiter=",", header=head, comments="")


# Columns: time_s, r 1, r 2, u 1, u 2, y 1, y 2.
FAULTS = {
    "posture": (lambda path: change(path, lambda x: x + np.eye(7)[6] / 10), "(y) of motor 2"),
    "no column": (lambda path: path.write_text(path.read_text().replace("u motor 1", "torque_1")), "u motor 1"),
    "no log": (lambda path: path.write_bytes(b"\x00\x01"), "x1-r0-e0.csv"),
    "two logs": (lambda path: shutil.copy(path, path.with_suffix(".txt")), "logs of the same experiment"),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("fault", FAULTS)
def test_a_log_that_contradicts_its_plan_ends_the_command(
    fault: str, study: Path, measured: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    spoil, words = FAULTS[fault]
    folder = spoilt(measured, study.parent / fault.replace(" ", "-"), spoil)
    assert command(study, folder, "--goal", GOAL, "--simulate") == 1
    message = capsys.readouterr().err
    assert words in message
    assert "x1-r0-e0" in message
    assert not (folder / "fit.h5").exists()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--goal", "k_*"), "[design/goal]"),
        (("--goal", "k_*: 1"), "[design/goal]"),
        (("--goal", "k_*: -1 %"), "[design/goal]"),
        (("--goal", "m_*: 1 %"), "[design/goal]"),
        (("--goal", GOAL, "--robot-time", "3"), "next experiment 16 s"),
        (("--goal", GOAL, "--set", "experiment.simulated.carrier={kind: offset, velocity: 0.1}"), "simulated.carrier"),
        (("--goal", GOAL, "--set", "experiment.simulated.outputs=[motor 1]"), "simulated.outputs"),
        (("--goal", GOAL, "--set", "fit.robots={A: [down, out, up]}"), "fit.robots"),
        (("--goal", GOAL, "--set", "fit.parameters.d_1={per: configuration}"), "d_1.per"),
        (("--goal", GOAL, "--set", "fit.weights.factors=[{factor: 0.5, configurations: [out]}]"), "weights.factors"),
        (
            ("--goal", GOAL, "--set", "robot.payload={mass: 5, at: fore}", "--set", "experiment.without_payload=[out]"),
            "without_payload",
        ),
    ],
)
def test_what_cannot_be_done_is_said_before_the_robot_moves(
    words: tuple[str, ...], message: str, study: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert command(study, tmp_path / "run", *words) == 2
    assert message in capsys.readouterr().err
    assert not list(tmp_path.rglob("references/*"))


@pytest.mark.slow
def test_a_goal_out_of_reach_ends_with_a_sentence(study: Path, measured: Path) -> None:
    """By the robot's time; and by what no measurement can show."""
    folder = study.parent / "narrow"
    shutil.copytree(measured, folder)
    _, reached, words = session(study, folder, "k_*: 0.02 %").work()
    assert not reached
    assert "--robot-time" in words
    _, reached, words = session(study, folder, "k_*: 0.00001 %").work()
    assert not reached
    assert "--robot-time" not in words
    assert "robot.tolerances" in words


@pytest.mark.slow
def test_payload_change_without_holding_torque_contradicts_earlier_logs(study: Path) -> None:
    """A tenth more mass from the second experiment on; with the right logs in their place the goal is reached."""
    folder = study.parent / "payload"
    session(study, folder, robot_time=16.0).work()
    finer = session(study, folder, "k_*: 0.05 %", robot_time=100.0)
    first = read_plan(finer.plan(1))
    second = finer._next_plan([first], finer._fit([first], None))
    assert isinstance(second, Plan)
    own = replace(finer.problem.experiment, simulated=finer.run.study.experiment.simulated)
    heavier = finer.run.study.as_robot().with_parameters({"m_fore": 22.0})
    for robot, is_right in ((heavier, False), (finer.run.study.as_robot(), True)):
        rig = SimulatedRig(robot, own, second, 5)
        for run in second.experiments:
            write_simulated_log(finer.path / "logs", rig, run)
        _, reached, words = session(study, folder, "k_*: 0.05 %", robot_time=100.0).work()
        assert reached == is_right, words
        assert ("live/x2*" in words) == (not is_right)
