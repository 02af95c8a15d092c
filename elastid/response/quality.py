"""Quality of a measured response: coherence, singular values, noise, and levels of distortion."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np

from elastid.base.arrays import BoolArray, FloatArray, frozen_value
from elastid.base.label import labelled

# Arrays of a Quality with the lines of its response.
LINE_ARRAYS = (
    "coherence",
    "multiple_coherence",
    "singular_values",
    "input_singular_values",
    "input_noise",
    "output_noise",
)


@frozen_value
class Levels:
    """RMS amplitudes (K, n_y) of the outputs at freq_hz (K,), in `quantity`, and of the noise (K, n_y) in them.

    amplitude is that of the mean over periods, in the mean square over all experiments; noise is part of it.
    """

    freq_hz: FloatArray = labelled("frequency")
    amplitude: FloatArray = labelled("RMS amplitude of the outputs", "{output_unit}", "freq_hz outputs")
    noise: FloatArray = labelled("standard deviation of the noise in it", "{output_unit}", "freq_hz outputs")


@frozen_value
class Quality:
    """Quality of a response at its F lines; even and odd have lines of their own.

    coherence (F, n_y, n_u) and multiple_coherence (F, n_y), of single periods.  singular_values (F, min(n_y, n_u)) of
    G, largest first.  input_singular_values (F, n_u) of the experiments' inputs, each input relative to its RMS: their
    ratio is the condition of the input matrix.  input_noise (F, n_u) and output_noise (F, n_y): variance in one period.
    excited: the outputs.  stochastic (F, n_y): RMS amplitude of the stochastic nonlinear distortion in them, or None.
    even, odd: Y - G U at lines that were not excited, from nonlinearities of even and odd order, or None.
    """

    coherence: FloatArray = labelled("coherence of one output and one input", "", "freq_hz outputs inputs")
    multiple_coherence: FloatArray = labelled("coherence of one output and all inputs", "", "freq_hz outputs")
    singular_values: FloatArray = labelled("singular values of G, largest first", "{unit}", "freq_hz rank")
    input_singular_values: FloatArray = labelled("singular values of the inputs over their RMS", "", "freq_hz rank")
    input_noise: FloatArray = labelled("noise variance in one period", "({units_of_inputs})^2", "freq_hz inputs")
    output_noise: FloatArray = labelled("noise variance in one period", "({output_unit})^2", "freq_hz outputs")
    excited: Levels
    stochastic: FloatArray | None = labelled("RMS distortion", "{output_unit}", "freq_hz outputs", default=None)
    even: Levels | None = None
    odd: Levels | None = None

    @property
    def condition(self) -> FloatArray:
        """Condition (F,) of the input matrix, each input relative to its RMS; inf where it is singular."""
        largest, smallest = self.input_singular_values[:, 0], self.input_singular_values[:, -1]
        with np.errstate(over="ignore"):
            return np.asarray(np.divide(largest, smallest, out=np.full(len(largest), np.inf), where=smallest > 0))

    def lines(self, keep: BoolArray) -> Quality:
        """The same on some of the response's lines; keep (F,) is True where a line stays."""
        cut = {name: getattr(self, name)[keep] for name in LINE_ARRAYS}
        excited = Levels(*(getattr(self.excited, field.name)[keep] for field in fields(Levels)))
        stochastic = None if self.stochastic is None else self.stochastic[keep]
        return replace(self, **cut, excited=excited, stochastic=stochastic)
