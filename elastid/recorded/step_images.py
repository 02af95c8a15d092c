r"""Images of the steps of a reference in a log at the rate of the references.

References every T reach the controller through an interpolator. Its steps have images at f + m / T, and a log at the
rate 1 / T folds them onto f:

.. math:: U_{log} = U + \sum_{m \ne 0} L_m S_m C_{ff} F_r R, \qquad S_m = \frac{1}{1 + C_{fb} / (J s_m^2)},
          \qquad s_m = 2 \pi j \Big(f + \frac{m}{T}\Big)

since only the inertia J of a motor follows so fast. L_m: logged channel at the image over that at f. Images are
coherent with the excitation: neither noise nor distortion shows them.
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
    images, forward = _per_reference(controller, freq_hz, round(rate_hz * controller.cycle), robot, channels, u)
    power = np.cumsum(np.sum(np.abs(U[1:]) ** 2, axis=1))
    edge = 1 + int(np.argmax(power >= 0.99 * power[-1]))
    seen = 1 / (1 + images[edge] / forward[edge])
    gain, shift_s = np.max(np.abs(np.abs(seen) - 1)), np.max(np.abs(np.angle(seen))) / (2 * np.pi * freq_hz[edge])
    text = f"{100 * gain:.2g} % and {1e3 * shift_s:.2g} ms at {freq_hz[edge]:.3g} Hz"
    text = f"aliases of the reference's steps change the response by {text}"
    R = np.fft.rfft(signals[:, roles["r"]], axis=0)
    if abs(rate_hz * controller.cycle - 1) <= MAX_CLOCK_ERROR and R.shape == U.shape:
        above = (freq_hz > _LOWEST * rate_hz)[:, None]
        expected, torques = (np.fft.irfft(above * X, n, axis=0) for X in ((forward + images) * R, U))
        lag, agreement = delay(expected, torques, N or n)
        if agreement > _MIN_CORRELATION:  # a command is logged some cycles before or after it acts
            turn = np.exp(-2j * np.pi * freq_hz[:, None] / rate_hz * round(lag))
            signals = signals.copy()
            signals[:, u] = np.fft.irfft(U - images * turn * R * (freq_hz > 0)[:, None], n, axis=0)
            log.note(STEP_IMAGES, f"{text}; subtracted", "information")
            return signals
    cure = "log four times faster, filter the references, or excite up to a fifth of their rate"
    log.note(STEP_IMAGES, f"{text}. Log the references, or {cure}")
    return signals


def _per_reference(
    controller: CascadeSpec, freq_hz: FloatArray, ratio: int, robot: Robot, channels: Sequence[ChannelSpec],
    u: Sequence[int],
) -> tuple[ComplexArray, ComplexArray]:  # fmt: skip
    """Torques (F, n_u) of all images that a log with `ratio` samples in a cycle folds, and of the line itself."""
    at, loop, joints = [channels[i].at for i in u], loop_of(controller, len(u)), robot.driven_names
    motors = [robot.driven[robot.motor_locations.index(place)].motor for place in at]
    J = np.array([0.0 if motor is None else motor.inertia * motor.ratio**2 for motor in motors])
    T = [sum(error.low_pass for error in channels[i].errors) for i in u]

    def logged(f: FloatArray) -> ComplexArray:
        C_fb, C_ff = sampled_responses(joints, loop, controller.spec, f, controller.tick_hz, "position")
        return np.asarray(C_ff / (1 - C_fb / (J * (2 * np.pi * f[:, None]) ** 2)) * low_passes(f))

    def low_passes(f: FloatArray) -> ComplexArray:
        return np.stack([low_pass_response((2j * np.pi * f).astype(np.complex128), T_l) for T_l in T], axis=1)

    f = np.maximum(freq_hz, freq_hz[1] / 2)
    half = controller.ticks // 2 // ratio
    images = sum(logged(f + m * ratio / controller.cycle) for m in range(-half, half + 1) if m)
    return images / low_passes(f), logged(f) / low_passes(f)
