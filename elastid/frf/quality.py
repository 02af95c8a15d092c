"""Coherences, singular values and noise of one configuration's measurement; a word on inputs hardly excited."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from elastid.arrays import ComplexArray, FloatArray
from elastid.frf.blocks import Block, Gathered
from elastid.quality import Levels, Quality

# An input less than 20 dB above the noise of its mean at half of the lines is hardly excited: it costs accuracy.
_HARDLY = 100.0
# Beyond this condition one combination of the inputs has less than a hundredth of the power of another.
_WORST_CONDITION = 10.0


def measured_quality(freq_hz: FloatArray, data: Gathered, G: ComplexArray) -> Quality:
    """Quality of G (F, n_y, n_u), its nonlinear levels excepted."""
    every, scatter = data.every, data.scatter
    n_y = G.shape[1]
    Z = np.concatenate([every.Y, every.U], axis=1)
    S = (Z * every.periods) @ np.swapaxes(Z, 1, 2).conj() + scatter.S_Z
    noise = np.einsum("fii->fi", scatter.S_Z).real / scatter.dof
    coherence, multiple = coherences(S, n_y)
    amplitude = np.sqrt(np.mean(np.abs(every.Y) ** 2, axis=2))
    return Quality(
        coherence=coherence,
        multiple_coherence=multiple,
        singular_values=np.asarray(np.linalg.svd(G, compute_uv=False), dtype=np.float64),
        input_singular_values=input_singular_values(every.U),
        input_noise=noise[:, n_y:],
        output_noise=noise[:, :n_y],
        excited=Levels(freq_hz, amplitude, np.sqrt(noise[:, :n_y] * np.mean(1 / every.periods))),
    )


def input_singular_values(U: ComplexArray) -> FloatArray:
    """Of U (F, n_u, E) / sqrt(E), each input relative to its RMS over lines and experiments; largest first (F, n_u)."""
    rms = np.sqrt(np.mean(np.abs(U) ** 2, axis=(0, 2)))
    rms[rms == 0] = 1.0
    power = np.linalg.eigvalsh(U @ np.swapaxes(U, 1, 2).conj() / (U.shape[2] * np.outer(rms, rms)))
    values: FloatArray = np.sqrt(np.maximum(power[:, ::-1], 0.0))
    return values


def coherences(S: ComplexArray, n_y: int) -> tuple[FloatArray, FloatArray]:
    r"""Ordinary (F, n_y, n_u) and multiple coherence (F, n_y) from the spectra S (F, n_y + n_u, ...) of [Y; U].

    .. math:: \gamma_{ij}^2 = \frac{|S_{y_i u_j}|^2}{S_{y_i y_i} S_{u_j u_j}}, \quad
              \gamma_i^2 = \frac{S_{y_i u} S_{uu}^{-1} S_{u y_i}}{S_{y_i y_i}}
    """
    power = np.einsum("fii->fi", S).real
    yu, uu = S[:, :n_y, n_y:], S[:, n_y:, n_y:]
    both = power[:, :n_y, None] * power[:, None, n_y:]
    ordinary = np.divide(np.abs(yu) ** 2, both, out=np.zeros(both.shape), where=both > 0)
    explained = np.sum((yu @ np.linalg.inv(uu)) * yu.conj(), axis=2).real
    multiple = np.divide(explained, power[:, :n_y], out=np.zeros(explained.shape), where=power[:, :n_y] > 0)
    return np.clip(ordinary, 0.0, 1.0), np.clip(multiple, 0.0, 1.0)


def input_words(where: str, inputs: Sequence[str], every: Block, quality: Quality) -> list[str]:
    """A word for every input that was hardly excited, and one where the inputs moved nearly together."""
    power = np.mean(np.abs(every.U) ** 2, axis=2)
    noise = quality.input_noise * np.mean(1 / every.periods)
    weak = power < _HARDLY * noise
    words = [
        f"configuration {where}: input {name} was hardly excited: less than 20 dB above its noise at "
        f"{int(weak[:, i].sum())} of {len(weak)} lines, so that its column of G is uncertain; raise its torque"
        for i, name in enumerate(inputs)
        if weak[:, i].mean() > 0.5
    ]
    if np.median(quality.condition) > _WORST_CONDITION:
        words.append(
            f"configuration {where}: the inputs move nearly together: the condition of the input matrix, each input "
            f"relative to its RMS, is {np.median(quality.condition):.3g} at the median line (1 is best); take "
            "orthogonal experiments"
        )
    return words
