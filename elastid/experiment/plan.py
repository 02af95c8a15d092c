"""Plan: configurations x realisations x experiments x periods, and the torque spectra to inject."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from elastid.arrays import ComplexArray, FloatArray, IntArray, frozen
from elastid.errors import StudyError
from elastid.excitation.grids import grid_lines, line_frequencies
from elastid.excitation.multisine import amplitudes, orthogonal_set, synthesise
from elastid.excitation.spec import MultisineSpec
from elastid.experiment.spec import ExperimentSpec
from elastid.record import Configuration
from elastid.robot import Robot


@dataclass(frozen=True)
class Experiment:
    """One run of the robot: which configuration, which realisation of random phases, which of its experiments."""

    configuration: Configuration
    realisation: int
    experiment: int

    @property
    def name(self) -> str:
        """A file-safe name, unique in a plan."""
        return f"{self.configuration.name}-r{self.realisation}-e{self.experiment}"


@dataclass(frozen=True)
class Chosen:
    """A configuration that a design has chosen, and in how many realisations it is measured."""

    configuration: Configuration
    realisations: int


@dataclass(frozen=True)
class Plan:
    """What to run, sampled at rate_hz with period_samples per period.

    lines (F,): excited DFT lines, frequency = line * rate_hz / period_samples.
    R (Q, M, E, F, n_u): torque amplitude spectrum, link-side Nm: r(t) = Re sum_f R_f exp(2 pi j f t); zero where a
    configuration has fewer realisations than M.
    periods are measured after transient_periods that are run but not used.
    """

    configurations: tuple[Configuration, ...]
    inputs: tuple[str, ...]
    rate_hz: float
    period_samples: int
    periods: int
    transient_periods: int
    lines: IntArray
    R: ComplexArray

    def __post_init__(self) -> None:
        """Freeze and check."""
        object.__setattr__(self, "lines", frozen(self.lines, np.int64))
        object.__setattr__(self, "R", frozen(self.R, np.complex128))
        Q, _, _, F, n_u = self.R.shape
        if (Q, F, n_u) != (len(self.configurations), len(self.lines), len(self.inputs)):
            raise ValueError(f"R has shape {self.R.shape}; it does not fit configurations, lines and inputs")

    @property
    def freq_hz(self) -> FloatArray:
        """Excited frequencies (F,)."""
        return line_frequencies(self.lines, self.rate_hz, self.period_samples)

    @property
    def experiments(self) -> tuple[Experiment, ...]:
        """All runs, configuration by configuration."""
        E = self.R.shape[2]
        each = zip(self.configurations, self.realisations, strict=True)
        return tuple(Experiment(c, m, e) for c, M in each for m in range(M) for e in range(E))

    @property
    def realisations(self) -> tuple[int, ...]:
        """How many realisations each configuration has."""
        return tuple(np.any(self.R != 0, axis=(2, 3, 4)).sum(axis=1).tolist())

    def torque(self, experiment: Experiment) -> FloatArray:
        """One period of the torque to inject (period_samples, n_u), link-side Nm."""
        q = [c.name for c in self.configurations].index(experiment.configuration.name)
        return synthesise(self.lines, self.R[q, experiment.realisation, experiment.experiment], self.period_samples)

    @property
    def robot_time_s(self) -> float:
        """How long the robot runs, transients included, movements between configurations not."""
        return len(self.experiments) * (self.periods + self.transient_periods) * self.period_samples / self.rate_hz


def checked_configurations(experiment: ExperimentSpec, robot: Robot) -> tuple[Configuration, ...]:
    """The configurations of a study; StudyError for a wrong number of angles or a joint outside its limits."""
    for name, angles in experiment.configurations.items():
        if len(angles) != len(robot.driven):
            raise StudyError(
                f"configuration {name} has {len(angles)} angles; robot {robot.name} has {len(robot.driven)} driven "
                f"joints ({', '.join(joint.name for joint in robot.driven)}), one angle each"
            )
        for joint, angle in zip(robot.driven, angles, strict=True):
            low, high = joint.limits.angle
            if not low <= angle <= high:
                raise StudyError(
                    f"configuration {name}: joint {joint.name} at {math.degrees(angle):.4g} deg is outside its limits "
                    f"[{math.degrees(low):.4g}, {math.degrees(high):.4g}] deg; move it inside, or correct limits.angle"
                )
    return tuple(Configuration(name, np.array(angles)) for name, angles in experiment.configurations.items())


def make_plan(
    excitation: MultisineSpec, experiment: ExperimentSpec, robot: Robot, seed: int, chosen: Sequence[Chosen] = ()
) -> Plan:
    """The plan of a study: n_u experiments of an orthogonal multisine per realisation and configuration.

    chosen: configurations that a design has added to those of the study.  The phases of a set hang on seed,
    configuration index and realisation alone, so that a further configuration or realisation leaves the others as they
    were.  Raises StudyError for what the robot cannot do.
    """
    given = [Chosen(c, experiment.realisations) for c in checked_configurations(experiment, robot)]
    everyone = (*given, *chosen)
    inputs = robot.motor_locations
    lines = grid_lines(excitation.grid, excitation.band_hz, excitation.rate_hz, excitation.period_samples)
    freq_hz = line_frequencies(lines, excitation.rate_hz, excitation.period_samples)
    amplitude = amplitudes(freq_hz, excitation.spectrum, _torque_rms(excitation, inputs))
    R = np.zeros((len(everyone), max(one.realisations for one in everyone), len(inputs), *amplitude.shape), complex)
    for q, one in enumerate(everyone):
        for m in range(one.realisations):
            R[q, m] = orthogonal_set(amplitude, np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(q, m))))
    return Plan(
        configurations=tuple(one.configuration for one in everyone),
        inputs=inputs,
        rate_hz=excitation.rate_hz,
        period_samples=excitation.period_samples,
        periods=experiment.periods,
        transient_periods=experiment.transient_periods,
        lines=lines,
        R=R,
    )


def _torque_rms(excitation: MultisineSpec, inputs: tuple[str, ...]) -> FloatArray:
    rms = excitation.torque_rms
    if not isinstance(rms, tuple):
        return np.full(len(inputs), rms)
    if len(rms) != len(inputs):
        raise StudyError(
            f"excitation.torque_rms has {len(rms)} numbers for {len(inputs)} motors ({', '.join(inputs)}); "
            "give one for each, or a single one for all"
        )
    return np.array(rms)
