"""Quality: how well a frequency response was measured, line by line, and what of it is not linear."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from elastid.arrays import BoolArray, FloatArray, frozen


@dataclass(frozen=True)
class Levels:
    """RMS amplitudes (K, n_y) of the outputs at freq_hz (K,), in `quantity`, and of the noise (K, n_y) in them.

    amplitude is that of the mean over periods, in the mean square over all experiments; noise is part of it.
    """

    freq_hz: FloatArray
    amplitude: FloatArray
    noise: FloatArray

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        for field in fields(self):
            object.__setattr__(self, field.name, frozen(getattr(self, field.name)))


@dataclass(frozen=True)
class Quality:
    """Of the same F lines as the response, but for even and odd.

    coherence (F, n_y, n_u) and multiple_coherence (F, n_y), of single periods.  singular_values (F, min(n_y, n_u)) of
    G, largest first.  input_singular_values (F, n_u) of the experiments' inputs, each input relative to its RMS: their
    ratio is the condition of the input matrix.  input_noise (F, n_u) and output_noise (F, n_y): variance in one period.
    excited: the outputs.  stochastic (F, n_y): RMS amplitude of the stochastic nonlinear distortion in them, or None.
    even, odd: what nonlinearities of even and odd order leave at lines that were not excited, Y - G U, or None.
    """

    coherence: FloatArray
    multiple_coherence: FloatArray
    singular_values: FloatArray
    input_singular_values: FloatArray
    input_noise: FloatArray
    output_noise: FloatArray
    excited: Levels
    stochastic: FloatArray | None = None
    even: Levels | None = None
    odd: Levels | None = None

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        for name in (*LINE_ARRAYS, "stochastic"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, frozen(getattr(self, name)))

    @property
    def condition(self) -> FloatArray:
        """Condition (F,) of the input matrix, each input relative to its RMS; inf where it is singular."""
        largest, smallest = self.input_singular_values[:, 0], self.input_singular_values[:, -1]
        with np.errstate(over="ignore"):
            condition: FloatArray = np.divide(largest, smallest, out=np.full(len(largest), np.inf), where=smallest > 0)
        return condition

    def lines(self, keep: BoolArray) -> Quality:
        """The same on some of the response's lines; keep (F,) is True where a line stays."""
        cut = {name: getattr(self, name)[keep] for name in LINE_ARRAYS}
        excited = Levels(*(getattr(self.excited, field.name)[keep] for field in fields(Levels)))
        stochastic = None if self.stochastic is None else self.stochastic[keep]
        return replace(self, **cut, excited=excited, stochastic=stochastic)


LINE_ARRAYS = (
    "coherence",
    "multiple_coherence",
    "singular_values",
    "input_singular_values",
    "input_noise",
    "output_noise",
)
