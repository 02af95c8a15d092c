"""`elastid new DIR --from LOG`: a commented study of logs that runs without changes, and a robot for a friction study.

Values that are not in the logs are guessed and marked with the reason.
"""

import math
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType

import numpy as np

from elastid.app.from_responses import texts_from_responses, texts_from_universal
from elastid.app.joint_assignment import MIN_TURN, Positions, assign_joints, at_joint, order_of_names, positions_of
from elastid.app.measurements import Run, Signals, headings_of, hit_place, hit_runs, in_two_files, runs_by_name
from elastid.app.study_lines import channel_line, file_line, head_lines, join_lines, mapping, quote, relative_paths
from elastid.base.arrays import FloatArray
from elastid.base.errors import DataError, StudyError
from elastid.base.escape import one_line
from elastid.experiment.specs.logs import TextFormatSpec
from elastid.logs.channel_guess import LogGuess, guess_commands, guess_log
from elastid.logs.channel_names import ChannelGuess, guess_by_name
from elastid.logs.clocks import MAX_SAMPLES, MIN_SAMPLES, Clock, find_clock
from elastid.logs.command_log import read_gains
from elastid.logs.files.formats import is_text, open_log
from elastid.logs.files.text_format import describe_format, guess_format
from elastid.logs.files.universal import is_universal_file, time_histories
from elastid.logs.headings import is_time
from elastid.logs.log_signals import cell_error, read_signals
from elastid.logs.repair.periodicity import find_period, repetition
from elastid.robot import Robot
from elastid.study.robots import Servos

_SAME_RATE = 0.01  # relative difference of the rates of logs of one study
_FIT = (
    "# Inertias of motors are guesses too; leave Jm_* out where robot.yml has those of data sheets.",
    "fit: {parameters: {k_*: {}, d_*: {}, fm_*: {}, Jm_*: {}}}",
)
GAINS = ("kp", "kd")  # names of arrays with the gains of each joint


@dataclass(frozen=True)
class _Logs:
    """Logs of a study: files of each measurement, format, and clock, signals and shapes of the first log."""

    measurements: Sequence[tuple[Path, ...]]
    form: TextFormatSpec
    text: str
    clock: Clock
    signals: Signals
    shapes: Mapping[str, tuple[int, ...]]


def texts_from_logs(
    folder: Path, logs: Sequence[Path], robot: Robot | None = None, servos: Servos = MappingProxyType({})
) -> dict[str, str]:
    """Draft the files of a study from its first log; return texts by file name.

    folder: of the study.  robot: robot model of the logs.  servos: gains of its position servos by joint.
    Raises StudyError or DataError for a log that is unreadable, has no motion, or belongs to another robot.
    """
    first = logs[0]
    if missing := [path for path in logs if not path.exists()]:
        raise StudyError("files/missing", "there is no such file or folder. Give the path of a log", f"{missing[0]}")
    if first.is_file() and is_universal_file(first) and not time_histories(first):
        return texts_from_universal(logs, folder)
    form = guess_format(first)
    with open_log(first, form) as log:
        clock, signals, shapes = find_clock(log), read_signals(log, MAX_SAMPLES), log.shapes()
        bad_cell = cell_error(log, [signal.name for signal, _ in signals], MAX_SAMPLES)
    if texts := texts_from_responses(logs, folder, robot):
        return texts
    signals = [(g, x) for g, x in signals if g.name != clock.name]
    guess = guess_log(signals, clock.rate_hz or 1.0)
    text = f"    {describe_format(form)}" if form != TextFormatSpec() and is_text(first) else ""
    source = _Logs([(path,) for path in logs], form, text, clock, signals, shapes)
    if guess is None and (pairs := guess_commands(signals, clock.rate_hz or 1.0)):
        return _command_files(source, folder, pairs, robot, servos)
    if guess is None:
        measurements, pair_signals = in_two_files(logs, form)
        guess = guess_log(pair_signals, clock.rate_hz or 1.0)
        if guess is None:
            code, text = _channel_problem([signal for signal, _ in signals], shapes)
            raise DataError(code, "; ".join(filter(None, (text, bad_cell))), first)
        source = replace(source, measurements=measurements, signals=pair_signals, shapes={})
    guess = replace(guess, is_motion=guess.is_motion and clock.rate_hz is not None)  # a speed needs a rate
    guess = guess if robot is None and not guess.is_motion else guess.with_separate_motions()
    frame = ""
    if robot is not None and guess.is_impact_test and not robot.driven[0].slides:
        frame = robot.frames[-1].name if robot.frames else "tool"
        robot = None
    positions = {} if guess.is_motion and robot is None else positions_of(source.measurements, form, guess.motions)
    guess = guess if robot is None else assign_joints(robot, guess, positions)
    unused = list(_unused(guess, [signal for signal, _ in source.signals], source.shapes, clock))
    unused += [f"# Torque sensors are not used: {one_line(guess.sensor_doubt)}"] if guess.sensor_doubt else []
    unused += [f"# First cell without a number: {one_line(bad_cell.partition('. ')[0])}"] if bad_cell else []
    if guess.is_motion:
        _columns([measurement[0] for measurement in source.measurements], form, guess, False)
        paths = [relative_paths(measurement, folder) for measurement in source.measurements]
        content = [*head_lines("friction", first), *_study_lines(guess, robot, clock), text, *_files(paths), *unused]
        inertias = [(joint.motion.slides, joint.relation.inertia) for joint in guess.joints]
        return {"study.yml": join_lines(content), "robot.yml": join_lines(_robot(inertias, "the torque"))}
    lines = _torque_study_lines(source, folder, guess, robot, frame, positions)
    kind = "responses" if robot is None else "elasticity"
    return {"study.yml": join_lines([*head_lines(kind, first), *lines, *unused])}


def _torque_study_lines(
    source: _Logs, folder: Path, guess: LogGuess, robot: Robot | None, frame: str, positions: Positions
) -> Iterator[str]:
    """Yield the lines of a study of responses to torques or forces, from the key `experiment` on."""
    driving, logs = {joint.torque.key for joint in guess.joints}, [files[0] for files in source.measurements]
    period = _period(np.stack([x for g, x in source.signals if g.key in driving], axis=1))
    runs = runs_by_name(logs)
    names, configurations = _configurations(len(logs), guess.motions, robot, positions, [run[0] for run in runs])
    is_structure = robot is None and not frame and len(guess.joints) == 1 and not runs
    hits = hit_runs(logs, source.form, guess) if guess.is_impact_test and is_structure and len(logs) > 1 else []
    yield from _study_lines(
        guess, robot, source.clock, configurations, period, frame, _columns(logs, source.form, guess, bool(hits))
    )
    yield source.text
    paths = [relative_paths(measurement, folder) for measurement in source.measurements]
    yield from _files(paths, names, hits or [Run({}, *run[1:]) for run in runs])
    if hits and not is_universal_file(logs[0]):
        yield "# modal: {geometry: {points: {p1: [0, 0, 0]}, motion: {p1: [p1, z]}}} # to animate the shapes"
    elif guess.is_impact_test and len(logs) > 1 and not hits:
        location = guess.joints[0].torque.place
        yield f"      # hit at another point: {{..., at: {{{location}: point 2}}, experiment: 1}}"
    yield from _FIT if robot is not None else ()
    if "none" in period[0] or len(guess.joints) > 1:  # means of periods need as many experiments as inputs
        yield "estimator: {method: auto} # selects a method that fits logs without a period, or fewer logs than inputs"


def _channel_problem(signals: Sequence[ChannelGuess], shapes: Mapping[str, tuple[int, ...]]) -> tuple[str, str]:
    """Return code and message for a log without an input and its motion."""
    longest = max(map(max, shapes.values()), default=0)
    if 0 < longest <= MIN_SAMPLES:
        text = f"its number of samples is {longest}; more than {MIN_SAMPLES} are needed. Export the whole measurement"
        return "records/values", text
    lengths = {max(shape): name for name, shape in reversed([*shapes.items()]) if guess_by_name(name, None).quantity}
    if len(lengths) > 1:
        lengths_text = ", ".join(f"{name} {n}" for n, name in lengths.items())
        text = f"its signals differ in their numbers of samples ({lengths_text}). Export them with one clock"
        return "records/clock", text
    counts = Counter((signal.name, signal.quantity or "unknown") for signal in signals)
    varying = ", ".join(f"{n} {pair[0]} ({pair[1]})" for pair, n in counts.most_common(8)) or "none"
    if any(re.match("psd", signal.name.lower()) for signal in signals):
        reason = "power spectra have no phase and no input. Give --from the time histories of force and accelerations"
    elif any(re.search(r"putData\{\d", signal.name) for signal in signals):
        reason = "an iddata object of several experiments. Save each one, getexp(data, k), in a file of its own"
    elif signals and {signal.quantity for signal in signals} == {"acceleration"}:
        reason = "accelerations without an input; modes need both. Record the force of a hammer or shaker with the same"
        reason += " clock, and name both files after --from"
    else:
        reason = "no input and output recognised: neither a torque (force) with a motion, nor a command for each"
        reason += " position. Name channels tau_1, q_1, cmd_1, ..., or list the second file under `also` in"
        reason += " experiment.recorded.files"
    others = ", ".join(name for name in shapes if name not in {signal.name for signal in signals} and not is_time(name))
    varying += f"; constant or empty: {others}" if others else ""
    return "records/channels", f"{reason}. Varying channels: {varying}"


def _columns(logs: Sequence[Path], form: TextFormatSpec, guess: LogGuess, may_differ: bool) -> dict[str, int]:
    """Return the column of each signal of the first log if the logs have different headings, else an empty dictionary.

    may_differ: accept different headings.  Raises DataError for a log without one of the channels.
    """
    channels = [channel for joint in guess.joints for channel in (joint.torque, joint.motion)]
    channels += () if guess.is_motion else guess.other_outputs
    names = {channel.name for channel in channels if channel.file == 1}
    first, *other_heads = (headings_of(path, form) for path in logs)
    for path, row in zip(logs[1:], other_heads, strict=True):
        if (missing := names - {*row}) and not (may_differ and len(row) == len(first)):
            problem = f"channel {min(missing)} of {logs[0]} is missing. Rename the column, or write one study per log"
            raise DataError("records/channels", problem, path)
    return {} if all(names <= {*row} for row in other_heads) else {name: i for i, name in enumerate(first, start=1)}


def _controller(path: Path, n_u: int) -> FloatArray | None:
    """Return gains kp and kd (2, n_u) of a log; None unless both exist and are positive."""
    with open_log(path, guess_format(path)) as log:
        gains = [values for name in GAINS if (values := read_gains(log, name, n_u)) is not None]
    is_usable = len(gains) == len(GAINS) and bool(np.all((np.array(gains) > 0) & np.isfinite(gains)))
    return np.array(gains) if is_usable else None


def _log_difference(
    path: Path, first: Path, clock: Clock, pairs: Sequence[tuple[ChannelGuess, ChannelGuess]], gains: FloatArray | None
) -> str:
    """Describe how a log differs from the first log in channels, rate or controller gains; empty if it does not."""
    form = guess_format(path)
    with open_log(path, form) as log:
        rate_hz, signals = find_clock(log).rate_hz or math.nan, read_signals(log, MAX_SAMPLES)
    if {g.key for pair in guess_commands(signals, rate_hz) for g in pair} != {g.key for pair in pairs for g in pair}:
        return f"its commands and positions are other channels than in {first}"
    if not abs(rate_hz / (clock.rate_hz or math.nan) - 1) < _SAME_RATE:
        return f"its rate is {rate_hz:.6g} Hz, but {clock.rate_hz:.6g} Hz in {first}; a study has one rate"
    other_gains = _controller(path, len(pairs))
    if gains is None or other_gains is None or np.array_equal(gains, other_gains):
        return ""
    numbers = ["; ".join(", ".join(f"{x:.6g}" for x in row) for row in gain_rows) for gain_rows in (other_gains, gains)]
    return f"kp; kd are {numbers[0]}, but {numbers[1]} in {first}; a study has one controller"


def _command_files(
    source: _Logs, folder: Path, pairs: Sequence[tuple[ChannelGuess, ChannelGuess]], robot: Robot | None, servos: Servos
) -> dict[str, str]:
    """Draft the files of a study of logs with commands and positions (pairs of channels) but without torques.

    The study is of elasticity if the robot has elastic gears and the commands are periodic, else of friction.
    """
    logs, clock = [files[0] for files in source.measurements], source.clock
    period, commands = list[str](), {reference.key for _, reference in pairs}
    if robot is not None and robot.flexible:
        period = _period(np.stack([x for g, x in source.signals if g.key in commands], axis=1))
    names = robot.driven_names if robot is not None else [str(i + 1) for i in range(len(pairs))]
    order, by_order = order_of_names(names, [y for y, _ in pairs])
    pairs = [(replace(pairs[i][0], why=pairs[i][0].why + by_order), pairs[i][1]) for i in order]
    if robot is not None:
        joints = zip(robot.driven, pairs, strict=True)
        pairs = [(at_joint(joint, y), at_joint(joint, reference)) for joint, (y, reference) in joints]
    if clock.rate_hz is None:
        problem = "the log has no time stamps, to which inertia and delay refer. Add a channel time in s, or rate_hz"
        raise DataError("records/clock", problem, logs[0])
    gains = _controller(logs[0], len(pairs))
    for path in logs[1:]:
        if difference := _log_difference(path, logs[0], clock, pairs, gains):
            raise DataError("records/channels", f"{difference}. Write a study for each", path)
    why = "kp / kd and kd of the log"
    if gains is None and all(name in servos for name in names):
        why = "guessed: kp / kd and kd of the servos in the MJCF file; a servo without kd has kd = kp * 1e-6 s"
        gains = np.array([(kp, kd or 1e-6 * kp) for kp, kd in (servos[name] for name in names)]).T
    elif gains is None:
        why, gains = "guessed: enter the gains of the joint controller, link side", np.ones((2, len(pairs)))
    kp, kd = gains
    numbers = [", ".join(f"{x:.6g}" for x in values) for values in (kp / kd, kd)]
    paths = [[path] for path in relative_paths(logs, folder)]
    files, last_lines = _files(paths), list[str]()
    if robot is not None and period and "none" not in period[0]:
        runs, motions = runs_by_name(logs), [y for y, _ in pairs]
        positions = positions_of(source.measurements, source.form, motions)
        states, configurations = _configurations(len(logs), motions, robot, positions, [run[0] for run in runs])
        files = _files(paths, states, [Run({}, *run[1:]) for run in runs])
        lines = [*head_lines("elasticity", logs[0]), "robot: robot.yml", "experiment:", *configurations]
        delay = "# The delay of the commands is identified, too, unless stated: delay_r: {start: 5 ms, fixed: true}"
        method = "estimator: {method: auto} # one that needs fewer logs than inputs"
        last_lines = [delay, *_FIT, *[method] * (len(names) > 1)]
    else:
        lines, period = list(head_lines("friction", logs[0])), []
        lines += [
            "robot: robot.yml # guessed: geometry and ratios are not in the logs",
            "friction: {} # inertia, friction and command delay from commands and positions, without torque",
            "experiment:",
        ]
    lines += ["  recorded:", f"    rate_hz: {clock.rate_hz:.6g} # guessed: {clock.why}", *_time_lines(clock), *period]
    lines.append("    channels:")
    for name, (y, reference) in zip(names, pairs, strict=True):
        lines += [channel_line("y", f"motor {name}", y), channel_line("reference", f"motor {name}", reference)]
    lines += [f"    controller: {{position_gain: [{numbers[0]}], velocity_gain: [{numbers[1]}]}} # {why}", source.text]
    content = {"study.yml": join_lines([*lines, *files, *last_lines])}
    inertias = [(y.slides, x) for (y, _), x in zip(pairs, kd**2 / kp / 4, strict=True)]
    return content if robot is not None else content | {"robot.yml": join_lines(_robot(inertias, "critical damping"))}


def _time_lines(clock: Clock) -> list[str]:
    """Return the line that names the time channel of a log with gaps or uneven samples; none for an even clock."""
    return [] if clock.is_even else [f"    time: {quote(clock.name)} # time channel; samples are resampled to rate_hz"]


def _unused(
    guess: LogGuess, signals: Sequence[ChannelGuess], shapes: Mapping[str, tuple[int, ...]], clock: Clock
) -> Iterator[str]:
    """Yield a comment with the unused columns of a log for each reason."""
    channels = [channel for joint in guess.joints for channel in (joint.torque, joint.motion, joint.sensor) if channel]
    channels += [*guess.references, *(() if guess.is_motion else guess.other_outputs)]
    used_keys, reasons = {channel.key for channel in channels}, dict[str, list[str]]()
    signal_names = {clock.name, *(signal.name for signal in signals)}
    if unused_names := [one_line(name) for name in shapes if name not in signal_names]:
        reasons["times, or no numbers that change"] = unused_names
    for signal in [signal for signal in signals if signal.key not in used_keys]:
        name = f"{signal.name} column {signal.column}".removesuffix(" column None")
        reasons.setdefault(f"{signal.quantity or 'unknown quantity'}: {signal.why}", []).append(one_line(name))
    yield from (f"# Not used ({one_line(reason)}): {', '.join(names)}" for reason, names in reasons.items())


def _configurations(
    n: int, motions: Sequence[ChannelGuess], robot: Robot | None, positions: Positions, by_name: list[str]
) -> tuple[list[str], list[str]]:
    """Return the configuration of each of n logs, by file names or joint positions, and their lines in a study."""
    no_position = np.zeros((n, 4))
    moments = np.array([motion.to_si * positions.get(motion.key, no_position) for motion in motions])
    means, scatter = moments[:, :, 2].T, np.abs(moments[:, :, 3]).max(axis=0)
    states = [by_name.index(name) for name in by_name]
    for mean, by in zip(means[len(states) :], scatter[len(states) :], strict=True):
        at_state = (k for k in states if np.all(np.abs(mean - means[k]) < max(MIN_TURN, 5 * by)))
        states.append(next(at_state, len(states)))  # the first log with equal angles
    firsts = list(dict.fromkeys(states))
    names = by_name or ([f"state_{firsts.index(k) + 1}" for k in states] if len(firsts) > 1 else ["bench"] * n)
    why, angles = "the joints stand at other angles", dict.fromkeys(firsts, "")
    if robot is not None:
        why = "the means of the positions, or 0 where there are none"
        angles = {first: ", ".join(f"{x:.5g}" for x in means[first, : robot.n_u]) for first in firsts}
    elif len(firsts) == 1:
        why = "all logs are of one state of the structure"
    lines = (f"    {names[first]}: [{angles[first]}]" for first in firsts)
    return names, [f"  configurations: # guessed: {why}", *lines]


def _study_lines(
    guess: LogGuess, robot: Robot | None, clock: Clock, configurations: Sequence[str] = (),
    period: Sequence[str] = (), frame: str = "", columns: Mapping[str, int] = MappingProxyType({}),
) -> Iterator[str]:  # fmt: skip
    """Yield the lines of a study up to its channels.  frame: that a hammer hits.  columns: channel numbers by name."""
    names = robot.driven_names if robot is not None else []
    if guess.is_motion and robot is None:
        names = [str(i + 1) for i in range(len(guess.joints))]
        yield "robot: robot.yml # guessed: geometry, ratios and inertias are not in the logs"
    elif robot is not None:
        yield "robot: robot.yml"
    elif frame:
        yield "# One study per hit direction, the x axis of a frame. In the study of the robot, add"
        yield "# tool: {motors: locked, responses: {files: [{path: runs/responses/frf.h5, configuration: bench}]}}"
    else:
        yield "# Stiffness and damping of gears need a robot, too: `elastid new DIR --template recorded` shows how."
    if guess.is_motion:
        yield "# Slow motions do not identify stiffness. For that: `elastid new DIR --template position-reference`."
        yield "friction: {constant_velocity: detect} # guessed: slow motion of joints, whose friction can be found"
    yield from ("experiment:", *configurations, "  recorded:")
    rate = "unknown" if clock.rate_hz is None else f"{clock.rate_hz:.6g}"
    yield f"    rate_hz: {rate} # guessed: {clock.why}"
    yield "    # hold: zero-order # of a torque or current that is the command of the drive and not measured"
    yield from (*_time_lines(clock), *period)
    yield "    channels: # places are names of your choice; of a robot `side: motor` is for signals of the motor's side"
    if not names:
        motions = {joint.motion.place: joint.motion for joint in guess.joints}
        drives = (("u", joint.torque) for joint in guess.joints)
        for role, channel in (*drives, *(("y", motion) for motion in (*motions.values(), *guess.other_outputs))):
            number = columns.get(channel.name)
            spec = channel if number is None else replace(channel, name="", column=number)
            place = hit_place(guess) if role == "u" and not frame and len(guess.joints) == 1 else _place(channel, frame)
            yield channel_line(role, place, spec)
        return
    for name, joint in zip(names, guess.joints, strict=True):
        yield channel_line("u", f"motor {name}", joint.torque, "force" if joint.motion.slides else "torque")
        yield channel_line("y", f"motor {name}", joint.motion)
        if joint.sensor and not guess.sensor_doubt:
            line = channel_line("d", f"motor {name}", joint.sensor)
            comment = "    # for k and d: use this channel with role u and without sign, and delete the motor torque:"
            yield from (line,) if guess.is_motion else (comment, line.replace("- ", "# ", 1))
        for reference in (g for g in guess.references if g.joint_label == joint.motion.joint_label):
            as_motion = replace(reference, unit=joint.motion.unit, ratio=joint.motion.ratio)
            yield channel_line("reference", f"motor {name}", as_motion)
    for channel in () if guess.is_motion else guess.other_outputs:
        hint = f"where it belongs to a joint or a frame, {{role: y, at: joint {names[0]}, ...}}"
        yield f"      # {one_line(channel.name)}: {hint}"


def _place(channel: ChannelGuess, frame: str) -> str:
    """Return the location of a channel; at a frame with the axis in the channel's name, else x."""
    axes = re.findall(r"(?<![a-z])[xyz](?![a-z])", channel.name.lower())
    kind = "force" if channel.quantity == "force" else "accelerometer"
    return f"{kind} {frame} {(*axes, 'x')[0]}" if frame else channel.place


def _period(drives: FloatArray) -> list[str]:
    """Return the lines on the period of the drives (n, n_u)."""
    best, n = find_period(drives), len(drives)
    if best.best_samples:
        # A period within a tenth of a sample of a whole number: generator and log have one clock.
        N = round(best.best_samples)
        samples = N if abs(best.best_samples - N) < 0.1 else best.best_samples
        why = f"the drives repeat (correlation {best.best_correlation:.3f})"
        return [f"    period_samples: {samples:.8g} # guessed: {why}"]
    if n % 2 == 0 and repetition(drives, n // 2, sign=-1).matches_stated_period:
        why = "one period, since its second half is minus the first"
        return [f"    period_samples: {n} # guessed: {why}", "    half_wave: true"]
    return ["    period: none # guessed: the drives do not repeat"]


def _files(paths: Sequence[Sequence[str]], states: Sequence[str] = (), runs: Sequence[Run] = ()) -> Iterator[str]:
    """Yield the lines of the measurements: paths, configurations (none in a friction study), and runs if known."""
    why = " # guessed: each of an excitation of its own; one realisation for further periods of the same"
    why = " # guessed by the names of the files" if runs else why
    if any(run.at for run in runs):
        why = " # at: locations of hammer and sensors, guessed from headings, file names or responses"
    yield "    files:" + (why if states and len(paths) > 1 else "")
    for i, (path, *also) in enumerate(paths):
        keys: dict[str, object] = {"also": f"[{', '.join(map(quote, also))}]" if also else None}
        run = runs[i] if runs else Run({}, i, 0)
        if states:
            keys |= {"configuration": states[i], "realisation": run.realisation}
            keys |= {"experiment": run.experiment} if runs else {}
            keys |= {"at": mapping({quote(k): quote(v) for k, v in run.at.items()})} if run.at else {}
        yield file_line(path, **keys)


def _robot(joints: Iterable[tuple[bool, float]], source: str) -> Iterator[str]:
    """Yield the lines of a robot model of single joints with (slides, inertia)."""
    yield "# Each joint is alone on the base; give geometry, ratios and inertias."
    yield "name: robot of the logs"
    yield "gravity: [0, 0, -9.81] # guessed: it acts on joints about y; about z it does not"
    yield "bodies:"
    for i, (slides, inertia) in enumerate(joints, start=1):
        half = 0.5 * max(inertia, 1e-6)
        yield from (f"  - name: body {i}", "    parent: base", "    joints:")
        motion = "motion: translation, axis: x" if slides else "axis: y"
        yield f"      - {{name: {i}, {motion}, motor: {{inertia: {half:.3g}, ratio: 1}}}} # guessed"
        yield from ("    mass: 1", "    center_of_mass: [0.1, 0, 0]")
        yield f"    inertia: {half:.3g} # guessed: half of the inertia by {source}"
