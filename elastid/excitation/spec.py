"""The `excitation` section of a study, and the lines that it plans."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Literal, TypeAlias

import numpy as np

from elastid.base.section import Key, section
from elastid.base.units import Frequency, JointTorque, Time
from elastid.excitation.grids import Grid, Lines, chosen_lines, grid_lines, with_detection
from elastid.excitation.phases import Orthogonal

Phases: TypeAlias = Literal["random", "schroeder", "newman", "optimised", "linear-sweep", "log-sweep", "prbs"]
Signal: TypeAlias = Literal["torque", "position", "velocity", "acceleration"]
OneTorque: TypeAlias = JointTorque | tuple[JointTorque, ...] | Literal["limits"]
AskedTorque: TypeAlias = OneTorque | tuple[tuple[JointTorque, ...], ...]

_SWEEPS = ("linear-sweep", "log-sweep", "prbs")


@section
class MultisineSpec:
    """Orthogonal multisines, in torque, at every motor: n_u experiments make a realisation."""

    # fmt: off
    rate_hz: Annotated[Frequency, Key("Sampling rate of the controller and the log.", "that of the robot controller; "
        "band_hz must stay below half of it, better below a fifth, where the torque that the drive holds still follows "
        "the multisine.", above=0)]
    period: Annotated[Time, Key("Period of the multisine; the lines are 1/period apart.", "longer for finer lines: a "
        "resonance of f0 and damping ratio zeta is 2 zeta f0 wide and needs four lines or more in it. 10 s are usual; "
        "time grows with it.", above=0)]
    band_hz: Annotated[tuple[Frequency, Frequency], Key("Lowest and highest excited frequency.", "from a fifth of the "
        "first antiresonance to twice the highest mode that the model has; wider bands spread the same torque over "
        "more lines.", above=0, rising=True)]
    torque_rms: Annotated[AskedTorque, Key("Root mean square of the torque on the link side, one number for all motors "
        "or one for each, in N where a joint slides, lowered where a limit of the robot is in the way; or `limits`: as "
        "much as each motor may have; or a list of such lists, amplitudes at which every configuration is measured in "
        "all its realisations.", "more raises the ratio to noise and to dry friction, until a limit or a "
        "nonlinear spring is in the way; `limits` takes the most that position, velocity, acceleration and torque "
        "allow. Two amplitudes, [[200, 60], [100, 30]], show if responses depend on the amplitude, and if the "
        "law that `gears` finds holds at both.")]
    grid: Annotated[Grid, Key("Grid of the excited lines: `full` (every line), `odd` (odd multiples of 1/period: even "
        "nonlinearities then fall between the lines), `odd-odd` (1, 5, 9 ...), `odd-random` (odd, some left out: odd "
        "nonlinearities show there), `quasi-log` and `odd-quasi-log` (each about `ratio` times the last), or `lines`. "
        "`full` gives the most lines, where nonlinearity is small.", "`odd` is the default since gear friction and "
        "backlash then show as distortion apart from the response; `full` where nonlinearity is small gives the most "
        "lines, quasi-logarithmic ones where the band spans more than two decades.")] = "odd"
    group: Annotated[int, Key("Number of consecutive odd lines of which the grid odd-random leaves one out at random.",
        "smaller where more lines should show odd distortion, at the price of lines that carry the response; 3 to 5 "
        "are usual. 4 leaves three quarters of the odd lines.")] = 4
    ratio: Annotated[float, Key("Ratio of neighbouring lines of a quasi-logarithmic grid.", "larger for fewer lines "
        "with more power each; above 1.1 a lightly damped resonance falls between two lines. 1.05 gives 47 lines a "
        "decade, and each resonance with a damping ratio of 0.025 or more a line within its width.")] = 1.05
    lines: Annotated[tuple[int, ...], Key("Excited lines of the grid `lines`, as multiples of 1/period.",
        "for a choice of your own, such as lines that avoid the mains or a harmonic of the gear.")] = ()
    margin: Annotated[float, Key("Margin to every limit of the robot, the part of it that stays free.", "more where "
        "the robot's file is rough, since the nominal model predicts the movement; 0 uses all of each limit. 0.1 "
        "covers errors of the masses of ten percent.")] = 0.1
    flat: Annotated[Signal | Literal["information"], Key("Quantity that has, closed loop and nominal robot, the same "
        "amplitude at all lines: the injected `torque`, the motor's `position`, `velocity` or `acceleration` (less "
        "around a resonance, wherever within 10 % it is), or the `information` that a little more power would bring "
        "about the parameters of the fit: then no other spectrum of the same torques gives more about them (by the "
        "criterion of `design`; each configuration has its own).", "`torque` needs no model and is the default; "
        "`acceleration` moves power from the resonances to where the response is weak; `information` where the "
        "parameters are nearly known, for the smallest intervals.")] = "torque"
    least: Annotated[float, Key("Part of a flat torque's power that every line keeps under flat: information.",
        "more where the nominal numbers are rough, so that a mode elsewhere than expected is still excited; less gains "
        "some percent of standard deviation. 0.1 keeps a third of the amplitude.")] = 0.1
    power: Annotated[float, Key("Exponent of frequency in the amplitude of the lines.", "positive where high "
        "resonances need more, negative where position limits allow and low lines drown in friction; 0 leaves the "
        "spectrum as `flat` says.")] = 0.0
    spectrum: Annotated[tuple[tuple[Frequency, float], ...], Key("Relative amplitude as (frequency, amplitude) points, "
        "straight lines on log-log axes.", "for a shape of your own, such as a notch at a resonance of the cell; only "
        "ratios count, torque_rms sets the level.")] = ()
    phases: Annotated[Phases, Key("Phases of the lines: `random`, or `optimised` for low peaks; with realisations: 1 "
        "also `schroeder`, `newman`, `linear-sweep`, `log-sweep` or `prbs` (band-limited).", "`optimised` halves the "
        "peaks (crest factor about 1.4 to 1.9 in place of 3.2) where limits bind; `random` stays the default, since "
        "averages over realisations then remove distortion without bias.")] = "random"
    orthogonal: Annotated[Orthogonal, Key("Difference between the experiments of a realisation: `dft`, `hadamard` (2, "
        "4, 8 ... motors), or `zippered` (each motor its own lines, exchanged from experiment to experiment). "
        "`hadamard` for the same peaks in every experiment.", "`hadamard` for the same peaks in every experiment; "
        "`zippered` where motors must not share lines, with n_u times fewer lines each.")] = "dft"
    compress: Annotated[tuple[Signal, ...], Key("Signals whose peaks optimised phases lower.", "name the signal whose "
        "limit binds, velocity or acceleration mostly; several share the effort and each is lowered "
        "less.")] = ("torque",)
    # fmt: on

    def __post_init__(self) -> None:
        samples = self.period * self.rate_hz
        if samples > 1e8:  # a day at 1 kHz
            raise ValueError(
                f"period: {self.period:g} s at {self.rate_hz:g} Hz are {samples:.3g} samples, more than a record can "
                "hold (1e+08); shorten the period or lower rate_hz"
            )
        if abs(samples - round(samples)) > 1e-6 * samples:
            raise ValueError(
                f"a period of {self.period:g} s is {samples:.6g} samples at {self.rate_hz:g} Hz, not a whole number; "
                f"take {round(samples) / self.rate_hz:.9g} s"
            )
        high = self.band_hz[1]
        if high >= self.rate_hz / 2:
            raise ValueError(
                f"band_hz: {high:g} Hz is not below half the sampling rate ({self.rate_hz / 2:g} Hz); "
                "lower band_hz or raise rate_hz"
            )
        for rms in self.amplitudes:
            if rms != "limits" and any(not value > 0 for value in (rms if isinstance(rms, tuple) else (rms,))):
                raise ValueError(f"torque_rms is {rms}; it must be positive for every motor")
        if len(set(self.amplitudes)) < len(self.amplitudes):
            raise ValueError("torque_rms lists an amplitude twice, and each counts once; leave one out")
        if any(not f > 0 or not a > 0 for f, a in self.spectrum):
            raise ValueError("spectrum: frequencies and amplitudes must be positive")
        self._check_grid_and_phases()
        self._check_information()

    def _check_grid_and_phases(self) -> None:
        if not 2 <= self.group <= 100:
            raise ValueError(f"group is {self.group}; one of 2 or more lines is left out, commonly of 3 to 5")
        if not self.ratio > 1:
            raise ValueError(f"ratio is {self.ratio:g}; each line is so many times the last, take more than 1")
        if not 0 <= self.margin < 1:
            raise ValueError(f"margin is {self.margin:g}; it is the part of each limit that stays free, 0 to 1")
        if (self.grid == "lines") != bool(self.lines):
            raise ValueError("grid: lines and a list under lines go together; give both or neither")
        if self.phases in _SWEEPS and self.grid not in ("full", "odd"):
            raise ValueError(f"phases: {self.phases} needs all lines or all odd lines of a band; set grid: full or odd")
        if not self.compress:
            raise ValueError("compress is empty; name the signals whose peaks matter, for example [torque, velocity]")

    def _check_information(self) -> None:
        if not 0 < self.least <= 1:
            raise ValueError(
                f"least is {self.least:g}; with flat: information it is the part of a flat torque's power that every "
                "line keeps, above 0 (a line without power has no response) and up to 1"
            )
        if self.flat != "information" and self.least != 0.1:
            raise ValueError("least belongs to flat: information; set that, or leave least out")
        if self.flat == "information" and len(self.amplitudes) > 1:
            raise ValueError(
                f"flat: information finds spectra of one amplitude, torque_rms lists {len(self.amplitudes)}; give "
                "one of them, or take another flat"
            )
        if self.flat == "information" and (self.power or self.spectrum or self.phases in _SWEEPS):
            key = f"phases: {self.phases}" if self.phases in _SWEEPS else "power and spectrum"
            raise ValueError(f"flat: information finds the spectrum itself; leave out {key}, or take another flat")

    @property
    def amplitudes(self) -> tuple[OneTorque, ...]:
        """The amplitudes at which every configuration is measured, mostly one."""
        given = self.torque_rms
        if not isinstance(given, tuple):
            return (given,)
        lists = tuple(item for item in given if isinstance(item, tuple))
        if not lists:
            return (tuple(item for item in given if not isinstance(item, tuple)),)
        return tuple(item[0] if len(item) == 1 else item for item in lists)

    def at_amplitude(self, level: int) -> MultisineSpec:
        """Multisine with one of its amplitudes, counted from 1."""
        return self if len(self.amplitudes) == 1 else replace(self, torque_rms=self.amplitudes[level - 1])

    @property
    def period_samples(self) -> int:
        """N, samples per period."""
        return round(self.period * self.rate_hz)

    def realisation_refusal(self, realisations: int) -> str:
        """Why so many realisations make no sense with these phases; empty where they do."""
        if realisations < 2 or self.phases in ("random", "optimised"):
            return ""
        return (
            f"{self.phases} gives the same signal in each of {realisations} realisations, which does not show "
            "nonlinear distortion; set experiment.realisations: 1, or phases: random or optimised"
        )


def planned_lines(excitation: MultisineSpec, seed: int) -> Lines:
    """The lines of a study, those left free for detection drawn from its seed; StudyError where the band holds none."""
    N = excitation.period_samples
    if excitation.grid == "lines":
        chosen = chosen_lines(excitation.lines, excitation.band_hz, excitation.rate_hz, N)
        return Lines(chosen, np.zeros(0, np.int64))
    lines = grid_lines(excitation.grid, excitation.band_hz, excitation.rate_hz, N, excitation.ratio)
    if excitation.grid != "odd-random":
        return Lines(lines, np.zeros(0, np.int64))
    return with_detection(lines, excitation.group, np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(0,))))
