"""Plan: configurations x realisations x experiments x periods, and their torque spectra."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray, IntArray, frozen_value, labelled
from elastid.base.display import Display, as_html, as_text, degrees
from elastid.base.errors import StudyError, index_of
from elastid.base.names import at_amplitude
from elastid.excitation.grids import line_count_refusal, line_frequencies
from elastid.excitation.multisine import amplitudes, experiments, relative_amplitudes, synthesise
from elastid.excitation.spec import Injected, MultisineSpec, Signal, planned_lines
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.record import Configuration, drive_unit
from elastid.robot import Robot

# True resonances lie within 10 % of the nominal ones (springs off by a fifth): a motion is flattened by the largest
# response in that range, otherwise a resonance moved to a strong line would take the robot out of its limits.
_NEARBY = np.linspace(0.9, 1.1, 9)


@frozen_value
class ClosedLoopResponse:
    """Responses (F, n_u, n_u) to planned torques: torque, position, velocity and acceleration of the motors.

    Planned torques are those that are injected, or those that act if references are injected: reference is then
    S_u^-1, from the acting torques to the references in rad or rad/s; otherwise the identity.
    """

    torque: ComplexArray
    position: ComplexArray
    velocity: ComplexArray
    acceleration: ComplexArray
    reference: ComplexArray

    def stacked(self, signals: tuple[Signal, ...]) -> ComplexArray:
        """Return the responses of several signals (F, n_signals n_u, n_u), one signal's motors after the other's."""
        return np.concatenate([getattr(self, signal) for signal in signals], axis=1)


# The expected response in a configuration at frequencies (F,) in Hz (`simulated.plant.closed_loop_of` makes one).
PredictClosedLoop: TypeAlias = Callable[[Configuration, FloatArray], ClosedLoopResponse]


def torque_spectra(
    excitation: MultisineSpec, robot: Robot, lines: IntArray, configuration: Configuration,
    draws: Sequence[np.random.SeedSequence], spectrum: FloatArray | None = None,
    closed_loop: PredictClosedLoop | None = None,
) -> ComplexArray:  # fmt: skip
    """Compute R (M, n_u experiments, F, n_u) of one configuration, a realisation for each of the M draws.

    spectrum, closed_loop: as `make_plan` takes them.  Flat in torque until `flat: information` has its spectrum; with
    torque_rms: limits every motor has a share of its torque limit, to be scaled.  Raises StudyError where fewer lines
    than inputs are excited, realisations would all be the same, or closed_loop is missing.
    """
    inputs = robot.motor_locations
    if refusal := line_count_refusal(len(lines), len(inputs), "motors"):
        raise StudyError("excitation/power", refusal, "excitation")
    if refusal := excitation.realisation_refusal(len(draws)):
        raise StudyError("excitation/lines", refusal, "excitation.phases")
    freq_hz = line_frequencies(lines, excitation.rate_hz, excitation.period_samples)
    relative = relative_amplitudes(freq_hz, excitation.power, excitation.spectrum)[:, None] * np.ones(len(inputs))
    responses = np.repeat(np.eye(len(inputs))[None], len(lines), axis=0).astype(np.complex128)
    is_torque = excitation.flat in ("torque", "information")
    if not is_torque or excitation.compress != ("torque",) or excitation.inject != "torque":
        if closed_loop is None:
            raise StudyError(
                "excitation/power",
                "flat, compress and inject need the closed-loop response of the robot. Call make_plan with "
                "closed_loop=closed_loop_of(robot, experiment.simulated.controller, excitation.rate_hz, "
                "excitation.inject), or set all three to torque",
                "excitation",
            )
        if not is_torque:
            nearby = [getattr(closed_loop(configuration, freq_hz * factor), excitation.flat) for factor in _NEARBY]
            # |T_ii| (F, n_u): of each motor to its own torque.
            relative = relative / np.max(np.abs(np.diagonal(nearby, axis1=2, axis2=3)), axis=0)
        responses = closed_loop(configuration, freq_hz).stacked(excitation.compress)
    amplitude = spectrum if spectrum is not None else amplitudes(relative, torque_rms(excitation, robot))
    how = (excitation.phases, excitation.orthogonal, lines, amplitude)
    search = (responses, len(draws) == 1)
    return np.array([experiments(*how, np.random.default_rng(d), *search) for d in draws])


def torque_rms(excitation: MultisineSpec, robot: Robot) -> FloatArray:
    """Compute RMS (n_u,) of injected torques in Nm; with `limits` shares of the torque limits, in the right proportion.

    The first of several amplitudes.
    """
    rms = excitation.amplitudes[0]
    if rms == "limits":
        limits = np.array([joint.limits.torque for joint in robot.driven])
        return np.where(np.isfinite(limits), limits, np.min(limits[np.isfinite(limits)], initial=1e3)) / 100
    if not isinstance(rms, tuple):
        return np.full(robot.n_u, rms)
    if refusal := robot.count_refusal(len(rms), "torques"):
        raise StudyError("excitation/power", f"{refusal}, or one for all", "excitation.torque_rms")
    return np.array(rms)


@dataclass(frozen=True)
class Experiment:
    """One run of the robot: configuration, realisation of random phases, and experiment number."""

    configuration: Configuration
    realisation: int
    experiment: int

    @property
    def name(self) -> str:
        """A file-safe name, unique in a plan."""
        return f"{self.configuration.name}-r{self.realisation}-e{self.experiment}"


@dataclass(frozen=True)
class DesignedConfiguration:
    """A configuration that a design has chosen, and in how many realisations it is measured."""

    configuration: Configuration
    realisations: int


@frozen_value
class Plan:
    """The runs of a robot, sampled at rate_hz with period_samples per period.

    lines (F,): excited DFT lines, frequency = line * rate_hz / period_samples.
    R (Q, M, E, F, n_u): torque amplitude spectrum, link-side Nm: r(t) = Re sum_f R_f exp(2 pi j f t); zero where a
    configuration has fewer realisations than M.  periods are measured after transient_periods that are run but not
    used.  detection (F_d,): lines of the band that were left free for the distortion to show.  A run holds still for
    hold_samples, begins within ramp_samples, repeats its periods, ends within ramp_samples and holds still again.
    sliding: inputs that translate, in N and m instead of Nm and rad.  inject: the quantity that the robot takes every
    cycle_samples.  If it takes references, R is that of the acting torques, and S_u^-1 R, with S_inverse
    (Q, F, n_u, n_u) in rad/Nm (rad/s/Nm), that of the references.
    """

    configurations: tuple[Configuration, ...] = labelled(rows=True)
    inputs: tuple[str, ...]
    rate_hz: float
    period_samples: int
    periods: int
    transient_periods: int
    lines: IntArray = labelled("excited DFT lines")
    R: ComplexArray = labelled("injected torque, link side", "N*m", "configurations realisation run freq_hz inputs")
    detection: IntArray = labelled("DFT lines without excitation", default_factory=lambda: np.zeros(0, np.int64))
    ramp_samples: int = 0
    hold_samples: int = 0
    sliding: tuple[str, ...] = ()
    inject: Injected = "torque"
    cycle_samples: int = 1
    S_inverse: ComplexArray = labelled(
        "reference of a unit torque", "rad/(N*m)", "configurations freq_hz inputs inputs",
        default_factory=lambda: np.zeros((0, 0, 0, 0), complex),
    )  # fmt: skip

    def __post_init__(self) -> None:
        Q, _, _, F, n_u = self.R.shape
        if (Q, F, n_u) != (len(self.configurations), len(self.lines), len(self.inputs)):
            raise ValueError(f"R has shape {self.R.shape}; it does not fit configurations, lines and inputs")

    __repr__, _repr_html_ = as_text, as_html

    @property
    def display(self) -> Display:
        """Rate, period and lines, and the RMS torque of each input in each configuration."""
        f = self.freq_hz
        rms = np.sqrt(np.sum(np.abs(self.R) ** 2, axis=3) / 2).max(axis=(1, 2))
        slides = [location in self.sliding for location in self.inputs]
        rows = [
            (c.name, degrees(c.angles.tolist(), slides), str(M), ", ".join(f"{torque:.3g}" for torque in torques))
            for c, M, torques in zip(self.configurations, self.realisations, rms.tolist(), strict=True)
        ]
        units = " or ".join(dict.fromkeys(drive_unit(location in self.sliding) for location in self.inputs))
        return Display(
            f"Plan of {len(self.experiments)} runs, {self.robot_time_s:.4g} s: {len(f)} lines from {f[0]:.4g} to "
            f"{f[-1]:.4g} Hz at {self.rate_hz:g} Hz, {self.periods} periods of {self.period_samples} samples",
            ("configuration", "angles", "realisations", f"RMS of {', '.join(self.inputs)} in {units}, largest"),
            rows,
        )

    @property
    def freq_hz(self) -> FloatArray:
        """Excited frequencies (F,)."""
        return line_frequencies(self.lines, self.rate_hz, self.period_samples)

    @cached_property
    def experiments(self) -> tuple[Experiment, ...]:
        """All runs, configuration by configuration."""
        E = self.R.shape[2]
        measured = zip(self.configurations, self.realisations, strict=True)
        return tuple(Experiment(c, m, e) for c, M in measured for m in range(M) for e in range(E))

    @property
    def realisations(self) -> tuple[int, ...]:
        """Number of realisations of each configuration."""
        return tuple(np.any(self.R != 0, axis=(2, 3, 4)).sum(axis=1).tolist())

    def torque(self, experiment: Experiment) -> FloatArray:
        """Return one period of the planned torque (period_samples, n_u), link-side Nm."""
        return synthesise(self.lines, self._spectrum(experiment)[1], self.period_samples)

    def reference(self, experiment: Experiment) -> FloatArray:
        """Compute one period of the reference of this torque (period_samples, n_u), link-side rad or rad/s."""
        q, R = self._spectrum(experiment)
        return synthesise(self.lines, (self.S_inverse[q] @ R[:, :, None])[:, :, 0], self.period_samples)

    def _spectrum(self, experiment: Experiment) -> tuple[int, ComplexArray]:
        q = index_of(experiment.configuration.name, [c.name for c in self.configurations], "configuration")
        return q, np.asarray(self.R[q, experiment.realisation, experiment.experiment])

    def scaled(self, factor: FloatArray) -> "Plan":
        """Return the plan with its torques times factor (Q, n_u)."""
        return replace(self, R=self.R * factor[:, None, None, None, :])

    def at(self, configuration: int, realisations: int | None = None) -> "Plan":
        """Return the plan of one configuration, in as many of its realisations (default: all)."""
        q = slice(configuration, configuration + 1)
        R, S_inverse = self.R[q, :realisations], self.S_inverse[q]
        return replace(self, configurations=self.configurations[q], R=R, S_inverse=S_inverse)

    @property
    def robot_time_s(self) -> float:
        """Duration of all runs, with transients, ramps and holds, without movements between configurations."""
        return len(self.experiments) * self.run_samples / self.rate_hz

    @property
    def first_sample(self) -> int:
        """The sample of a run with which its first period, of transient, begins."""
        return self.hold_samples + self.ramp_samples

    @property
    def measured(self) -> slice:
        """Samples of a run in the measured periods."""
        first = self.first_sample + self.transient_periods * self.period_samples
        return slice(first, first + self.periods * self.period_samples)

    @property
    def run_samples(self) -> int:
        """Samples of a complete run, from and to zero velocity."""
        return 2 * self.first_sample + (self.transient_periods + self.periods) * self.period_samples


def make_plan(
    excitation: MultisineSpec, experiment: ExperimentSpec, robot: Robot, seed: int,
    designed: Sequence[DesignedConfiguration] = (), spectra: Mapping[str, FloatArray] | None = None,
    closed_loop: PredictClosedLoop | None = None,
) -> Plan:  # fmt: skip
    """Make the plan of a study: per realisation and configuration n_u experiments of an orthogonal multisine.

    With several amplitudes each configuration is measured at every one, under a name of its own (`at_amplitude`).

    designed: configurations that a design has added to those of the study.  spectra: amplitudes (F, n_u) in Nm that it
    has found, by the configuration's name.  closed_loop: needed where excitation.flat or compress names a quantity
    other than the torque.  The phases of a set depend on seed, configuration index and realisation alone, so that a
    further configuration or realisation leaves the others as they were (but for optimised phases, the first other
    realisation).  Raises StudyError where the robot cannot do it.
    """
    picks = [DesignedConfiguration(c, experiment.realisations) for c in experiment.postures.values()]
    everyone = [
        (
            index,
            replace(pick, configuration=replace(pick.configuration, name=at_amplitude(pick.configuration.name, index))),
        )
        for pick in (*picks, *designed)
        for index in range(1, len(excitation.amplitudes) + 1)
    ]
    lines, n_u = planned_lines(excitation, seed), robot.n_u
    M, E = max(choice.realisations for _, choice in everyone), experiment.runs(n_u)
    R = np.zeros((len(everyone), M, E, len(lines.excited), n_u), complex)
    for q, (index, choice) in enumerate(everyone):
        draws = [np.random.SeedSequence(seed, spawn_key=(q, m)) for m in range(choice.realisations)]
        spectrum = (spectra or {}).get(choice.configuration.name)
        R_q = torque_spectra(
            excitation.at_amplitude(index), robot, lines.excited, choice.configuration, draws, spectrum,
            closed_loop,
        )  # fmt: skip
        R[q, : len(draws)] = R_q[:, :E]
    configurations, inputs = tuple(choice.configuration for _, choice in everyone), robot.motor_locations
    timing = excitation.rate_hz, excitation.period_samples, experiment.periods, experiment.transient_periods
    cycle, references = 1, dict[str, Any]()
    if closed_loop is not None and excitation.inject != "torque":
        S_inverse = [closed_loop(c, lines.excited / excitation.period).reference for c in configurations]
        path = experiment.as_simulated().controller.reference
        cycle = 1 if path is None else path.cycle_samples(excitation.rate_hz)
        references = {"inject": excitation.inject, "cycle_samples": cycle, "S_inverse": np.array(S_inverse)}
    # Ramp and hold are whole cycles, and the first and the last two references are at rest.
    ramp, hold = (cycle * math.ceil(round(t * excitation.rate_hz) / cycle) for t in (experiment.ramp, experiment.hold))
    ends = ramp, max(hold, 2 * cycle) if references else hold
    return Plan(
        configurations, inputs, *timing, lines.excited, R, lines.detection, *ends, robot.sliding(inputs), **references
    )
