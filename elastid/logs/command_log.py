"""Logs of commanded and measured positions, with the gains of the joint controllers where the log has them.

Users of simulators log the command, the encoder and the controller's gains, and no torque: a PD controller in each
drive, u = kp (command - position) + kd (command velocity - velocity), link side.
"""

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np

from elastid.base.arrays import FloatArray, frozen_value
from elastid.base.errors import DataError, StudyError
from elastid.experiment.specs.channels import ChannelSpec
from elastid.experiment.specs.logs import RecordedSpec
from elastid.logs.channel_guess import guess_commands
from elastid.logs.channel_names import ChannelGuess
from elastid.logs.clocks import MAX_SAMPLES, find_clock
from elastid.logs.files.formats import open_log, read_channels
from elastid.logs.files.log import Log
from elastid.logs.files.text_format import guess_format
from elastid.logs.log_signals import read_signals
from elastid.logs.repair import LogReport, interpolate_linearly
from elastid.logs.units_and_sides import link_side, on_one_side, to_joints
from elastid.robot import Robot
from elastid.simulation.controller import loop_of


@frozen_value
class CommandLog:
    """Commands and positions (n, n_u) of all driven joints at rate_hz, rad (m for sliding joints), link side.

    velocity: commanded velocities, 0 if the log has none.  kp, kd (n_u,): gains in the log, or None.  clock_hz: rate by
    the log's own clock, or None.
    """

    name: str
    rate_hz: float
    command: FloatArray
    velocity: FloatArray
    position: FloatArray
    kp: FloatArray | None = None
    kd: FloatArray | None = None
    clock_hz: float | None = None


def _find_signals(
    signals: Sequence[tuple[ChannelGuess, FloatArray]], quantity: str, is_command: bool, joints: Sequence[str]
) -> FloatArray | None:
    """Find signals (n, n_u) of a quantity in SI, in the order of joints; None if the log has another number."""
    families: dict[str, dict[str, FloatArray]] = {}
    for guess, x in signals:
        # A command without a quantity in its name is a position.
        kind = guess.quantity or ("position" if guess.rank < 0 else "")
        if kind == quantity and (guess.rank < 0) == is_command:
            families.setdefault(guess.family, {})[guess.joint_label] = guess.to_si * x
    for family in families.values():
        match = [family[joint] for joint in joints if joint in family]
        columns = [*family.values()] if len(match) < len(joints) else match  # else in the order of the log
        if len(columns) == len(joints):
            return np.stack(columns, axis=1)
    return None


def read_command_log(path: Path, joints: Sequence[str], rate_hz: float | None = None) -> CommandLog:
    """Read commands, positions and gains of the driven joints of a robot from a log, by the names of its channels.

    rate_hz: in place of the rate of the log's clock.  DataError if the log has no command and position of each joint,
    or no rate.
    """
    form = guess_format(path)
    with open_log(path, form) as log:
        clock, members = find_clock(log), read_signals(log, MAX_SAMPLES, with_constant=True)
        kp, kd = (read_gains(log, name, len(joints)) for name in ("kp", "kd"))
    members = [(guess, x) for guess, x in members if guess.name != clock.name]
    with_unit = {g.key: g for pair in guess_commands(members, rate_hz or clock.rate_hz or 1.0) for g in pair}
    signals = [(with_unit.get(guess.key, guess), x) for guess, x in members]
    command, position = (_find_signals(signals, "position", is_command, joints) for is_command in (True, False))
    if command is None or position is None:
        names = ", ".join(dict.fromkeys(guess.name for guess, _ in signals)) or "none"
        text = f"each of {len(joints)} joints needs one commanded and one measured position. Name them command and"
        advice = f"position, one column per joint ({', '.join(joints)}), or give --study. Channels: {names}"
        raise DataError("records/channels", f"{text} {advice}", path)
    rate_hz = rate_hz or clock.rate_hz
    if rate_hz is None:
        raise DataError("records/clock", "the log has no time stamps. Give --rate", path)
    velocity = _find_signals(signals, "velocity", True, joints)
    velocity = np.zeros_like(command) if velocity is None else velocity
    return CommandLog(path.stem, rate_hz, command, velocity, position, kp, kd, clock.rate_hz)


def read_study_log(path: Path, recorded: RecordedSpec, robot: Robot, rate_hz: float | None = None) -> CommandLog:
    """Read commands and positions from a log by the channels of a study, in SI on the link side.

    Velocities are commanded as the controller of the study feeds them forward; its gains are those of the log.
    rate_hz: in place of the study's.  StudyError if a joint has no channel of role reference, or y of its position.
    """
    columns = {}
    for role in ("reference", "y"):
        channels = [_channel(recorded, role, joint) for joint in robot.driven_names]
        log = LogReport(str(path), tuple(channel.full_name for channel in channels))
        values = read_channels(path, channels, recorded.text)
        signals = (link_side(channel, x, robot, log) for channel, x in zip(channels, values.T, strict=True))
        link_side_values = np.stack(list(map(interpolate_linearly, signals)), axis=1)
        columns[role], _ = on_one_side(channels, link_side_values, to_joints(channels, robot))
    rate_hz, controller = rate_hz or recorded.known_rate_hz, recorded.controller
    forward = 0.0 if controller is None else controller.velocity_feedforward
    velocity = forward * rate_hz * np.gradient(columns["reference"], axis=0)
    loop = None if controller is None else loop_of(controller, len(robot.driven_names))
    clock_hz = None if recorded.rate_hz == "unknown" else recorded.known_rate_hz
    kp, kd = (None, None) if loop is None else (loop.kp, loop.kd)
    return CommandLog(path.stem, rate_hz, columns["reference"], velocity, columns["y"], kp, kd, clock_hz)


def _channel(recorded: RecordedSpec, role: str, joint: str) -> ChannelSpec:
    """Return the channel of a command, or of the position nearest to the motor of a joint."""
    for location in (f"motor {joint}", f"joint {joint}"):
        for channel in recorded.channels:
            if (channel.role, channel.at, channel.quantity) == (role, location, "position"):
                return channel
    text = f"no channel of role {role}, quantity position at motor {joint}. Add it to experiment.recorded.channels"
    raise StudyError("study/recorded", text, "--study")


def read_gains(log: Log, name: str, n_u: int) -> FloatArray | None:
    """Read an array of controller gains (n_u,), N*m/rad or N*m*s/rad, link side; one number counts for all joints.

    None if the log has no array of that name (in any case of letters), one of another size, or gains that change.
    """
    for stored, array in log.arrays.items():
        if stored.rpartition("/")[2].lower() == name and array.dtype.kind in "fiu":
            values = np.squeeze(np.asarray(array, np.float64))
            is_series = values.ndim and values.shape != (n_u,) and bool(np.all(values == values[:1]))
            with suppress(ValueError):
                return np.array(np.broadcast_to(values[0] if is_series else values, n_u))
    return None
