r"""Images of the steps of a reference in a log at the rate of the references.

References every T reach the controller through an interpolator. Its steps have images at f + m / T, and a log at the
rate 1 / T folds them onto f:

.. math:: U_{log} = U + \sum_{m \ne 0} L_m S_m C_{ff} F_r R, \qquad S_m = \frac{1}{1 + C_{fb} / (J s_m^2)},
          \qquad s_m = 2 \pi j \Big(f + \frac{m}{T}\Big)

since only the inertia J of a motor follows so fast. L_m: logged channel at the image over that at f; a channel that is
late by tau turns an image by exp(-2 pi j m tau / T) more. Images are coherent with the excitation: neither noise nor
distortion shows them. Logged references and positions give the commanded torques C_ff F_r R - C_fb Q; the logged ones
then show tau, the feed-forward and the scale of K_v. References R that are not logged follow from torques and
positions, whatever the friction. An error of K_v then cancels in the part of the torques:

.. math:: R = \frac{U_{log} + C_{fb} Q}{C_{ff} F_r + \sum_{m \ne 0} L_m S_m C_{ff} F_r}
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.experiment.specs.channels import ChannelSpec, Places
from elastid.experiment.specs.recorded import CascadeSpec, RecordedSpec
from elastid.recorded.repair import Log
from elastid.recorded.repair.time_stamps import MAX_CLOCK_ERROR
from elastid.response import STEP_IMAGES
from elastid.robot import Robot, low_pass_response
from elastid.simulation.controller import loop_of, sampled_responses

# Lowest frequency over the rate, below which friction dominates; the least part of the power that references explain;
# smallest amplitude of a reference over its largest, of the lines that decide.
_LOWEST, _MIN_EXPLAINED, _SMALLEST = 0.05, 0.25, 0.03
# Of current loop and torque filter, half of it beside low_pass_hz: a sample at a step of the command shows the torque
# before it.
_TORQUE_LAG_S = 3e-4
_REFERENCE_CYCLES = (-2, -1, 0, 1, 2)  # that a reference is logged before or after it acts
_REGULARISATION = 0.01  # of |C_ff F_r|^2: at half the rate images cancel it, and no torque shows its reference


def without_step_images(
    signals: FloatArray,
    channels: Sequence[ChannelSpec],
    roles: dict[str, list[int]],
    recorded: RecordedSpec,
    rate_hz: float,
    robot: Places,
    log: Log,
) -> FloatArray:
    """Signals (n, c) without images of their references, whose size is reported."""
    controller, u, n = recorded.controller, roles["u"], len(signals)
    # From four samples in a cycle on, images are below a sixteenth.
    if not isinstance(robot, Robot) or controller is None or recorded.has_commands_alone:
        return signals
    if not 0 < rate_hz * controller.cycle < 4:
        return signals
    freq_hz = np.fft.rfftfreq(n, 1 / rate_hz).astype(np.float64)
    U = np.fft.rfft(signals[:, u], axis=0)
    stated = controller.velocity_feedforward
    assert controller.reference is not None
    usual = _with_feed_forward(controller, stated or controller.reference.velocity_feedforward)
    images, forward = _per_reference(usual, freq_hz, robot, channels, u, rate_hz)
    power = np.cumsum(np.sum(np.abs(U[1:]) ** 2, axis=1))
    edge = 1 + int(np.argmax(power >= 0.99 * power[-1]))
    seen = 1 / (1 + images[edge] / forward[edge])
    gain, shift_s = np.max(np.abs(np.abs(seen) - 1)), np.max(np.abs(np.angle(seen))) / (2 * np.pi * freq_hz[edge])
    text = f"{100 * gain:.2g} % and {1e3 * shift_s:.2g} ms at {freq_hz[edge]:.3g} Hz"
    text = f"aliases of the reference's steps change the response by {text}"
    is_at_cycle = abs(rate_hz * controller.cycle - 1) <= MAX_CLOCK_ERROR
    positions = {channels[i].at: i for i in roles["y"] if channels[i].quantity == "position"}
    is_slow = controller.cycle > 2 * np.pi * _TORQUE_LAG_S  # else the unknown lag dominates the images
    f, Q = np.maximum(freq_hz, freq_hz[1] / 2), np.zeros(0, complex)
    if has_positions := all(channels[i].at in positions for i in u):
        q = signals[:, [positions[channels[i].at] for i in u]]
        Q = np.fft.rfft(q - np.linspace(q[0], q[-1], n), axis=0)  # without the jump from the end to the start
    if is_at_cycle and is_slow and not roles["r"] and has_positions:
        C_fb, C_ff = _controlled(usual, f, robot, len(u))
        per_reference = C_ff + images
        R = (U + C_fb * Q) * per_reference.conj() / (np.abs(per_reference) ** 2 + _REGULARISATION * np.abs(C_ff) ** 2)
        return _subtracted(signals, u, images * R, text, log)
    R = np.fft.rfft(signals[:, roles["r"]], axis=0)
    if is_at_cycle and R.shape == U.shape:
        above = freq_hz > _LOWEST * rate_hz
        lines = np.flatnonzero(above & (np.abs(R).max(axis=1) > _SMALLEST * np.abs(R[above]).max()))
        filters, matches = _low_passes(channels, u, f[lines]), []
        for share in dict.fromkeys((stated, 0.0, 1.0)):
            cascade = _with_feed_forward(controller, share)
            numbers, each = zip(*_logged(cascade, f[lines], robot, channels, u, rate_hz), strict=True)
            torques = np.stack(each) * R[lines] / filters
            turns = -2j * np.pi * (f[lines] + np.array(numbers)[:, None] * rate_hz)
            C_fb, C_ff = _controlled(cascade, f[lines], robot, len(u))
            for cycles in _REFERENCE_CYCLES if has_positions else (0,):
                turn = np.exp(-2j * np.pi * f[lines, None] * controller.cycle * cycles)
                commanded = torques * turn
                if has_positions:  # whatever the robot
                    commanded[numbers.index(0)] = C_ff * R[lines] * turn - C_fb * Q[lines]
                matches.append((_lateness(commanded, turns, U[lines], controller.cycle), share, cycles))
        (explained, tau, scale), share, cycles = max(matches, key=lambda match: match[0][0])
        if explained > _MIN_EXPLAINED:
            cascade = _with_feed_forward(controller, share)
            images, _ = _per_reference(cascade, freq_hz, robot, channels, u, rate_hz, tau)
            turn = np.exp(-2j * np.pi * freq_hz[:, None] * controller.cycle * cycles)
            return _subtracted(signals, u, images * R * turn * scale, text, log)
        text = f"{text}. The logged references and the stated controller explain {100 * explained:.0f} % of the torques"
    cure = "log four times faster, filter the references, or excite up to a fifth of their rate"
    log.note(STEP_IMAGES, f"{text}. Log the references, or {cure}")
    return signals


def _subtracted(signals: FloatArray, u: Sequence[int], images: ComplexArray, text: str, log: Log) -> FloatArray:
    log.note(STEP_IMAGES, f"{text}; subtracted", "information")
    signals, images = signals.copy(), np.concatenate([0 * images[:1], images[1:]])
    signals[:, u] -= np.fft.irfft(images, len(signals), axis=0)
    return signals


def _with_feed_forward(controller: CascadeSpec, share: float) -> CascadeSpec:
    assert controller.reference is not None
    return replace(controller, reference=replace(controller.reference, velocity_feedforward=share))


def _lateness(
    torques: ComplexArray, turns: ComplexArray, U: ComplexArray, cycle: float
) -> tuple[float, float, FloatArray]:
    """Part of the power of the torques U (F, n_u) that is explained, their delay in s, and the scale (n_u,) of K_v.

    torques (m, F, n_u): at the line and at its images; turns (m, F): -j omega of each.  Delays of -2 to 4 cycles.
    """
    from scipy.optimize import minimize_scalar  # 0.05 s, which a study without images need not load

    def modelled(tau: float) -> tuple[ComplexArray, FloatArray]:
        M = np.sum(torques * np.exp(turns * tau)[..., None], axis=0)
        scale = np.sum((M.conj() * U).real, axis=0) / np.maximum(np.sum(np.abs(M) ** 2, axis=0), 1e-300)
        return M, np.maximum(scale, 0.0)

    def unexplained(tau: float) -> float:
        M, scale = modelled(tau)
        return float(np.sum(np.abs(U - M * scale) ** 2) / np.sum(np.abs(U) ** 2))

    grid = cycle * np.arange(-2, 4, 0.1)
    best = grid[int(np.argmin([unexplained(tau) for tau in grid]))]
    end = minimize_scalar(unexplained, bounds=(best - 0.1 * cycle, best + 0.1 * cycle), method="bounded")
    return 1 - float(end.fun), float(end.x), modelled(end.x)[1]


def _per_reference(
    controller: CascadeSpec, freq_hz: FloatArray, robot: Robot, channels: Sequence[ChannelSpec], u: Sequence[int],
    rate_hz: float, tau: float = 0.0,
) -> tuple[ComplexArray, ComplexArray]:  # fmt: skip
    """Torques (F, n_u) of all images that a log late by tau folds, and of the line, without the channel's filter."""
    f = np.maximum(freq_hz, freq_hz[1] / 2)
    filters = _low_passes(channels, u, f)
    images = line = 0 * filters
    for m, torques in _logged(controller, f, robot, channels, u, rate_hz):
        late = torques * np.exp(-2j * np.pi * (f[:, None] + m * rate_hz) * tau) / filters
        images, line = (images + late, line) if m else (images, late)
    return images, line


def _logged(
    controller: CascadeSpec, f: FloatArray, robot: Robot, channels: Sequence[ChannelSpec], u: Sequence[int],
    rate_hz: float,
) -> Iterator[tuple[int, ComplexArray]]:  # fmt: skip
    """Logged torques (F, n_u) of a reference at f and at each image, at f + m times the rate of the log, with m."""
    motors = [robot.driven[robot.motor_locations.index(channels[i].at)].motor for i in u]
    J = np.array([0.0 if motor is None else motor.inertia * motor.ratio**2 for motor in motors])

    half = round(controller.tick_hz / rate_hz) // 2
    for m in range(-half, half + 1):
        f_m = f + m * rate_hz
        C_fb, C_ff = _controlled(controller, f_m, robot, len(u))
        S = 1 / (1 - C_fb / (J * (2 * np.pi * f_m[:, None]) ** 2))
        yield m, np.asarray(S * C_ff * _low_passes(channels, u, f_m))


def _controlled(controller: CascadeSpec, f: FloatArray, robot: Robot, n_u: int) -> tuple[ComplexArray, ComplexArray]:
    """C_fb and C_ff F_r (F, n_u) with the lag of the torque loop."""
    loop = loop_of(controller, n_u)
    C_fb, C_ff = sampled_responses(robot.driven_names, loop, controller.spec, f, controller.tick_hz, "position")
    T = _TORQUE_LAG_S / 2 if controller.low_pass_hz else _TORQUE_LAG_S
    lag = low_pass_response((2j * np.pi * f[:, None]).astype(np.complex128), T)
    return C_fb * lag, C_ff * lag


def _low_passes(channels: Sequence[ChannelSpec], u: Sequence[int], f: FloatArray) -> ComplexArray:
    s = (2j * np.pi * f).astype(np.complex128)
    times = [sum(error.low_pass for error in channels[i].errors) for i in u]
    return np.stack([low_pass_response(s, T) for T in times], axis=1)
