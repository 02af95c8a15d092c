r"""Images of the steps of a reference in a log at the rate of the references.

References every T reach the controller through an interpolator. Its steps have images at f + m / T, and a log at the
rate 1 / T folds them onto f:

.. math:: U_{log} = U + \sum_{m \ne 0} L_m S_m C_{ff} F_r R, \qquad S_m = \frac{1}{1 + C_{fb} / (J s_m^2)},
          \qquad s_m = 2 \pi j \Big(f + \frac{m}{T}\Big)

since only the inertia J of a motor follows so fast. L_m: logged channel at the image over that at f; a channel that is
late by tau multiplies image m by exp(-2 pi j m tau / T). Images are coherent with the excitation, and therefore in
neither noise nor distortion. Logged references and positions give the commanded torques C_ff F_r R - C_fb Q. Their
comparison with the logged torques gives tau, the feedforward, the scale of K_v and the delay of R. References R that
are not logged follow from torques and positions, whatever the friction. An error of K_v then cancels in the torques:

.. math:: R = \frac{U_{log} + C_{fb} Q}{C_{ff} F_r + \sum_{m \ne 0} L_m S_m C_{ff} F_r}
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.experiment.specs.channels import ChannelSpec, Places
from elastid.experiment.specs.recorded import CascadeSpec, RecordedSpec
from elastid.record import MOTION_ORDER
from elastid.recorded.repair import Log
from elastid.recorded.repair.time_stamps import MAX_CLOCK_ERROR
from elastid.response import STEP_IMAGES, Response
from elastid.robot import Robot, low_pass_response
from elastid.simulation.controller import loop_of, sampled_responses

# DFT lines of the comparison: from this part of the rate on, since friction dominates below, and with a reference of at
# least this part of the largest one. Part of their power that the controller must explain.
_LOWEST, _SMALLEST, _MIN_EXPLAINED = 0.05, 0.03, 0.25
# Of current loop and torque filter, half of it beside low_pass_hz: a sample at a step of the command shows the torque
# before it.
_TORQUE_LAG_S = 3e-4
_LAG_STD_S, _GAIN_STD = 1.5e-4, 0.15  # of this lag with the delay of the log, and relative, of the gains
_REFERENCE_CYCLES = (-2, -1, 0, 1, 2)  # from the log of a reference to the path that it takes
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
    """Subtract the images of references from the torques in signals (n, c), or report their size."""
    controller, u, n = recorded.controller, roles["u"], len(signals)
    if not isinstance(robot, Robot) or controller is None or recorded.has_commands_alone:
        return signals
    # From four samples in a cycle on, images are below a sixteenth.
    if controller.reference is None or not 0 < rate_hz * controller.cycle < 4:
        return signals
    freq_hz = np.fft.rfftfreq(n, 1 / rate_hz).astype(np.float64)
    U, R = np.fft.rfft(signals[:, u], axis=0), _without_jump(signals[:, roles["r"]])
    stated = controller.velocity_feedforward
    usual = stated or controller.reference.velocity_feedforward
    drives = _Drives(controller, robot, [channels[i] for i in u], rate_hz).with_feedforward(usual)
    text = _size(drives, freq_hz, U)
    positions = {channels[i].at: i for i in roles["y"] if channels[i].quantity == "position"}
    Q = None
    if all(channels[i].at in positions for i in u):
        Q = _without_jump(signals[:, [positions[channels[i].at] for i in u]])
    if abs(rate_hz * controller.cycle - 1) <= MAX_CLOCK_ERROR:
        if not roles["r"] and Q is not None and drives.is_subtracted:
            return _subtracted(signals, u, _images_by_torques(drives, freq_hz, U, Q), text, log)
        if R.shape == U.shape:
            images, explained = _images_by_references(drives, stated, freq_hz, U, R, Q)
            if images is not None:
                return _subtracted(signals, u, images, text, log)
            part = f"{100 * explained:.0f} % of the torque power (limit {100 * _MIN_EXPLAINED:.0f} %)"
            text = f"{text}. They are not subtracted: the logged references and the controller explain {part}"
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
    if any(place not in torques or place not in response.outputs for place in response.inputs):
        return response
    drives = _Drives(controller, robot, [torques[place] for place in response.inputs], rate_hz)
    drives = drives.with_feedforward(controller.velocity_feedforward or controller.reference.velocity_feedforward)
    f, rows = response.freq_hz, [response.outputs.index(place) for place in response.inputs]
    C_fb, C_ff = drives.controlled(f)
    s = 2j * np.pi * f[:, None]
    P = response.G[:, rows] * s[..., None] ** -MOTION_ORDER[response.quantity]
    fed_back, unit = C_fb[:, :, None] * P, np.eye(len(rows))
    images = drives.per_reference(f)[0]
    if drives.is_subtracted:
        late, early = (drives.per_reference(f, tau)[0] * np.exp(s * tau) for tau in (_LAG_STD_S, -_LAG_STD_S))
        changes = [((late - early) / 2, unit + fed_back), (_GAIN_STD * images, fed_back)]
    else:
        rotated = sum(1j * np.sign(m) * image for m, image in drives.logged(f))
        changes = [(part / np.sqrt(2), unit + fed_back) for part in (images, rotated)]
    errors = np.stack([-np.einsum("fyj,fj,fju->jfyu", response.G, e / C_ff, by_torque) for e, by_torque in changes])
    bias = np.zeros((1, *errors.shape[1:]), complex) if response.bias is None else response.bias
    return replace(response, bias=np.concatenate([errors, bias]), image_errors=len(errors))


def _without_jump(x: FloatArray) -> ComplexArray:
    """Compute the DFT of motions x (n, c) without the line between their ends."""
    return np.asarray(np.fft.rfft(x - np.linspace(x[0], x[-1], len(x)), axis=0))


def _subtracted(signals: FloatArray, u: Sequence[int], images: ComplexArray, text: str, log: Log) -> FloatArray:
    log.note(STEP_IMAGES, f"{text}; subtracted", "information")
    signals, images = signals.copy(), np.concatenate([0 * images[:1], images[1:]])
    signals[:, u] -= np.fft.irfft(images, len(signals), axis=0)
    return signals


@dataclass(frozen=True, eq=False)
class _Drives:
    """Controller of a robot, with the path of its references, and the channels of the torques in a log."""

    controller: CascadeSpec
    robot: Robot
    torques: Sequence[ChannelSpec]
    rate_hz: float

    def with_feedforward(self, alpha: float) -> "_Drives":
        """Drives with another velocity feedforward."""
        assert self.controller.reference is not None
        reference = replace(self.controller.reference, velocity_feedforward=alpha)
        return replace(self, controller=replace(self.controller, reference=reference))

    def controlled(self, f: FloatArray) -> tuple[ComplexArray, ComplexArray]:
        """Compute C_fb and C_ff F_r (F, n_u) with the lag of the torque loop."""
        controller, loop = self.controller, loop_of(self.controller, len(self.torques))
        joints, tick_hz = self.robot.driven_names, controller.tick_hz
        C_fb, C_ff = sampled_responses(joints, loop, controller.spec, f, tick_hz, "position")
        T = _TORQUE_LAG_S / 2 if controller.low_pass_hz else _TORQUE_LAG_S
        lag = low_pass_response((2j * np.pi * f[:, None]).astype(np.complex128), T)
        return C_fb * lag, C_ff * lag

    def low_passes(self, f: FloatArray) -> ComplexArray:
        """Filters (F, n_u) of the channels."""
        s = (2j * np.pi * f).astype(np.complex128)
        times = [sum(error.low_pass for error in channel.errors) for channel in self.torques]
        return np.stack([low_pass_response(s, T) for T in times], axis=1)

    def logged(self, f: FloatArray) -> Iterator[tuple[int, ComplexArray]]:
        """Yield m and the logged torques (F, n_u) of a reference at f + m times the rate of the log, 0 its line."""
        locations = self.robot.motor_locations
        motors = [self.robot.driven[locations.index(channel.at)].motor for channel in self.torques]
        J = np.array([0.0 if motor is None else motor.inertia * motor.ratio**2 for motor in motors])
        half, filters = round(self.controller.tick_hz / self.rate_hz) // 2, self.low_passes(f)
        for m in range(-half, half + 1):
            f_m = f + m * self.rate_hz
            C_fb, C_ff = self.controlled(f_m)
            S = 1 / (1 - C_fb / (J * (2 * np.pi * f_m[:, None]) ** 2))
            yield m, np.asarray(S * C_ff * self.low_passes(f_m) / filters)

    @property
    def is_subtracted(self) -> bool:
        """True if images of references that are not logged can be subtracted: else the unknown lag dominates them."""
        cycle = self.controller.cycle
        return abs(self.rate_hz * cycle - 1) <= MAX_CLOCK_ERROR and cycle > 2 * np.pi * _TORQUE_LAG_S

    def per_reference(self, freq_hz: FloatArray, tau: float = 0.0) -> tuple[ComplexArray, ComplexArray]:
        """Compute the torques (F, n_u) of all images in a log late by tau, and of the lines."""
        f = _positive(freq_hz)
        images = line = np.zeros((len(f), len(self.torques)), complex)
        for m, torques in self.logged(f):
            late = torques * np.exp(-2j * np.pi * (f[:, None] + m * self.rate_hz) * tau)
            images, line = (images + late, line) if m else (images, late)
        return images, line


def _positive(freq_hz: FloatArray) -> FloatArray:
    """Frequencies with half a line in place of 0, where an inertia has no response."""
    return np.maximum(freq_hz, float(freq_hz[1]) / 2)


def _size(drives: _Drives, freq_hz: FloatArray, U: ComplexArray) -> str:
    """The change of the response by images at the upper edge of the torques' band, in words."""
    images, line = drives.per_reference(freq_hz)
    power = np.cumsum(np.sum(np.abs(U[1:]) ** 2, axis=1))
    edge = 1 + int(np.argmax(power >= 0.99 * power[-1]))
    ratio = 1 / (1 + images[edge] / line[edge])
    gain, shift_s = np.max(np.abs(np.abs(ratio) - 1)), np.max(np.abs(np.angle(ratio))) / (2 * np.pi * freq_hz[edge])
    sizes = f"{100 * gain:.2g} % and {1e3 * shift_s:.2g} ms at {freq_hz[edge]:.3g} Hz"
    return f"aliases of the reference steps in the torques change the response by {sizes}"


def _images_by_torques(drives: _Drives, freq_hz: FloatArray, U: ComplexArray, Q: ComplexArray) -> ComplexArray:
    """Images (F, n_u) of references that are not logged."""
    C_fb, C_ff = drives.controlled(_positive(freq_hz))
    images, _ = drives.per_reference(freq_hz)
    both = C_ff + images
    R = (U + C_fb * Q) * both.conj() / (np.abs(both) ** 2 + _REGULARISATION * np.abs(C_ff) ** 2)
    return images * R


def _images_by_references(
    drives: _Drives, stated: float, freq_hz: FloatArray, U: ComplexArray, R: ComplexArray, Q: ComplexArray | None
) -> tuple[ComplexArray | None, float]:
    """Images (F, n_u) of logged references, and the part of the torques' power that the controller explains.

    The feedforward, `stated` or another one, is that which explains most; None if this is little.
    """
    above = freq_hz > _LOWEST * drives.rate_hz
    largest = np.abs(R[above]).max(initial=0.0)
    lines = np.flatnonzero(above & (np.abs(R).max(axis=1) > _SMALLEST * largest))
    if not lines.size:
        return None, 0.0
    matches = []
    for alpha in dict.fromkeys((stated, 0.0, 1.0)):
        candidate = drives.with_feedforward(alpha)
        of_lines = R[lines], None if Q is None else Q[lines]
        matches.append((*_explained(candidate, freq_hz[lines], U[lines], *of_lines), candidate))
    explained, delay_s, scale, candidate = max(matches, key=lambda match: match[0])
    if explained < _MIN_EXPLAINED:
        return None, explained
    images, _ = candidate.per_reference(freq_hz, delay_s)
    return images * R * scale, explained


def _explained(
    drives: _Drives, f: FloatArray, U: ComplexArray, R: ComplexArray, Q: ComplexArray | None
) -> tuple[float, float, FloatArray]:
    r"""Fit delays and scales (n_u,) of the commanded torques to the logged ones U (F, n_u).

    .. math:: U = K e^{-s \tau} \Big[ C_{ff} F_r e^{-s \tau_r} R - C_{fb} Q \Big] + images(\tau + \tau_r)

    Returns the part of the power of U that this explains, tau + tau_r in s, and K. tau_r is the time from the log of a
    reference to its path. Without positions Q, the first term is that of an inertia, and tau_r is 0.
    """
    from scipy.optimize import minimize  # 0.05 s, which a study without images need not load

    cycle = drives.controller.cycle
    numbers, each = zip(*drives.logged(f), strict=True)
    torques, omega = np.stack(each) * R, 2 * np.pi * (f + np.array(numbers)[:, None] * drives.rate_hz)
    line = numbers.index(0)
    C_fb, C_ff = drives.controlled(f)
    forward = torques[line] if Q is None else C_ff * R
    feedback = 0 * forward if Q is None else C_fb * Q

    def scaled(tau: float, tau_r: float) -> tuple[ComplexArray, FloatArray]:
        late, of_reference, of_log = (np.exp(-1j * w * t)[..., None] for w, t in (
            (omega, tau + tau_r), (omega[line], tau_r), (omega[line], tau)))  # fmt: skip
        late[line] = 0.0
        M = np.sum(torques * late, axis=0) + (forward * of_reference - feedback) * of_log
        K = np.sum((M.conj() * U).real, axis=0) / np.maximum(np.sum(np.abs(M) ** 2, axis=0), 1e-300)
        return M, np.maximum(K, 0.0)

    def unexplained(delays: Sequence[float]) -> float:
        M, K = scaled(delays[0], 0.0 if Q is None else delays[1])
        return float(np.sum(np.abs(U - M * K) ** 2) / np.maximum(np.sum(np.abs(U) ** 2), 1e-300))

    cycles = (0,) if Q is None else _REFERENCE_CYCLES
    starts = [(tau, k * cycle) for k in cycles for tau in np.arange(-2, 4, 0.1) * cycle]
    start = np.array(min(starts, key=unexplained))
    simplex = start + 0.05 * cycle * np.array([[0, 0], [1, 0], [0, 1]])
    end = minimize(
        unexplained, start, method="Nelder-Mead", options={"initial_simplex": simplex, "xatol": 1e-3 * cycle}
    )
    tau, tau_r = end.x[0], 0.0 if Q is None else end.x[1]
    return 1 - float(end.fun), float(tau + tau_r), scaled(tau, tau_r)[1]
