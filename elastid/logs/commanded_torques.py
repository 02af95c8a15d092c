r"""Torques that the controller of a study commands for logged references and positions, beside the logged torques.

.. math:: U = K e^{-s \tau} \Big[ C_{ff} F_r e^{-s \tau_r} R - C_{fb} Q \Big] + images(\tau + \tau_r)

gives the delay tau of the torques, tau_r of the references, the feedforward and the scale K of each motor. Where this
explains the torques, the parts of U by position and by velocity gain show which gain of the study is wrong.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray, laplace_variable
from elastid.experiment.specs.channels import ChannelSpec
from elastid.experiment.specs.logs import CascadeSpec
from elastid.logs.repair import LogReport
from elastid.logs.repair.clock_drift import MAX_CLOCK_ERROR
from elastid.robot import Robot, low_pass_response
from elastid.simulation.controller import loop_of, sampled_responses
from elastid.simulation.spec import ReferencePathSpec

_SMALLEST = 0.03  # of the largest reference: DFT lines with smaller ones are not compared
# Lag of current loop and torque filter, half if low_pass_hz is stated: a sample at a step still has the old torque.
TORQUE_LAG_S = 3e-4
# Explained fraction of the power of a torque above which the gains are identified to _MAX_GAIN_ERROR.
_MIN_CERTAIN, _MAX_GAIN_ERROR = 0.98, 0.1
_REFERENCE_CYCLES = range(-2, 3)  # delay of the reference path behind the logged reference, in cycles


@dataclass(frozen=True, eq=False)
class Drives:
    """Controller of a robot, with the path of its references, and the channels of the torques in a log."""

    controller: CascadeSpec
    robot: Robot
    torques: Sequence[ChannelSpec]
    rate_hz: float

    @classmethod
    def of(cls, controller: CascadeSpec, robot: Robot, torques: Sequence[ChannelSpec], rate_hz: float) -> "Drives":
        """Return drives of a study; without a path each reference acts from its sample to the next."""
        path = controller.reference or ReferencePathSpec(1 / rate_hz, "hold")
        ticks = controller.ticks if controller.reference is not None else 1
        alpha = controller.velocity_feedforward or path.velocity_feedforward
        return cls(replace(controller, reference=path, ticks=ticks), robot, torques, rate_hz).with_feedforward(alpha)

    def with_feedforward(self, alpha: float) -> "Drives":
        """Return drives with another velocity feedforward."""
        assert self.controller.reference is not None
        reference = replace(self.controller.reference, velocity_feedforward=alpha)
        return replace(self, controller=replace(self.controller, reference=reference))

    def controller_responses(self, f: FloatArray, has_position: bool = True) -> tuple[ComplexArray, ComplexArray]:
        """Compute C_fb and C_ff F_r (F, n_u) with the lag of the torque loop, or the part of the velocity gain."""
        controller, loop = self.controller, loop_of(self.controller, len(self.torques))
        loop = loop if has_position else replace(loop, kp=0 * loop.kp)
        joints, tick_hz = self.robot.driven_names, controller.tick_hz
        C_fb, C_ff = sampled_responses(joints, loop, controller.spec, f, tick_hz, "position")
        T = TORQUE_LAG_S / 2 if controller.low_pass_hz else TORQUE_LAG_S
        lag = low_pass_response(laplace_variable(f[:, None]), T)
        return C_fb * lag, C_ff * lag

    def low_passes(self, f: FloatArray) -> ComplexArray:
        """Return filters (F, n_u) of the channels."""
        s = laplace_variable(f)
        times = [sum(error.low_pass for error in channel.errors) for channel in self.torques]
        return np.stack([low_pass_response(s, T) for T in times], axis=1)

    def logged_torques(self, f: FloatArray) -> Iterator[tuple[int, ComplexArray]]:
        """Yield m and the logged torques (F, n_u) of a reference at f + m times the rate of the log, 0 its line."""
        locations = self.robot.motor_locations
        motors = [self.robot.driven[locations.index(channel.at)].motor for channel in self.torques]
        J = np.array([0.0 if motor is None else motor.inertia * motor.ratio**2 for motor in motors])
        half, filters = round(self.controller.tick_hz / self.rate_hz) // 2, self.low_passes(f)
        for m in range(-half, half + 1):
            f_m = f + m * self.rate_hz
            C_fb, C_ff = self.controller_responses(f_m)
            S = 1 / (1 - C_fb / (J * (2 * np.pi * f_m[:, None]) ** 2))
            yield m, S * C_ff * self.low_passes(f_m) / filters

    @property
    def can_subtract_images(self) -> bool:
        """True if images of references that are not logged can be subtracted: else the unknown lag dominates them."""
        cycle = self.controller.cycle
        return abs(self.rate_hz * cycle - 1) <= MAX_CLOCK_ERROR and cycle > 2 * np.pi * TORQUE_LAG_S

    def torques_per_reference(self, freq_hz: FloatArray, tau: float = 0.0) -> tuple[ComplexArray, ComplexArray]:
        """Compute the torques (F, n_u) of all images in a log late by tau, and of the lines."""
        f = positive_frequencies(freq_hz)
        images = line = np.zeros((len(f), len(self.torques)), complex)
        for m, torques in self.logged_torques(f):
            delayed_torques = torques * np.exp(-2j * np.pi * (f[:, None] + m * self.rate_hz) * tau)
            images, line = (images + delayed_torques, line) if m else (images, delayed_torques)
        return images, line


def positive_frequencies(freq_hz: FloatArray) -> FloatArray:
    """Return frequencies with half a line in place of 0, where an inertia has no response."""
    return np.where(freq_hz > 0, freq_hz, freq_hz[:2].max() / 2)


@dataclass(frozen=True, eq=False)
class TorqueMatch:
    """Commanded torques of drives (F, n_u) with the best fit to the logged torques U.

    terms: commanded torques (F, n_u) by position gain and by velocity gain, without scale and aliases, and U without
    aliases.  scale (n_u,): of the commanded torques.  explained: explained fraction of the power of U.
    """

    drives: Drives
    terms: tuple[ComplexArray, ComplexArray, ComplexArray]
    scale: FloatArray
    delay_s: float
    explained: float

    def gain_factors(self, motor: int) -> tuple[FloatArray, float]:
        """Fit factors (2,) of the terms of position and velocity gain of a motor; also explained power."""
        *columns, u = (np.concatenate([z[:, motor].real, z[:, motor].imag]) for z in self.terms)
        A = np.stack(columns, axis=1)
        factors = np.linalg.lstsq(A, u)[0]
        return factors, 1 - float(np.sum((u - A @ factors) ** 2)) / max(float(u @ u), 1e-300)


def match_torques(
    drives: Drives, freq_hz: FloatArray, U: ComplexArray, R: ComplexArray, Q: ComplexArray | None, lowest_hz: float
) -> TorqueMatch | None:
    """Match the commanded torques to U (F, n_u) above a frequency, with the best feedforward of the study's, 0 and 1.

    None without lines that have references.
    """
    stated_alpha = drives.controller.velocity_feedforward
    above = freq_hz > lowest_hz
    lines = np.flatnonzero(above & (np.abs(R).max(axis=1) > _SMALLEST * np.abs(R[above]).max(initial=0.0)))
    if not lines.size:
        return None
    signals = freq_hz[lines], U[lines], R[lines], None if Q is None else Q[lines]
    candidates = [drives.with_feedforward(alpha) for alpha in dict.fromkeys((stated_alpha, 0.0, 1.0))]
    return max((_match(drive, *signals) for drive in candidates), key=lambda match: match.explained)


def report_controller(match: TorqueMatch, log: LogReport) -> None:
    """Report motors whose logged torques need other gains than the controller of the study."""
    names = "position_gain", "velocity_gain"
    for motor, channel in enumerate(match.drives.torques):
        (by_p, by_v), explained = match.gain_factors(motor)
        if explained < _MIN_CERTAIN:  # of a motor at rest, or with another controller
            continue
        factors = by_p / max(by_v, 1e-300), by_v
        wrong = [f"{n} = {f:.3g} times" for n, f in zip(names, factors, strict=True) if abs(f - 1) > _MAX_GAIN_ERROR]
        if wrong:
            text = f"{channel.at}: the logged torques indicate {' and '.join(wrong)} the stated value"
            text += f" (limit {100 * _MAX_GAIN_ERROR:.0f} % deviation)"
            advice = "Correct experiment.recorded.controller, or the torque constant if only velocity_gain deviates"
            log.note("records/controller", f"{text}. {advice}")


def _match(drives: Drives, f: FloatArray, U: ComplexArray, R: ComplexArray, Q: ComplexArray | None) -> TorqueMatch:
    """Fit delays and scales of the commanded torques to the logged ones U (F, n_u).

    tau_r is the time from the log of a reference to its path. Without positions Q, the commanded torque is that of an
    inertia, and tau_r is 0.
    """
    from scipy.optimize import minimize  # 0.05 s, which a study without references need not load

    cycle = drives.controller.cycle
    numbers, rows = zip(*drives.logged_torques(f), strict=True)
    torques, omega = np.stack(rows) * R, 2 * np.pi * (f + np.array(numbers)[:, None] * drives.rate_hz)
    line = numbers.index(0)
    C_fb, C_ff = drives.controller_responses(f)
    forward = torques[line] if Q is None else C_ff * R
    feedback = 0 * forward if Q is None else C_fb * Q

    def delayed(tau: float, tau_r: float, forward: ComplexArray, feedback: ComplexArray) -> ComplexArray:
        path_delay, log_delay = (np.exp(-1j * omega[line] * t)[..., None] for t in (tau_r, tau))
        return np.asarray((forward * path_delay - feedback) * log_delay)

    def images(tau: float, tau_r: float) -> ComplexArray:
        phase = np.exp(-1j * omega * (tau + tau_r))[..., None]
        phase[line] = 0.0
        return np.asarray(np.sum(torques * phase, axis=0))

    def scaled(tau: float, tau_r: float) -> tuple[ComplexArray, FloatArray]:
        M = images(tau, tau_r) + delayed(tau, tau_r, forward, feedback)
        K = np.sum((M.conj() * U).real, axis=0) / np.maximum(np.sum(np.abs(M) ** 2, axis=0), 1e-300)
        return M, np.maximum(K, 0.0)

    def unexplained(delays: Sequence[float]) -> float:
        M, K = scaled(delays[0], 0.0 if Q is None else delays[1])
        return float(np.sum(np.abs(U - M * K) ** 2) / np.maximum(np.sum(np.abs(U) ** 2), 1e-300))

    cycles = range(1) if Q is None else _REFERENCE_CYCLES
    starts = [(tau, k * cycle) for k in cycles for tau in np.arange(-2, 4, 0.1) * cycle]
    start = np.array(min(starts, key=unexplained))
    options = {"initial_simplex": (start + 0.05 * cycle * np.array([[0, 0], [1, 0], [0, 1]])), "xatol": 1e-3 * cycle}
    end = minimize(unexplained, start, method="Nelder-Mead", options=options)
    delays = float(end.x[0]), 0.0 if Q is None else float(end.x[1])
    C_fb_v, C_ff_v = drives.controller_responses(f, has_position=False)
    by_velocity = delayed(*delays, C_ff_v * R, 0 * feedback if Q is None else C_fb_v * Q)
    commanded, K = delayed(*delays, forward, feedback), scaled(*delays)[1]
    terms = commanded - by_velocity, by_velocity, U - images(*delays) * K
    return TorqueMatch(drives, terms, K, sum(delays), 1 - float(end.fun))
