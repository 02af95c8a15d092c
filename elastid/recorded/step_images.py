r"""Images of the steps of a reference in a log at the rate of the references.

References every T reach the controller through an interpolator. Its steps have images at f + m / T, and a log at the
rate 1 / T folds them onto f:

.. math:: U_{log} = U + \sum_{m \ne 0} L_m S_m C_{ff} F_r R, \qquad S_m = \frac{1}{1 + C_{fb} / (J s_m^2)},
          \qquad s_m = 2 \pi j \Big(f + \frac{m}{T}\Big)

since only the inertia J of a motor follows so fast. L_m: logged channel at the image over that at f. Images are
coherent with the excitation: neither noise nor distortion shows them. References R that are not logged follow from
torques and positions, whatever the friction. An error of K_v then cancels in the part of the torques:

.. math:: R = \frac{U_{log} + C_{fb} Q}{C_{ff} F_r + \sum_{m \ne 0} L_m S_m C_{ff} F_r}
"""

from collections.abc import Sequence

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.experiment.specs.channels import ChannelSpec, Places
from elastid.experiment.specs.recorded import CascadeSpec, RecordedSpec
from elastid.recorded.repair import Log
from elastid.recorded.repair.time_stamps import MAX_CLOCK_ERROR, delay
from elastid.response import STEP_IMAGES
from elastid.robot import Robot, low_pass_response
from elastid.simulation.controller import loop_of, sampled_responses

# Lowest frequency over the rate, below which friction dominates; least correlation of torques with those by inertia.
_LOWEST, _MIN_CORRELATION = 0.05, 0.2
# Of current loop and torque filter, half of it beside low_pass_hz: a sample at a step of the command shows the torque
# before it.
_TORQUE_LAG_S = 3e-4
_REGULARISATION = 0.01  # of |C_ff F_r|^2: at half the rate images cancel it, and no torque shows its reference


def without_step_images(
    signals: FloatArray,
    channels: Sequence[ChannelSpec],
    roles: dict[str, list[int]],
    recorded: RecordedSpec,
    N: int | None,
    rate_hz: float,
    robot: Places,
    log: Log,
) -> FloatArray:
    """Signals (n, c), in periods of N samples if any, without images of their references, whose size is reported."""
    controller, u, n = recorded.controller, roles["u"], len(signals)
    # From four samples in a cycle on, images are below a sixteenth.
    if not isinstance(robot, Robot) or controller is None or recorded.has_commands_alone:
        return signals
    if not 0 < rate_hz * controller.cycle < 4:
        return signals
    freq_hz = np.fft.rfftfreq(n, 1 / rate_hz).astype(np.float64)
    U = np.fft.rfft(signals[:, u], axis=0)
    ratio = round(rate_hz * controller.cycle)
    images, forward, C_fb, C_ff = _per_reference(controller, freq_hz, ratio, robot, channels, u)
    power = np.cumsum(np.sum(np.abs(U[1:]) ** 2, axis=1))
    edge = 1 + int(np.argmax(power >= 0.99 * power[-1]))
    seen = 1 / (1 + images[edge] / forward[edge])
    gain, shift_s = np.max(np.abs(np.abs(seen) - 1)), np.max(np.abs(np.angle(seen))) / (2 * np.pi * freq_hz[edge])
    text = f"{100 * gain:.2g} % and {1e3 * shift_s:.2g} ms at {freq_hz[edge]:.3g} Hz"
    text = f"aliases of the reference's steps change the response by {text}"
    is_at_cycle = abs(rate_hz * controller.cycle - 1) <= MAX_CLOCK_ERROR
    positions = {channels[i].at: i for i in roles["y"] if channels[i].quantity == "position"}
    is_slow = controller.cycle > 2 * np.pi * _TORQUE_LAG_S  # else the unknown lag dominates the images
    if is_at_cycle and is_slow and not roles["r"] and all(channels[i].at in positions for i in u):
        q = signals[:, [positions[channels[i].at] for i in u]]
        Q = np.fft.rfft(q - np.linspace(q[0], q[-1], n), axis=0)  # without the jump from the end to the start
        per_reference = C_ff + images
        R = (U + C_fb * Q) * per_reference.conj() / (np.abs(per_reference) ** 2 + _REGULARISATION * np.abs(C_ff) ** 2)
        return _subtracted(signals, u, images * R, text, log)
    R = np.fft.rfft(signals[:, roles["r"]], axis=0)
    if is_at_cycle and R.shape == U.shape:
        above = (freq_hz > _LOWEST * rate_hz)[:, None]
        expected, torques = (np.fft.irfft(above * X, n, axis=0) for X in ((forward + images) * R, U))
        lag, agreement = delay(expected, torques, N or n)
        if agreement > _MIN_CORRELATION:  # a command is logged some cycles before or after it acts
            turn = np.exp(-2j * np.pi * freq_hz[:, None] / rate_hz * round(lag))
            return _subtracted(signals, u, images * turn * R, text, log)
    cure = "log four times faster, filter the references, or excite up to a fifth of their rate"
    log.note(STEP_IMAGES, f"{text}. Log the references, or {cure}")
    return signals


def _subtracted(signals: FloatArray, u: Sequence[int], images: ComplexArray, text: str, log: Log) -> FloatArray:
    log.note(STEP_IMAGES, f"{text}; subtracted", "information")
    signals, images = signals.copy(), np.concatenate([0 * images[:1], images[1:]])
    signals[:, u] -= np.fft.irfft(images, len(signals), axis=0)
    return signals


def _per_reference(
    controller: CascadeSpec, freq_hz: FloatArray, ratio: int, robot: Robot, channels: Sequence[ChannelSpec],
    u: Sequence[int],
) -> tuple[ComplexArray, ComplexArray, ComplexArray, ComplexArray]:  # fmt: skip
    """Torques (F, n_u) of all images that a log with `ratio` samples in a cycle folds, of the line, C_fb, C_ff F_r."""
    at, loop, joints = [channels[i].at for i in u], loop_of(controller, len(u)), robot.driven_names
    motors = [robot.driven[robot.motor_locations.index(place)].motor for place in at]
    J = np.array([0.0 if motor is None else motor.inertia * motor.ratio**2 for motor in motors])
    T = [sum(error.low_pass for error in channels[i].errors) for i in u]

    def controlled(f: FloatArray) -> tuple[ComplexArray, ComplexArray]:
        C = sampled_responses(joints, loop, controller.spec, f, controller.tick_hz, "position")
        T = _TORQUE_LAG_S / 2 if controller.low_pass_hz else _TORQUE_LAG_S
        lag = low_pass_response((2j * np.pi * f[:, None]).astype(np.complex128), T)
        return C[0] * lag, C[1] * lag

    def logged(f: FloatArray) -> ComplexArray:
        C_fb, C_ff = controlled(f)
        return C_ff / (1 - C_fb / (J * (2 * np.pi * f[:, None]) ** 2)) * low_passes(f)

    def low_passes(f: FloatArray) -> ComplexArray:
        return np.stack([low_pass_response((2j * np.pi * f).astype(np.complex128), T_l) for T_l in T], axis=1)

    f = np.maximum(freq_hz, freq_hz[1] / 2)
    half = controller.ticks // 2 // ratio
    images = sum(logged(f + m * ratio / controller.cycle) for m in range(-half, half + 1) if m)
    return images / low_passes(f), logged(f) / low_passes(f), *controlled(f)
