r"""The torque spectra of one configuration: amplitudes as the study wants them to be flat, then the phases.

.. math:: \mathrm{var}\, G / |G|^2 \approx (\sigma_u^2 + \sigma_d^2 + \sigma_y^2 / |P|^2) / |U|^2

is the expected relative variance of a response under noise of torque, disturbance and angle; `flat: precision` makes it
the same at all lines, motor by motor. P: torque to angle, U: torque that acts.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray, IntArray
from elastid.base.errors import StudyError
from elastid.excitation.grids import line_frequencies
from elastid.excitation.multisine import amplitudes, experiments, shape
from elastid.excitation.spec import MultisineSpec
from elastid.experiment.simulated.closed_loop import ClosedLoopResponse, closed_loop_response
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.simulated import ControllerSpec, NoiseSpec
from elastid.record import Configuration
from elastid.robot import Robot

# A resonance may be so far from where the nominal robot has it (springs off by a fifth): a motion is flattened by the
# largest response nearby, or a resonance that has moved to a strong line would take the robot out of its limits.
_NEARBY = np.linspace(0.9, 1.1, 9)


def injected(
    excitation: MultisineSpec,
    experiment: ExperimentSpec,
    robot: Robot,
    lines: IntArray,
    configuration: Configuration,
    draws: Sequence[np.random.SeedSequence],
    spectrum: FloatArray | None = None,
) -> ComplexArray:
    """R (M, n_u experiments, F, n_u) of one configuration, a realisation for each of the M draws.

    spectrum (F, n_u): amplitudes in Nm that a design has found (`flat: information`; until then flat in torque).
    With torque_rms: limits every motor has a share of its torque limit, to be scaled.  Raises StudyError where fewer
    lines than inputs are excited, or realisations would all be the same.
    """
    inputs = robot.motor_locations
    check_excited_lines(excitation, lines, len(inputs))
    if len(draws) > 1 and not excitation.is_new_in_every_realisation:
        raise StudyError(
            f"excitation.phases: {excitation.phases} gives the same signal in every realisation, which tells nothing "
            "about nonlinear distortion; set experiment.realisations: 1, or phases: random or optimised"
        )
    freq_hz = line_frequencies(lines, excitation.rate_hz, excitation.period_samples)
    relative = shape(freq_hz, excitation.power, excitation.spectrum)[:, None] * np.ones(len(inputs))
    responses = np.repeat(np.eye(len(inputs))[None], len(lines), axis=0).astype(np.complex128)
    is_found = excitation.flat in ("torque", "information")
    if not is_found or excitation.compress != ("torque",):
        simulated = experiment.simulated
        controller = simulated.controller if simulated is not None else ControllerSpec()
        noise = simulated.noise if simulated is not None else NoiseSpec()

        def loop_at(frequencies: FloatArray) -> ClosedLoopResponse:
            return closed_loop_response(robot, controller, configuration, frequencies, excitation.rate_hz)

        if excitation.flat == "precision":
            relative = relative * _precision(loop_at(freq_hz), noise, robot)
        elif not is_found:
            nearby = [getattr(loop_at(freq_hz * factor), excitation.flat) for factor in _NEARBY]
            relative = relative / np.max([_own(response) for response in nearby], axis=0)
        responses = loop_at(freq_hz).of(excitation.compress)
    amplitude = spectrum if spectrum is not None else amplitudes(relative, torque_rms(excitation, robot))
    how = (excitation.phases, excitation.orthogonal, lines, amplitude)
    return np.array([experiments(*how, np.random.default_rng(d), responses, excitation.effort) for d in draws])


def check_excited_lines(excitation: MultisineSpec, lines: IntArray, n_u: int) -> None:
    """StudyError where fewer lines (F,) are excited than there are inputs."""
    if len(lines) < n_u:
        low, high = excitation.band_hz
        raise StudyError(
            f"excitation: the grid {excitation.grid} has {len(lines)} lines from {low:g} to {high:g} Hz, an orthogonal "
            f"set of {n_u} experiments needs at least {n_u}; widen band_hz, or take a period of "
            f"{math.ceil(n_u / len(lines)) * excitation.period:g} s"
        )


def torque_rms(excitation: MultisineSpec, robot: Robot) -> FloatArray:
    """RMS (n_u,) of the injected torques in Nm; with `limits` shares of the torque limits, in the right proportion."""
    rms, inputs = excitation.torque_rms, robot.motor_locations
    if rms == "limits":
        limits = np.array([joint.limits.torque for joint in robot.driven])
        return np.where(np.isfinite(limits), limits, np.min(limits[np.isfinite(limits)], initial=1e3)) / 100
    if not isinstance(rms, tuple):
        return np.full(len(inputs), rms)
    if len(rms) != len(inputs):
        raise StudyError(
            f"excitation.torque_rms has {len(rms)} numbers for {len(inputs)} motors ({', '.join(inputs)}); "
            "give one for each, or a single one for all"
        )
    return np.array(rms)


def _own(response: ComplexArray) -> FloatArray:
    """|T_ii| (F, n_u): of each motor to its own torque."""
    magnitude: FloatArray = np.abs(np.diagonal(response, axis1=1, axis2=2))
    return magnitude


def _precision(loop: ClosedLoopResponse, noise: NoiseSpec, robot: Robot) -> FloatArray:
    """Relative amplitude (F, n_u) that makes the relative variance of each motor's own response flat."""
    torque, position = _own(loop.torque), _own(loop.position)
    counts = np.array([noise.encoder_counts * abs(robot.ratio(joint.name)) for joint in robot.driven])
    step = np.divide(2 * np.pi, counts, out=np.zeros(len(counts)), where=counts > 0)
    angle = noise.angle_std**2 + step**2 / 12
    variance = noise.torque_std**2 + noise.disturbance_std**2 + angle * (torque / position) ** 2
    if not np.all(variance > 0):
        raise StudyError(
            "excitation.flat: precision needs the noise that is expected; set experiment.simulated.noise, or take "
            "another flat"
        )
    deviation: FloatArray = np.sqrt(variance) / torque
    return deviation
