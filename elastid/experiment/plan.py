"""Plan: configurations x realisations x experiments x periods, and the torque spectra to inject."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from elastid.arrays import ComplexArray, FloatArray, IntArray, frozen
from elastid.record import Configuration


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
class Plan:
    """What to run, sampled at rate_hz with period_samples per period.

    lines (F,): excited DFT lines, frequency = line * rate_hz / period_samples.
    R (Q, M, E, F, n_u): torque amplitude spectrum, link-side Nm: r(t) = Re sum_f R_f exp(2 pi j f t).
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
        return self.lines * (self.rate_hz / self.period_samples)

    @property
    def experiments(self) -> tuple[Experiment, ...]:
        """All runs, configuration by configuration."""
        _, M, E, _, _ = self.R.shape
        return tuple(Experiment(c, m, e) for c in self.configurations for m in range(M) for e in range(E))

    def torque(self, experiment: Experiment) -> FloatArray:
        """One period of the torque to inject (period_samples, n_u), link-side Nm."""
        q = [c.name for c in self.configurations].index(experiment.configuration.name)
        spectrum = np.zeros((self.period_samples // 2 + 1, len(self.inputs)), dtype=np.complex128)
        spectrum[self.lines] = self.R[q, experiment.realisation, experiment.experiment]
        torque: FloatArray = np.fft.irfft(spectrum, n=self.period_samples, axis=0).astype(np.float64)
        return torque * (self.period_samples / 2)

    @property
    def robot_time_s(self) -> float:
        """How long the robot runs, transients included, movements between configurations not."""
        return len(self.experiments) * (self.periods + self.transient_periods) * self.period_samples / self.rate_hz
