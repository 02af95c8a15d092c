"""Channels of a log in SI and on the link side, with the hold of their torques; missing samples stay missing.

value = sign * scale * file value, in unit -> SI, a current times its torque constant -> torque, K and degF -> degC
motor side -> link side:   torque * ratio,   angle, velocity, acceleration / ratio     (ratio may be negative)

Where gears couple motors with several joints, each channel is converted by its own ratio first, then all together:

    tau_a = E^T tau_m',   q_a = E^-1 q_m'        (E: robot.mixing)
"""

import math
from collections.abc import Collection, Iterator, Sequence
from itertools import combinations

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.errors import StudyError, did_you_mean
from elastid.experiment.specs.channels import ChannelSpec, Places, channel_refusal
from elastid.experiment.specs.logs import RecordedSpec
from elastid.logs.repair import MAX_WRONG_FRACTION, LogReport, blocks
from elastid.logs.repair.clock_drift import MIN_DELAY_CORRELATION
from elastid.logs.repair.masks import CHECK_CELLS

UNWRAPPED = "records/unwrapped"
# Covariances contain fourth powers of values: for larger values they come near the largest float64.
MAX_COMPUTABLE = 1e60
# Sine of the angle between two signals without their means, up to which they are one but for single precision.
MAX_DIFFERENCE = 1e-5


def find_channel_errors(channels: Sequence[ChannelSpec], places: Places) -> Iterator[tuple[int, str, str]]:
    """Yield place, key and reason of each channel that is off the robot, in a wrong unit, or given twice."""
    motors, signals = places.motor_locations, set[tuple[str, str, int]]()
    for i, channel in enumerate(channels):
        hint = "" if channel.at in motors else did_you_mean(channel.at, motors)
        if channel.role == "d" and hint:
            yield i, "at", f"'{channel.at}' is no motor; a disturbance (role d) acts at a motor: {hint}"
        elif channel.role in ("r", "u", "reference") and hint:
            yield i, "at", f"no motor or input is called '{channel.at}'; {hint}"
        else:
            try:
                places.check_location(channel.at)
            except StudyError as error:
                yield i, "at", str(error)
        key, refusal = channel_refusal(channel, channels, places)
        if refusal:
            yield i, key, refusal
        try:
            channel.unit_factor(places.slides(channel.at) and channel.side == "link")
        except ValueError as error:
            if key != "unit":
                yield i, "unit", str(error)
        # A signal may be in several files, which it synchronises.
        signal = (channel.role, channel.at, channel.file)
        if signal in signals:
            yield i, "at", f"two channels have role {channel.role} at '{channel.at}'. Omit one"
        signals.add(signal)
        if channel.role == "d" and not hint and ("u", channel.at) not in {(c.role, c.at) for c in channels}:
            yield i, "at", f"d needs a channel of role u at '{channel.at}'. Add that channel"
    places_r, places_u = (sorted({c.at for c in channels if c.role == role}) for role in ("r", "u"))
    if places_r and places_r != places_u:
        text = f"channels with role r are at {', '.join(places_r)}, channels with role u at {', '.join(places_u)}"
        yield [c.role for c in channels].index("r"), "at", f"{text}. List r for every input or for none"


def link_side_factor(channel: ChannelSpec, robot: Places) -> float:
    """Compute the factor from the file's numbers to SI on the link side; StudyError where unit or side are wrong."""
    return _side_factor(channel, robot) * _gear_factor(channel, robot)


def link_side(channel: ChannelSpec, values: FloatArray, robot: Places, log: LogReport) -> FloatArray:
    """Convert a signal (n,) to SI on the link side, an angle unwrapped."""
    factor, turns = _side_factor(channel, robot), 0
    if channel.quantity == "position":
        values, turns = unwrap(values, np.inf if robot.slides(channel.at) else 2 * np.pi / abs(factor))
    if turns:
        log.note(UNWRAPPED, f"{turns} wraps of its counter or revolution were removed from {channel.name_in_file}")
    return (values * factor + channel.offset) * _gear_factor(channel, robot)


def unwrap(values: FloatArray, turn: float) -> tuple[FloatArray, int]:
    """Remove jumps of values (n,) by nearly a turn, or by the 2^k of an integer counter; return also their number."""
    is_finite = np.isfinite(values)
    x = values[is_finite]
    span = float(np.ptp(x)) if x.size else 0.0
    # The shortest counter has 8 bits, and starts again near its ends.
    is_counter = span >= 2**8 - 2**4 and np.all(x == np.round(x))
    steps, whole = np.abs(np.diff(x)), 2.0 ** math.ceil(math.log2(span + 1)) if is_counter else turn
    jumps, small_steps = steps[steps >= whole / 2], steps[steps < whole / 2]
    if not jumps.size or small_steps.max(initial=0.0) > whole / 4 or np.any(np.abs(jumps - whole) > whole / 6):
        return values, 0
    result = values.astype(np.float64)
    result[is_finite] = np.unwrap(x, period=whole)
    return result, jumps.size


def to_joints(channels: Sequence[ChannelSpec], robot: Places) -> FloatArray:
    """Return T (n_c, n_c) from own-ratio channels to joints; raise StudyError if a coupled channel is missing."""
    return _through_couplings(channels, robot, "motor", np.asarray(np.linalg.inv(robot.mixing)))


def to_shafts(channels: Sequence[ChannelSpec], robot: Places) -> FloatArray:
    """Return T (n_c, n_c) from own-ratio channels to shafts; raise StudyError if a coupled channel is missing."""
    return _through_couplings(channels, robot, "link", robot.mixing)


def _through_couplings(channels: Sequence[ChannelSpec], robot: Places, side: str, angle: FloatArray) -> FloatArray:
    """Compute T (n_c, n_c) for channels on one side; angle (n_u, n_u): to the angles on the other side."""
    T, motors = np.eye(len(channels)), list(robot.motor_locations)
    if np.array_equal(angle, np.eye(len(angle))):
        return T
    torque = np.linalg.inv(angle).T
    for row, channel in enumerate(channels):
        if channel.side != side or channel.at not in motors:
            continue
        motor_signals = (angle if channel.is_motion else torque)[motors.index(channel.at)]
        for source in np.flatnonzero(np.abs(motor_signals) > 1e-12):  # smaller elements are rounding
            T[row, _coupled_channel(channels, channel, motors[source])] = motor_signals[source]
    return T


def without_placeholders(signals: FloatArray) -> FloatArray:
    """Return signals (n, c) with NaN for impossible values, in channels with few of them."""
    is_wrong = np.abs(signals) > MAX_COMPUTABLE
    is_rare = is_wrong.mean(axis=0) <= MAX_WRONG_FRACTION if len(signals) else is_wrong.any(axis=0)
    return np.where(is_wrong & is_rare, np.nan, signals) if is_wrong.any() else signals


def check_values(
    channels: Sequence[ChannelSpec], columns: Sequence[FloatArray], log: LogReport, may_rest: Collection[str] = ()
) -> None:
    """Raise DataError for a constant column (n,), some samples NaN; note an input that rests while others move.

    may_rest: further roles of channels that may be constant.
    """
    for i, text in find_value_errors(channels, columns, may_rest):
        raise log.error("records/values", f"{channels[i].full_name} {text}")
    for channel, column in zip(channels, columns, strict=True):
        values = column[np.isfinite(column)]
        if np.ptp(values) == 0 and channel.role in ("u", "r") and channel.role not in may_rest:
            text = f"{channel.full_name} is constant at {values[0]:g} and counts as not excited in this experiment"
            log.note("records/input-not-excited", text)


def find_value_errors(
    channels: Sequence[ChannelSpec], columns: Sequence[FloatArray], may_rest: Collection[str] = ()
) -> Iterator[tuple[int, str]]:
    """Yield index and reason of each implausible column (n,); may_rest: roles that may be constant."""
    if max(map(len, columns)) < 2:
        yield 0, "has one row only, as has its log. Export the whole measurement"
        return
    finite = [column[np.isfinite(column)] for column in columns]
    moving = {channel.role for channel, x in zip(channels, finite, strict=True) if np.any(x != x[:1])}
    # An input may rest while others act.
    resting = ("d", "t", "reference", *may_rest, *(moving - {"y"}))
    for i, (channel, values) in enumerate(zip(channels, finite, strict=True)):
        if values.size == 0:
            yield i, f"contains no finite number. Check its name. {CHECK_CELLS}"
        elif (largest := float(np.max(np.abs(values)))) > MAX_COMPUTABLE or 0 < largest < 1 / MAX_COMPUTABLE:
            yield (i, f"reaches {largest:.3g}, which is implausible. Check name and placeholder for missing values")
        elif np.ptp(values) == 0 and channel.role not in resting:
            yield i, f"is constant at {values[0]:g} over all {len(columns[i])} samples. Check its sensor and its name"


def report_drives(channels: Sequence[ChannelSpec], signals: FloatArray, N: int | None, log: LogReport) -> None:
    """Report torque channels of signals (n, c) that copy a command: the same, inverted, or of another motor.

    N: samples of the period, None without one.
    """
    u = {c.at: i for i, c in enumerate(channels) if c.role == "u"}
    for channel, r in zip(channels, signals.T, strict=True):
        if channel.role != "r":
            continue
        text, torque = f"u at {channel.at}", signals[:, u[channel.at]]
        if np.ptp(r) > 0 and np.array_equal(r, torque):
            text += " equals r to the last bit: the command was logged twice, and u lacks feedback, drive limits and "
            text += "delay. Log the acting torque, or omit the channel of role r without feedback"
            log.note("records/same-signal", text)
        elif (rho := _weighted_correlation(r, torque, N)) <= -MIN_DELAY_CORRELATION:
            text += f" and r have opposite signs (correlation {rho:.2f}). Give the inverted channel sign: -1"
            log.note("records/torque", text)
    C = np.cov(signals, rowvar=False)
    indices = [i for i, c in enumerate(channels) if c.role in ("u", "y") and c.at.startswith("motor ") and C[i, i] > 0]
    for a, b in combinations(indices, 2):
        if channels[a].role == channels[b].role and C[a, b] ** 2 >= (1 - MAX_DIFFERENCE**2) * C[a, a] * C[b, b]:
            text = f"{channels[b].full_name} and {channels[a].full_name} have identical samples, so that one is not the"
            advice = "Check channel and column in the study, and the wiring of the logger"
            log.note("records/same-signal", f"{text} signal of its motor. {advice}")


def _weighted_correlation(r: FloatArray, u: FloatArray, N: int | None) -> float:
    """Return the correlation of r and u (n,), each DFT line weighted by the power of r, not of u.

    Feedback makes u largest at the lines of the largest phase shift.
    """
    if N is None:
        first, second = (np.concatenate([x - x.mean(), np.zeros(len(x))]) for x in (r, u))
    else:
        first, second = (blocks(x, N).mean(axis=0) for x in (r, u))
    R, U = (np.fft.rfft(x)[1:] for x in (first, second))
    power, cross_power = np.abs(R) ** 2, R.conj() * U
    cosine = np.divide(cross_power.real, np.abs(cross_power), out=np.zeros_like(power), where=cross_power != 0)
    return float(power @ cosine / max(power.sum(), 1e-300))


def _side_factor(channel: ChannelSpec, robot: Places) -> float:
    try:
        unit = channel.unit_factor(robot.slides(channel.at) and channel.side == "link")
    except ValueError as error:
        raise StudyError("study/recorded", str(error), channel.full_name) from None
    return channel.sign * channel.scale * unit * (1.0 if channel.torque_constant is None else channel.torque_constant)


def _gear_factor(channel: ChannelSpec, robot: Places) -> float:
    if channel.side == "link":
        return 1.0
    kind, _, joint = channel.at.partition(" ")
    if kind not in ("motor", "joint") or joint not in robot.driven_names:
        text = f"side: motor needs a gear; {channel.at} has no gear. Correct at: {', '.join(robot.motor_locations)}"
        raise StudyError("study/recorded", text, f"channel {channel.name_in_file}")
    ratio = robot.ratio(joint)
    return 1 / ratio if channel.is_motion else ratio


def _coupled_channel(channels: Sequence[ChannelSpec], like: ChannelSpec, motor: str) -> int:
    for i, channel in enumerate(channels):
        same_kind = not like.is_motion or channel.quantity == like.quantity
        if (channel.role, channel.side, channel.at) == (like.role, like.side, motor) and same_kind:
            return i
    text = f"{like.at} is coupled by gears with {motor}, which has no channel with role {like.role} and side:"
    text += (
        f" {like.side}{f' for the {like.quantity}' if like.is_motion else ''}. Log it too, or give the signal on the"
    )
    side = "link" if like.side == "motor" else "motor"
    raise StudyError("study/recorded", f"{text} {side} side", f"channel {like.name_in_file}")


def on_one_side(channels: Sequence[ChannelSpec], signals: FloatArray, T: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Transform signals (n, c) by T of `to_joints` or `to_shafts`, add disturbances to torques; return also these."""
    torques = [i for i, channel in enumerate(channels) if channel.role == "u"]
    signals = signals if np.array_equal(T, np.eye(len(T))) else signals @ T.T
    motors, disturbances = [channels[i].at for i in torques], np.zeros((len(signals), len(torques)))
    for channel, signal in zip(channels, signals.T, strict=True):
        if channel.role == "d" and channel.at in motors:
            disturbances[:, motors.index(channel.at)] += signal
    if disturbances.any():
        signals = signals.copy()
        signals[:, torques] += disturbances
    return signals, disturbances


def hold_samples(recorded: RecordedSpec, channels: Sequence[ChannelSpec], rate_hz: float) -> tuple[float, ...]:
    """Return samples at rate_hz for which each u among the channels is held, in their order; 0 where band-limited.

    A channel with a higher rate of its own, brought to rate_hz, is held for a sample of its own rate.
    """
    default_hz = rate_hz if recorded.rate_hz == "unknown" else recorded.known_rate_hz
    return tuple(
        rate_hz / float(c.rate_hz or default_hz) if (c.hold or recorded.hold) == "zero-order" else 0.0
        for c in channels
        if c.role == "u"
    )
