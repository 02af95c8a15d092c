"""The `excitation` section of a study, and the lines that it plans."""

from dataclasses import replace
from typing import Annotated, Literal, TypeAlias

import numpy as np

from elastid.base.section import Key, section
from elastid.base.units import Frequency, JointTorque, Time
from elastid.excitation.grids import Grid, Lines, Orthogonal, grid_lines, user_lines, with_detection

Phases: TypeAlias = Literal["random", "schroeder", "newman", "optimised", "linear-sweep", "log-sweep", "prbs"]
Signal: TypeAlias = Literal["torque", "position", "velocity", "acceleration"]
Injected: TypeAlias = Literal["torque", "velocity", "position"]
OneTorque: TypeAlias = JointTorque | tuple[JointTorque, ...] | Literal["limits"]
AskedTorque: TypeAlias = OneTorque | tuple[tuple[JointTorque, ...], ...]

_SWEEPS = ("linear-sweep", "log-sweep", "prbs")


@section
class MultisineSpec:
    """Orthogonal multisines, in torque, at every motor: n_u experiments make a realisation."""

    # fmt: off
    rate_hz: Annotated[Frequency, Key("Sampling rate of controller and log.", "rate of the robot controller; keep "
        "band_hz below a fifth of it, where the zero-order hold hardly attenuates.", above=0)]
    period: Annotated[Time, Key("Period of the multisine; DFT lines are 1/period apart.", "at least four lines within "
        "the width 2 zeta f0 of each resonance; 10 s are typical, and the robot time is proportional.", above=0)]
    band_hz: Annotated[tuple[Frequency, Frequency], Key("Lowest and highest excited frequency.", "from a fifth of the "
        "first antiresonance to twice the highest mode of the model; wider bands leave less torque per "
        "line.", above=0, rising=True)]
    torque_rms: Annotated[AskedTorque, Key("Root mean square of the link-side torque (N for a sliding joint): one "
        "number, or one per motor. `limits` uses the limits of the robot. A list of lists gives several amplitudes for "
        "every configuration. Torques that violate a limit are lowered.", "more torque improves the ratio to noise and "
        "dry friction; two amplitudes, [[200, 60], [100, 30]], show whether responses depend on amplitude.")]
    grid: Annotated[Grid, Key("Grid of the excited lines: `full`, `odd` (detects even nonlinearities), `odd-odd` (1, "
        "5, 9 ...), `odd-random` (odd with random gaps, detects odd nonlinearities too), `quasi-log`, `odd-quasi-log` "
        "(spacing by `ratio`), or `lines`.", "`odd` separates even distortion such as friction and backlash from the "
        "response; `full` for nearly linear robots; quasi-logarithmic for bands of more than two decades.")] = "odd"
    group: Annotated[int, Key("Number of consecutive odd lines of which the grid odd-random omits a random one.",
        "3 to 5; smaller values detect odd distortion at more lines and leave fewer excited lines.", least=2,
        most=100)] = 4
    ratio: Annotated[float, Key("Ratio of neighbouring lines of a quasi-logarithmic grid.", "larger values give fewer "
        "lines with more power; at 1.05, each resonance with damping ratio of at least 0.025 contains a "
        "line.", above=1)] = 1.05
    lines: Annotated[tuple[int, ...], Key("Excited lines of the grid `lines`, as multiples of 1/period.",
        "to avoid mains frequency or harmonics of the gear, for example.")] = ()
    margin: Annotated[float, Key("Margin to every limit of the robot, as a fraction of the limit.", "larger for an "
        "uncertain robot model, which predicts the movement; 0.1 covers errors of ten percent in the "
        "masses.", least=0, below=1)] = 0.1
    flat: Annotated[Signal | Literal["information"], Key("Quantity with equal predicted amplitude at all lines, in "
        "closed loop with the nominal model. `torque`: injected torque. `position`, `velocity`, `acceleration`: motion "
        "of the motor, reduced near resonances (10 % tolerance). `information`: D-optimal spectrum for the parameters "
        "of the fit.", "`torque` needs no model; `acceleration` shifts power to lines with a small response; "
        "`information` gives the smallest intervals if the parameters are roughly known.")] = "torque"
    least: Annotated[float, Key("Minimum power per line with flat: information, as a fraction of a flat torque "
        "spectrum.", "larger for uncertain nominal parameters, so that a shifted mode is still excited; 0.1 is a third "
        "of the amplitude.", above=0, most=1)] = 0.1
    power: Annotated[float, Key("Exponent of frequency in the amplitude of the lines.", "positive for more torque at "
        "high resonances, negative for limited position or friction at low frequencies.")] = 0.0
    spectrum: Annotated[tuple[tuple[Frequency, float], ...], Key("Relative amplitude as (frequency, amplitude) points, "
        "linear on log-log axes.", "for a spectrum of your own, such as a notch at a resonance of the cell; torque_rms "
        "scales it.", above=0)] = ()
    phases: Annotated[Phases, Key("Phases of the lines: `random`, or `optimised` for low peaks. With one realisation "
        "also `schroeder`, `newman`, `linear-sweep`, `log-sweep` or `prbs` (band-limited).", "`optimised` (crest "
        "factor 1.4 to 1.9 instead of 3.2) if limits are active; `random` averages distortion over realisations "
        "without bias.")] = "random"
    orthogonal: Annotated[Orthogonal, Key("Input matrix of the experiments in a realisation: `dft`, `hadamard` (2, 4, "
        "8 ... motors) or `zippered` (separate lines per motor, exchanged between experiments).",
        "`hadamard` for equal peaks in all experiments; `zippered` if motors must not share lines, with n_u times "
        "fewer lines per motor.")] = "dft"
    inject: Annotated[Injected, Key("Quantity that the robot accepts from outside: `torque`, or the `velocity` or "
        "`position` reference that gives the acting torque the planned spectrum.", "`position` for robots that accept "
        "position references or corrections only; then describe experiment.simulated.controller.reference. "
        "`velocity` opens the position loop.")] = "torque"
    compress: Annotated[tuple[Signal, ...], Key("Signals whose peaks optimised phases reduce.", "name the signal with "
        "the active limit, mostly velocity or acceleration; several signals share the "
        "reduction.", filled=True)] = ("torque",)
    # fmt: on

    def __post_init__(self) -> None:
        samples, high, (first, *next_hz) = self.period * self.rate_hz, self.band_hz[1], self.amplitudes
        torques = [rms if isinstance(rms, tuple) else (rms,) for rms in (first, *next_hz)]
        is_free, is_sweep = self.flat == "information", self.phases in _SWEEPS
        key = f"phases: {self.phases}" if is_sweep else "power and spectrum"
        faults = (
            (samples > 1e8, f"period: {self.period:g} s at {self.rate_hz:g} Hz are {samples:.3g} samples, more than a "
                "record can hold (1e+08); shorten the period or lower rate_hz"),  # a day at 1 kHz
            (abs(samples - round(samples)) > 1e-6 * samples, f"a period of {self.period:g} s is {samples:.6g} samples "
                f"at {self.rate_hz:g} Hz, not a whole number; take {round(samples) / self.rate_hz:.9g} s"),
            (high >= self.rate_hz / 2, f"band_hz: {high:g} Hz is not below half the sampling rate "
                f"({self.rate_hz / 2:g} Hz); lower band_hz or raise rate_hz"),
            (any(rms != "limits" and not rms > 0 for torque in torques for rms in torque),
                f"torque_rms is {self.torque_rms}; it must be positive for every motor"),
            (len({*torques}) < len(torques),
                "torque_rms lists an amplitude twice, and each counts once; leave one out"),
            ((self.grid == "lines") != bool(self.lines),
                "grid: lines and a list under lines go together; give both or neither"),
            (is_sweep and self.grid not in ("full", "odd"),
                f"{self.phases} needs all lines or all odd lines of a band. Set grid to full or odd"),
            (not is_free and self.least != 0.1, "least belongs to flat: information; set that, or leave least out"),
            (is_free and bool(next_hz), f"flat: information finds spectra of one amplitude, torque_rms lists "
                f"{len(torques)}; give one of them, or take another flat"),
            (is_free and bool(self.power or self.spectrum or is_sweep),
                f"flat: information finds the spectrum itself; leave out {key}, or take another flat"),
        )  # fmt: skip
        for is_wrong, text in faults:
            if is_wrong:
                raise ValueError(text)

    @property
    def amplitudes(self) -> tuple[OneTorque, ...]:
        """The amplitudes at which every configuration is measured, mostly one."""
        amplitudes = self.torque_rms
        if not isinstance(amplitudes, tuple):
            return (amplitudes,)
        lists = tuple(item for item in amplitudes if isinstance(item, tuple))
        if not lists:
            return (tuple(item for item in amplitudes if not isinstance(item, tuple)),)
        return tuple(item[0] if len(item) == 1 else item for item in lists)

    def at_amplitude(self, index: int) -> "MultisineSpec":
        """Return multisine with one of its amplitudes, counted from 1."""
        return self if len(self.amplitudes) == 1 else replace(self, torque_rms=self.amplitudes[index - 1])

    @property
    def period_samples(self) -> int:
        """N, samples per period."""
        return round(self.period * self.rate_hz)

    def realisation_refusal(self, realisations: int) -> str:
        """Return why so many realisations make no sense with these phases; empty where they do."""
        if realisations < 2 or self.phases in ("random", "optimised"):
            return ""
        return (
            f"{self.phases} gives the same signal in each of {realisations} realisations, which does not show "
            "nonlinear distortion; set experiment.realisations: 1, or phases: random or optimised"
        )


def planned_lines(excitation: MultisineSpec, seed: int) -> Lines:
    """Return the lines of a study, its detection lines drawn from the seed; StudyError if the band has no line."""
    N = excitation.period_samples
    if excitation.grid == "lines":
        lines = user_lines(excitation.lines, excitation.band_hz, excitation.rate_hz, N)
    else:
        lines = grid_lines(excitation.grid, excitation.band_hz, excitation.rate_hz, N, excitation.ratio)
    if excitation.grid != "odd-random":
        return Lines(lines, np.zeros(0, np.int64))
    return with_detection(lines, excitation.group, np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(0,))))
