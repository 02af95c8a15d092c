"""`elastid predict MODEL --log LOG`: simulation of a model along logs from the commands, compared with positions."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from elastid.app.commanded_robot import command_delay, commanded_robot, rigid_numbers
from elastid.app.console import Console
from elastid.app.from_robot import read_mjcf_servos, read_urdf_model
from elastid.app.identified_robot import with_identified_effects
from elastid.app.run import open_run_folder
from elastid.base.arrays import FloatArray
from elastid.base.display import number
from elastid.base.errors import MisfitError, StudyError
from elastid.base.execution import Execution
from elastid.experiment.specs.logs import RecordedSpec
from elastid.fit.fitted_robot import estimated_robot
from elastid.logs.command_log import CommandLog, read_command_log, read_study_log
from elastid.record import JointLoop
from elastid.report.figures.fit import command_errors_figure
from elastid.robot import Robot
from elastid.simulation.controller import loop_of
from elastid.simulation.spec import ControllerSpec
from elastid.store.files import save_checksums
from elastid.store.friction_study import read_friction_result
from elastid.store.kinds import SCHEMA, write_json
from elastid.store.measured import read_friction
from elastid.store.results import read_fit, read_gears
from elastid.study import load_robot
from elastid.study.robots import Servos
from elastid.validation.command_replay import (
    MAX_REMOVED,
    PREDICTORS,
    CommandedMotion,
    JointError,
    Replay,
    SettingTest,
    overall,
    pooled_joints,
    pooled_octaves,
    pooled_tests,
    replay,
)

MAX_TESTED = 3  # logs on which clock, delay, gains and signs are tested; each test simulates them
_NEAR = 0.08  # relative distance within which a clock ratio is rounded to a multiple of one half


@dataclass(frozen=True)
class Model:
    """Robot with the gains of its actuators by joint, if the model has them.

    offsets: constant torques on the joints, link side.  delay_s: delay of the commands.
    """

    robot: Robot
    servos: Servos = field(default_factory=dict)
    offsets: tuple[float, ...] = ()
    delay_s: float = 0.0


@dataclass(frozen=True)
class CommandSettings:
    """Options: rate of the logs, gains (N*m/rad, N*m*s/rad; one for all joints or one per joint), command delay.

    recorded: section of a study with the channels of the logs and the controller.
    """

    rate_hz: float | None = None
    kp: tuple[float, ...] = ()
    kd: tuple[float, ...] = ()
    delay_s: float | None = None
    recorded: RecordedSpec | None = None


def read_model(path: Path) -> Model:
    """Read the robot of a run folder, fit.h5, robot.yml, URDF, or an MJCF file with its servos."""
    if path.is_dir() or path.suffix == ".h5":
        return _robot_of_result(path)
    if not path.is_file():
        raise StudyError("files/missing", "no such file; give a run folder, robot.yml, URDF or MJCF", path)
    if path.suffix.lower() in (".xml", ".mjcf"):
        return Model(*read_mjcf_servos(path))
    return Model(read_urdf_model(path) if path.suffix.lower() == ".urdf" else load_robot(path))


def _robot_of_result(path: Path) -> Model:
    """Return the fitted robot of a run folder, with friction and gear effects identified from its records."""
    folder = path if path.is_dir() else path.parent
    fit, frf, gears, law = (folder / f"{stage}.h5" for stage in ("fit", "frf", "gears", "friction"))
    if fit.is_file():
        return Model(with_identified_effects(estimated_robot(read_fit(fit)), read_friction(frf), read_gears(gears)))
    if not law.is_file():
        text = "neither fit.h5 nor friction.h5 is there. Run the study first, or give a robot model"
        raise StudyError("files/missing", text, folder)
    result, robot = read_friction_result(law), load_robot(folder / "identified_robot.yml")
    values, delay_s = rigid_numbers(result), command_delay(result)
    # Without commands, an offset is a sensor error.
    offsets = [values.get((name, "offset"), 0.0) for name in robot.driven_names if delay_s is not None]
    return Model(commanded_robot(robot, result), {}, tuple(offsets), delay_s or 0.0)


def predict_from_commands(
    model_path: Path, logs: Sequence[Path], settings: CommandSettings, folder: Path, jobs: int, console: Console
) -> None:
    """Simulate a model along logs from their commands, compare with trivial predictors, and test the settings.

    Raises MisfitError, after writing, if a trivial predictor is as good for a joint, or if another clock, delay, gain
    or sign explains most of the error.
    """
    for path in logs:
        if not path.is_file():
            raise StudyError("files/missing", "no such file, or a folder; give the path of each log", path)
    model = read_model(model_path)
    with open_run_folder(folder, jobs, console):
        motions = [_motion(model, path, settings, console) for path in logs]
        is_tested = [i < MAX_TESTED for i in range(len(motions))]
        replays = Execution(jobs).ordered(partial(_replay, model.robot), [*zip(motions, is_tested, strict=True)])
        joints, tests = pooled_joints(replays), pooled_tests(replays)
        problem = " ".join(_problems(joints, tests))
        _print(console, replays, joints, tests)
        content = {
            "schema": SCHEMA, "model": str(model_path), "status": "misfit" if problem else "passed", "message": problem,
            "joints": [_joint_content(row) for row in joints],
            "tests": [asdict(t) | {"removed_fraction": t.removed_fraction, "in_doubt": t.is_in_doubt} for t in tests],
            "logs": [_log_content(row) for row in replays], "rms": _by_predictor(overall(joints)),
        }  # fmt: skip
        write_json(summary := folder / "prediction.json", content)
        command_errors_figure(joints).savefig(folder / "prediction.png")
        save_checksums(folder, [summary.name])
        if problem:
            raise MisfitError("predict/misfit", problem, str(summary))
        console.say(f"predict: passed: better than each trivial predictor in all {len(joints)} joints; {summary}")


def _replay(robot: Robot, work: tuple[CommandedMotion, bool]) -> Replay:
    return replay(robot, *work)


def _motion(model: Model, path: Path, settings: CommandSettings, console: Console) -> CommandedMotion:
    """Return the command and position signals of a log with the gains and the delay of its simulation."""
    if settings.recorded is None:
        log = read_command_log(path, model.robot.driven_names, settings.rate_hz)
    else:
        log = read_study_log(path, settings.recorded, model.robot, settings.rate_hz)
    if log.clock_hz is not None and abs(log.clock_hz / log.rate_hz - 1) > 0.01:
        text = f"{path}: sampling rate {log.clock_hz:g} Hz by its clock, {log.rate_hz:g} Hz by --rate. Omit --rate"
        console.warn(text + " unless the clock is wrong")
    loop = _gains(model, log, settings, path, console)
    controller = ControllerSpec()
    if settings.recorded is not None and settings.recorded.controller is not None:
        controller = settings.recorded.controller.spec
        loop = replace(loop, ki=loop_of(settings.recorded.controller, len(loop.kp)).ki)
    signals = log.command, log.velocity, log.position
    delay_s = model.delay_s if settings.delay_s is None else settings.delay_s
    return CommandedMotion(path.stem, log.rate_hz, *signals, loop, delay_s, controller, model.offsets)


def _gains(model: Model, log: CommandLog, settings: CommandSettings, path: Path, console: Console) -> JointLoop:
    """Return the gains of the options, else of the model's servos, else of the log; warn if the last two differ."""
    names = model.robot.driven_names
    gains = []
    servos = np.array([model.servos[name] for name in names]).T if set(names) <= model.servos.keys() else None
    for i, (name, option, log_gain) in enumerate((("kp", settings.kp, log.kp), ("kd", settings.kd, log.kd))):
        if option:
            if len(option) not in (1, len(names)):
                text = f"{len(option)} numbers for {len(names)} driven joints. Give one, or one for each"
                raise StudyError("options/invalid", text, f"--{name}")
            gains.append(np.broadcast_to(np.array(option, float), len(names)))
        elif servos is not None:
            if log_gain is not None and not np.allclose(log_gain, servos[i], rtol=0.01):
                numbers = f"{_numbers(servos[i])} in the model, {_numbers(log_gain)} in the log"
                console.warn(f"{path}: {name} differs: {numbers}. The model's is used; give --{name} for another")
            gains.append(servos[i])
        elif log_gain is not None:
            gains.append(log_gain)
        else:
            text = f"neither the log nor the model has {name} of the joint controllers. Give --{name}"
            raise StudyError("options/invalid", text, path)
    return JointLoop(np.asarray(gains[0]), np.asarray(gains[1]), np.zeros(len(names)))


def _numbers(values: FloatArray) -> str:
    return ", ".join(f"{value:g}" for value in values.tolist())


def _problems(joints: Sequence[JointError], tests: Sequence[SettingTest]) -> Iterator[str]:
    """Yield the most likely wrong setting, and the joints for which a trivial predictor is as good."""
    failed_tests = [test for test in tests if test.is_in_doubt]
    if failed_tests:
        yield f"Most likely wrong: {_test_sentence(failed_tests[0])}. Correct it, and repeat the prediction."
    if worse := [row.joint for row in joints if row.is_worse]:
        yield f"A trivial predictor is at least as good for {len(worse)} of {len(joints)} joints: {', '.join(worse)}."
        if not failed_tests:
            yield "Check their inertia and friction in the model, or identify them: `elastid new DIR --from LOG`."


def _test_sentence(test: SettingTest) -> str:
    """Describe a test: the setting, its best value, and the error with the best and with the stated value."""
    rms, as_given = number(test.rms, 3), number(test.rms_as_given, 3)
    error = f"rms error {rms} instead of {as_given} ({100 * test.removed_fraction:.3g} % removed)"
    match test.quantity:
        case "clock":
            return f"clock: the period of the log is {format_ratio(test.value)} times the given one; {error}"
        case "delay":
            side = "earlier" if test.value < 0 else "later"
            return f"delay: the commands act {1e3 * abs(test.value):.3g} ms {side} than simulated; {error}"
        case "kp" | "kd":
            return f"gain {test.quantity}: {test.value:.3g} times the given one; {error}"
        case "position sign":
            return f"sign: the position of joint {test.joint} is opposite to its command; {error}"
        case _:
            return f"axis: joint {test.joint} turns the other way than in the model; {error}"


def format_ratio(value: float) -> str:
    """Format a ratio of sampling times: the fitted ratio, and a multiple of one half near it.

    >>> format_ratio(2.56), format_ratio(0.41), format_ratio(1.2), format_ratio(1.02)
    ('2.5 (fitted: 2.56)', '1/2.5 (fitted: 0.41)', '1.2', '1.02')
    """
    above = max(value, 1 / value)
    nearest = round(2 * above) / 2
    if nearest in (1, above) or abs(above / nearest - 1) > _NEAR:
        return f"{value:.3g}"
    return f"{'1/' * (value < 1)}{nearest:g} (fitted: {value:.3g})"


def _print(
    console: Console, replays: Sequence[Replay], joints: Sequence[JointError], tests: Sequence[SettingTest]
) -> None:
    console.say("predict: rms error of the positions, simulated from the commands alone, beside trivial predictors")
    heads = ["joint", "unit", *PREDICTORS, "delay of command"]
    rows = [[row.joint, row.unit, *(number(x, 3) for x in row.rms), f"{1e3 * row.delay_s:.1f} ms"] for row in joints]
    console.table([heads, *rows, ["all", "", *(number(x, 3) for x in overall(joints)), ""]])
    if len(replays) > 1:
        by_log = [[row.log, "", *(number(x, 3) for x in overall(row.joints))] for row in replays]
        console.table([["log", "", *PREDICTORS], *by_log])
    octaves = pooled_octaves(joints)
    bands = [[f"{low:.3g} to {high:.3g} Hz", "", *(number(x, 3) for x in errors)] for low, high, errors in octaves]
    console.table([["octave, all joints", "", *PREDICTORS], *bands])
    for test in [test for test in tests if test.is_in_doubt]:
        console.say(f"predict: test of {_test_sentence(test)}")
    if removed := {test.quantity: test.removed_fraction for test in tests if not test.joint and not test.is_in_doubt}:
        largest = f"{max(removed.values()):.1%} removed at most; limit {MAX_REMOVED:.0%}"
        console.say(f"predict: tests of {', '.join(sorted(removed))}: {largest}")


def _joint_content(row: JointError) -> dict[str, Any]:
    octaves = [{"low_hz": low, "high_hz": high, "rms": _by_predictor(errors)} for low, high, errors in row.octaves]
    rms = _by_predictor(row.rms)
    return {"joint": row.joint, "unit": row.unit, "rms": rms, "command_delay_s": row.delay_s, "octaves": octaves}


def _log_content(row: Replay) -> dict[str, Any]:
    joints = [_joint_content(joint) for joint in row.joints]
    return {"log": row.log, "rate_hz": row.rate_hz, "rms": _by_predictor(overall(row.joints)), "joints": joints}


def _by_predictor(errors: Sequence[float]) -> dict[str, float]:
    return dict(zip(PREDICTORS, errors, strict=True))
