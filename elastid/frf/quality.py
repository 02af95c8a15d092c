"""A measured response and its quality: coherences, singular values, noise; notes on weak inputs and outputs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.base.note import Note
from elastid.frf.experiment_blocks import MeanSpectra
from elastid.frf.lines import MIN_SNR
from elastid.frf.matrices import inverse, semidefinite_eigenvalues, singular_values, squared_magnitude
from elastid.record import Motion, Record
from elastid.response import FrequencyResponse, Levels, Quality


@dataclass(frozen=True)
class Limits:
    """Thresholds of a weak channel.

    False alarms of 300 clean logs: input-barely-excited 0, output-barely-moved 0, inputs-move-together 0.
    """

    input_snr: float = 100.0  # power of an input over the noise of its mean (20 dB), below which it costs accuracy
    weak_share: float = 0.5  # of the lines at which a channel is weak, from which on it is reported
    condition: float = 10.0  # of the inputs: beyond, one combination has less than a hundredth of the power of another


LIMITS = Limits()


def measured_response(
    first: Record, quantity: Motion, freq_hz: FloatArray, G: ComplexArray, **estimated: Any
) -> FrequencyResponse:
    """G (F, n_y, n_u) at freq_hz (F,), outputs as `quantity`; first: of records that agree in all but their signals.

    estimated: further fields of the response.
    """
    return FrequencyResponse(
        freq_hz=freq_hz,
        G=G,
        inputs=first.inputs,
        outputs=first.outputs,
        quantity=quantity,
        configuration=first.configuration,
        rate_is_known=first.rate_is_known,
        sliding=first.sliding,
        input_units=first.input_units,
        hold=first.images,
        **estimated,
    )


def measured_quality(freq_hz: FloatArray, data: MeanSpectra, G: ComplexArray) -> Quality:
    """Quality of G (F, n_y, n_u), its nonlinear levels excepted."""
    S_Z, n_y = data.scatter.S_Z, G.shape[1]
    spread = np.einsum("fii->fi", S_Z).real
    noise = spread / data.scatter.dof
    output_power, of_periods = data.output_powers
    coherence, multiple = coherences(
        of_periods + spread[:, :n_y],
        data.of_periods("Y") + S_Z[:, :n_y, n_y:],
        data.of_periods("U") + S_Z[:, n_y:, n_y:],
    )
    amplitude = np.sqrt(output_power / len(data.periods))
    return Quality(
        coherence=coherence,
        multiple_coherence=multiple,
        singular_values=singular_values(G),
        input_singular_values=relative_singular_values(data.UU / len(data.periods)),
        input_noise=noise[:, n_y:],
        output_noise=noise[:, :n_y],
        excited=Levels(freq_hz, amplitude, np.sqrt(noise[:, :n_y] * np.mean(1 / data.periods))),
    )


def relative_singular_values(S_U: ComplexArray) -> FloatArray:
    """Roots (F, n_u) of the eigenvalues of the inputs' spectra S_U (F, n_u, n_u), each over its RMS; largest first."""
    rms = np.sqrt(np.einsum("fii->fi", S_U).real.mean(axis=0))
    rms[rms == 0] = 1.0
    return np.sqrt(semidefinite_eigenvalues(S_U / np.outer(rms, rms)))


def coherences(yy: FloatArray, yu: ComplexArray, uu: ComplexArray) -> tuple[FloatArray, FloatArray]:
    r"""Ordinary (F, n_y, n_u) and multiple coherence (F, n_y) from power yy (F, n_y) and spectra S_yu and S_uu.

    .. math:: \gamma_{ij}^2 = \frac{|S_{y_i u_j}|^2}{S_{y_i y_i} S_{u_j u_j}}, \quad
              \gamma_i^2 = \frac{S_{y_i u} S_{uu}^{-1} S_{u y_i}}{S_{y_i y_i}}
    """
    both = yy[:, :, None] * np.einsum("fii->fi", uu).real[:, None, :]
    ordinary = np.divide(squared_magnitude(yu), both, out=np.zeros(both.shape), where=both > 0)
    response = yu @ inverse(uu)
    explained = np.sum(response.real * yu.real + response.imag * yu.imag, axis=2)
    multiple = np.divide(explained, yy, out=np.zeros(explained.shape), where=yy > 0)
    return np.clip(ordinary, 0.0, 1.0), np.clip(multiple, 0.0, 1.0)


def output_notes(outputs: Sequence[str], quality: Quality) -> list[Note]:
    """A note on every output that barely moved."""
    excited = quality.excited
    weak = excited.amplitude**2 <= MIN_SNR * excited.noise**2
    return [
        Note(
            "output-barely-moved",
            f"output {name} barely moved: not 6 dB above its noise at {int(weak[:, i].sum())} of {len(weak)} lines, so "
            "that its row of G is mostly noise; check its channel, or raise the torque",
        )
        for i, name in enumerate(outputs)
        if weak[:, i].mean() > LIMITS.weak_share
    ]


def input_notes(inputs: Sequence[str], data: MeanSpectra, quality: Quality) -> list[Note]:
    """A note on every input that was barely excited, and one where the inputs moved nearly together."""
    power = np.einsum("fii->fi", data.UU).real / len(data.periods)
    noise = quality.input_noise * np.mean(1 / data.periods)
    weak = power < LIMITS.input_snr * noise
    notes = [
        Note(
            "input-barely-excited",
            f"input {name} was barely excited: less than 20 dB above its noise at {int(weak[:, i].sum())} of "
            f"{len(weak)} lines, so that its column of G is uncertain; raise its torque",
        )
        for i, name in enumerate(inputs)
        if weak[:, i].mean() > LIMITS.weak_share
    ]
    if np.median(quality.condition) > LIMITS.condition:
        notes.append(
            Note(
                "inputs-move-together",
                "the inputs move nearly together: the condition of the input matrix, each input relative to its RMS, "
                f"is {np.median(quality.condition):.3g} at the median line (1 is best); take orthogonal experiments",
            )
        )
    return notes
