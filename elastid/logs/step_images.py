r"""Images of the steps of a reference in a log at the rate of the references.

References every T reach the controller through an interpolator. Its steps have images at f + m / T, and a log at the
rate 1 / T folds them onto f:

.. math:: U_{log} = U + \sum_{m \ne 0} L_m S_m C_{ff} F_r R, \qquad S_m = \frac{1}{1 + C_{fb} / (J s_m^2)},
          \qquad s_m = 2 \pi j \Big(f + \frac{m}{T}\Big)

since only the inertia J of a motor follows so fast. L_m: logged channel at the image over that at f; a channel that is
late by tau multiplies image m by exp(-2 pi j m tau / T). Images are coherent with the excitation, and therefore in
neither noise nor distortion. `commanded_torques` gives tau, the feedforward, the scale of K_v and the delay of R from
logged references. References R that are not logged follow from torques and positions, whatever the friction. An
error of K_v then cancels in the torques:

.. math:: R = \frac{U_{log} + C_{fb} Q}{C_{ff} F_r + \sum_{m \ne 0} L_m S_m C_{ff} F_r}
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray, laplace_variable
from elastid.experiment.specs.channels import ChannelSpec, Places
from elastid.experiment.specs.logs import RecordedSpec
from elastid.logs.commanded_torques import Drives, match_torques, positive_frequencies, report_controller
from elastid.logs.repair import LogReport
from elastid.logs.repair.clock_drift import MAX_CLOCK_ERROR
from elastid.record import MOTION_ORDER
from elastid.response import STEP_IMAGES, Response
from elastid.robot import Robot

_MIN_EXPLAINED = 0.25  # of the power of the torques, by the controller
_MIN_RATE = 0.05  # of the rate: images are compared above, since they are small and friction dominates below
_LAG_STD_S, _GAIN_STD = 1.5e-4, 0.15  # of the torques' lag with the delay of the log, and relative, of the gains
_REGULARISATION = 0.01  # of |C_ff F_r|^2: at half the rate images cancel it, and no torque shows its reference


def without_step_images(
    signals: FloatArray, channels: Sequence[ChannelSpec], roles: dict[str, list[int]], recorded: RecordedSpec,
    rate_hz: float, robot: Places, log: LogReport,
) -> FloatArray:  # fmt: skip
    """Subtract the images of references from the torques in signals (n, c), or report their size."""
    controller, u, n = recorded.controller, roles["u"], len(signals)
    if not isinstance(robot, Robot) or controller is None or recorded.has_no_torque:
        return signals
    freq_hz = np.fft.rfftfreq(n, 1 / rate_hz).astype(np.float64)
    # From four samples in a cycle on, images are below a sixteenth.
    has_images = controller.reference is not None and 0 < rate_hz * controller.cycle < 4
    drives = Drives.of(controller, robot, [channels[i] for i in u], rate_hz)
    positions = {channels[i].at: i for i in roles["y"] if channels[i].quantity == "position"}
    is_referenced = len(roles["r"]) == len(u) and all(channels[i].quantity == "position" for i in roles["r"])
    has_positions = all(channels[i].at in positions for i in u)
    if not has_images and not (is_referenced and has_positions):
        return signals
    U, R = np.fft.rfft(signals[:, u], axis=0), _without_jump(signals[:, roles["r"]])
    Q = _without_jump(signals[:, [positions[channels[i].at] for i in u]]) if has_positions else None
    lowest_hz = _MIN_RATE * rate_hz if has_images else 0.0
    match = match_torques(drives, freq_hz, U, R, Q, lowest_hz) if is_referenced else None
    if match is not None and Q is not None:
        report_controller(match, log)
    if not has_images:
        return signals
    text = _describe_size(drives, freq_hz, U)
    if abs(rate_hz * controller.cycle - 1) <= MAX_CLOCK_ERROR:
        if not roles["r"] and Q is not None and drives.can_subtract_images:
            return _subtract(signals, u, _images_by_torques(drives, freq_hz, U, Q), text, log)
        if match is not None and match.explained > _MIN_EXPLAINED:
            images, _ = match.drives.torques_per_reference(freq_hz, match.delay_s)
            return _subtract(signals, u, images * R * match.scale, text, log)
        if match is not None:
            fraction = f"{100 * match.explained:.0f} % of the torque power (limit {100 * _MIN_EXPLAINED:.0f} %)"
            text = f"{text}. They are not subtracted: the logged references and the controller explain {fraction}"
    cure = "log four times faster, filter the references, or excite up to a fifth of their rate"
    log.note(STEP_IMAGES, f"{text}. Log the references, or {cure}")
    return signals


def with_image_errors(response: Response, recorded: RecordedSpec, robot: Robot) -> Response:
    r"""Return a response to torques with the systematic errors by images of references that are not logged.

    .. math:: \delta G = -G \big[\delta\epsilon_j\, e_j e_j^T (I + C_{fb} P)
              + \epsilon_j \gamma\, e_j e_j^T C_{fb} P\big], \qquad
              \epsilon = \frac{\sum_{m \ne 0} L_m S_m C_{ff} F_r}{C_{ff} F_r}

    for each motor j, P: angles of the motors by torques.  Subtracted images are wrong by the lag of the torques, delta
    epsilon, and by the error gamma of the gains.  Images that were not subtracted have an unknown phase.
    """
    controller, rate_hz = recorded.controller, recorded.known_rate_hz
    torques = {channel.at: channel for channel in recorded.channels if channel.role == "u"}
    is_logged = any(channel.role in ("r", "reference") for channel in recorded.channels)
    if controller is None or controller.reference is None or is_logged or not 0 < rate_hz * controller.cycle < 4:
        return response
    if any(location not in torques or location not in response.outputs for location in response.inputs):
        return response
    drives = Drives.of(controller, robot, [torques[location] for location in response.inputs], rate_hz)
    f, rows = response.freq_hz, [response.outputs.index(location) for location in response.inputs]
    C_fb, C_ff = drives.controller_responses(f)
    s = laplace_variable(f[:, None])
    P = response.G[:, rows] * s[..., None] ** -MOTION_ORDER[response.quantity]
    fed_back, unit = C_fb[:, :, None] * P, np.eye(len(rows))
    images = drives.torques_per_reference(f)[0]
    if drives.can_subtract_images:
        late, early = (drives.torques_per_reference(f, tau)[0] * np.exp(s * tau) for tau in (_LAG_STD_S, -_LAG_STD_S))
        changes = [((late - early) / 2, unit + fed_back), (_GAIN_STD * images, fed_back)]
    else:
        rotation = sum(1j * np.sign(m) * image for m, image in drives.logged_torques(f))
        changes = [(image / np.sqrt(2), unit + fed_back) for image in (images, rotation)]
    errors = np.stack([-np.einsum("fyj,fj,fju->jfyu", response.G, e / C_ff, by_torque) for e, by_torque in changes])
    bias = np.zeros((1, *errors.shape[1:]), complex) if response.bias is None else response.bias
    return replace(response, bias=np.concatenate([errors, bias]), image_errors=len(errors))


def _without_jump(x: FloatArray) -> ComplexArray:
    """Compute the DFT of motions x (n, c) without the line between their ends."""
    return np.fft.rfft(x - np.linspace(x[0], x[-1], len(x)), axis=0)


def _subtract(signals: FloatArray, u: Sequence[int], images: ComplexArray, text: str, log: LogReport) -> FloatArray:
    log.note(STEP_IMAGES, f"{text}; subtracted", "information")
    signals, images = signals.copy(), np.concatenate([0 * images[:1], images[1:]])
    signals[:, u] -= np.fft.irfft(images, len(signals), axis=0)
    return signals


def _describe_size(drives: Drives, freq_hz: FloatArray, U: ComplexArray) -> str:
    """Describe the change of the response by images at the upper edge of the torques' band, in words."""
    images, line = drives.torques_per_reference(freq_hz)
    power = np.cumsum(np.sum(np.abs(U[1:]) ** 2, axis=1))
    edge = 1 + int(np.argmax(power >= 0.99 * power[-1]))
    ratio = 1 / (1 + images[edge] / line[edge])
    gain, shift_s = np.max(np.abs(np.abs(ratio) - 1)), np.max(np.abs(np.angle(ratio))) / (2 * np.pi * freq_hz[edge])
    sizes = f"{100 * gain:.2g} % and {1e3 * shift_s:.2g} ms at {freq_hz[edge]:.3g} Hz"
    return f"aliases of the reference steps in the torques change the response by {sizes}"


def _images_by_torques(drives: Drives, freq_hz: FloatArray, U: ComplexArray, Q: ComplexArray) -> ComplexArray:
    """Compute images (F, n_u) of references that are not logged."""
    C_fb, C_ff = drives.controller_responses(positive_frequencies(freq_hz))
    images, _ = drives.torques_per_reference(freq_hz)
    total = C_ff + images
    return images * ((U + C_fb * Q) * total.conj() / (np.abs(total) ** 2 + _REGULARISATION * np.abs(C_ff) ** 2))
