r"""Torque spectra of one configuration: amplitudes for the quantity that is to be flat, then phases.

.. math:: \mathrm{var}\, G / |G|^2 \approx (\sigma_u^2 + \sigma_d^2 + \sigma_y^2 / |P|^2) / |U|^2

is the expected relative variance of a response under noise of torque, disturbance and angle; `flat: precision` makes it
the same at all lines, motor by motor. P: torque to angle, U: acting torque. The closed-loop response is an argument.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeAlias

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray, IntArray, frozen_value
from elastid.base.errors import StudyError
from elastid.excitation.grids import line_count_refusal, line_frequencies
from elastid.excitation.multisine import amplitudes, experiments, relative_amplitudes
from elastid.excitation.spec import MultisineSpec, Signal
from elastid.experiment.specs.disturbances import NoiseSpec
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.record import Configuration
from elastid.robot import Robot

# True resonances lie within 10 % of the nominal ones (springs off by a fifth): a motion is flattened by the largest
# response in that range, otherwise a resonance moved to a strong line would take the robot out of its limits.
_NEARBY = np.linspace(0.9, 1.1, 9)


@frozen_value
class ClosedLoopResponse:
    """From injected torques (F, n_u, n_u): the motors' torque, and their position, velocity and acceleration."""

    torque: ComplexArray
    position: ComplexArray
    velocity: ComplexArray
    acceleration: ComplexArray

    def stacked(self, signals: tuple[Signal, ...]) -> ComplexArray:
        """The responses of several signals (F, n_signals n_u, n_u), one signal's motors after the other's."""
        return np.concatenate([getattr(self, signal) for signal in signals], axis=1)


# The expected response in a configuration at frequencies (F,) in Hz (`experiment.simulated.closed_loop` makes one).
PredictClosedLoop: TypeAlias = Callable[[Configuration, FloatArray], ClosedLoopResponse]


def torque_spectra(
    excitation: MultisineSpec,
    experiment: ExperimentSpec,
    robot: Robot,
    lines: IntArray,
    configuration: Configuration,
    draws: Sequence[np.random.SeedSequence],
    spectrum: FloatArray | None = None,
    closed_loop: PredictClosedLoop | None = None,
) -> ComplexArray:
    """R (M, n_u experiments, F, n_u) of one configuration, a realisation for each of the M draws.

    spectrum (F, n_u): amplitudes in Nm that a design has found (`flat: information`; until then flat in torque).
    closed_loop: needed where anything but the torque is to be flat or compressed.  With torque_rms: limits every motor
    has a share of its torque limit, to be scaled.  Raises StudyError where fewer lines than inputs are excited,
    realisations would all be the same, or closed_loop is missing.
    """
    inputs = robot.motor_locations
    if refused := line_count_refusal(len(lines), len(inputs), "motors"):
        raise StudyError(f"excitation: {refused}")
    if refused := excitation.realisation_refusal(len(draws)):
        raise StudyError(f"excitation.phases: {refused}")
    freq_hz = line_frequencies(lines, excitation.rate_hz, excitation.period_samples)
    relative = relative_amplitudes(freq_hz, excitation.power, excitation.spectrum)[:, None] * np.ones(len(inputs))
    responses = np.repeat(np.eye(len(inputs))[None], len(lines), axis=0).astype(np.complex128)
    is_found = excitation.flat in ("torque", "information")
    if not is_found or excitation.compress != ("torque",):
        if closed_loop is None:
            raise StudyError(
                f"excitation: flat: {excitation.flat} with compress: [{', '.join(excitation.compress)}] needs the "
                "robot's closed-loop response; call make_plan with closed_loop=elastid.closed_loop_of(robot, "
                "experiment.simulated.controller, excitation.rate_hz), or set flat and compress to torque"
            )
        if excitation.flat == "precision":
            noise = experiment.as_simulated().noise
            relative = relative * _precision(closed_loop(configuration, freq_hz), noise, robot)
        elif not is_found:
            nearby = [getattr(closed_loop(configuration, freq_hz * factor), excitation.flat) for factor in _NEARBY]
            relative = relative / np.max([_own(response) for response in nearby], axis=0)
        responses = closed_loop(configuration, freq_hz).stacked(excitation.compress)
    amplitude = spectrum if spectrum is not None else amplitudes(relative, torque_rms(excitation, robot))
    how = (excitation.phases, excitation.orthogonal, lines, amplitude)
    search = (responses, len(draws) == 1)
    return np.array([experiments(*how, np.random.default_rng(d), *search) for d in draws])


def torque_rms(excitation: MultisineSpec, robot: Robot) -> FloatArray:
    """RMS (n_u,) of the injected torques in Nm; with `limits` shares of the torque limits, in the right proportion."""
    rms = excitation.torque_rms
    if rms == "limits":
        limits = np.array([joint.limits.torque for joint in robot.driven])
        return np.where(np.isfinite(limits), limits, np.min(limits[np.isfinite(limits)], initial=1e3)) / 100
    if not isinstance(rms, tuple):
        return np.full(len(robot.driven), rms)
    if refused := robot.count_refusal(len(rms), "torques"):
        raise StudyError(f"excitation.torque_rms: {refused}, or one for all")
    return np.array(rms)


def _own(response: ComplexArray) -> FloatArray:
    """|T_ii| (F, n_u): of each motor to its own torque."""
    return np.asarray(np.abs(np.diagonal(response, axis1=1, axis2=2)))


def _precision(loop: ClosedLoopResponse, noise: NoiseSpec, robot: Robot) -> FloatArray:
    """Relative amplitude (F, n_u) that makes the relative variance of each motor's own response flat."""
    torque, position = _own(loop.torque), _own(loop.position)
    counts = np.array([noise.encoder_counts * abs(robot.ratio(joint.name)) for joint in robot.driven])
    step = np.divide(2 * np.pi, counts, out=np.zeros(len(counts)), where=counts > 0)
    angle = noise.angle_std**2 + step**2 / 12
    variance = noise.torque_std**2 + noise.disturbance_std**2 + angle * (torque / position) ** 2
    if not np.all(variance > 0):
        raise StudyError(
            "excitation.flat: precision needs the expected noise; set experiment.simulated.noise, or take another flat"
        )
    return np.asarray(np.sqrt(variance) / torque)
