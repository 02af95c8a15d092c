"""Bias of the estimators against closed forms, and their variances against Monte Carlo, at full size.

    python scripts/studies/estimator_errors.py [--quick]

Bias: one input and one output, 4e6 noisy pairs; ARI 1 - exp(-s_u), HAR 1 / (1 - exp(-s_y)),
H1 s_u / (1 + s_u), H2 1 + 1 / s_y.  Variance: 6 inputs and outputs, correlated noise on all of them, 3
realisations of 6 orthogonal experiments; estimated over true variance of each of the 36 elements, noise and total.
The last line is one JSON object.
"""

import argparse
import json

import numpy as np

from elastid.base.arrays import ComplexArray
from elastid.excitation.multisine import orthogonal_set
from elastid.frf.covariance import equation_error, noise_covariance, total_covariance, total_error
from elastid.frf.experiment_blocks import Block, MeanSpectra
from elastid.frf.methods import METHODS, h1, h2, harmonic_mean

LEVELS_DB = ((3, 6), (6, 6), (8, 6), (10, 10), (20, 20))


def complex_normal(rng: np.random.Generator, *shape: int) -> ComplexArray:
    """Circular, of variance 1."""
    return (rng.standard_normal(shape) + 1j * rng.standard_normal(shape)) / np.sqrt(2)


def biases(snr_y_db: float, snr_u_db: float, parts: int) -> dict[str, tuple[float, float]]:
    """Found and expected bias in dB of each estimator, from parts of 4e5 pairs."""
    rng, M, F = np.random.default_rng(0), 1000, 400
    s_y, s_u = 10 ** (snr_y_db / 10), 10 ** (snr_u_db / 10)
    sums = dict.fromkeys(("arithmetic", "harmonic", "h1", "h2"), 0.0)
    nothing = np.zeros((F, 2, 2))
    for _ in range(parts):
        U, Y = (1 + complex_normal(rng, M, F, 1, 1) / np.sqrt(s) for s in (s_u, s_y))
        block = Block(
            U[:, :, 0].transpose(1, 2, 0), Y[:, :, 0].transpose(1, 2, 0), None, np.ones(M), np.zeros((F, 1)), 1
        )
        sums["arithmetic"] += (Y / U).mean().real
        sums["harmonic"] += np.mean(1 / harmonic_mean(Y / U)).real
        data = MeanSpectra((block,), nothing, 0)
        sums["h1"] += h1(data).G.mean().real
        sums["h2"] += h2(data).G.mean().real
    mean = {name: value / parts for name, value in sums.items()}
    found = mean | {"harmonic": 1 / mean["harmonic"]}
    expected = {
        "arithmetic": 1 - np.exp(-s_u),
        "harmonic": 1 / (1 - np.exp(-s_y)),
        "h1": s_u / (1 + s_u),
        "h2": 1 + 1 / s_y,
    }
    return {name: (20 * np.log10(found[name]), 20 * np.log10(expected[name])) for name in expected}


def simulated(rng: np.random.Generator, G: ComplexArray, mix: np.ndarray) -> MeanSpectra:
    """3 realisations of n orthogonal experiments of 4 periods at F lines, G (F, n, n), noise mix (2n, 2n) w."""
    (F, n, _), P = G.shape, 4
    blocks, S_Z = [], np.zeros((F, 2 * n, 2 * n), dtype=complex)
    for _ in range(3):
        U = np.moveaxis(orthogonal_set(np.ones((F, n)), rng), 0, 2)
        Z = np.concatenate([G @ U, U], axis=1) + mix @ complex_normal(rng, P, F, 2 * n, n)
        mean = Z.mean(axis=0)
        V = np.moveaxis(Z - mean, 0, 3).reshape(F, 2 * n, n * P)
        S_Z += V @ np.swapaxes(V, 1, 2).conj()
        blocks.append(Block(mean[:, n:], mean[:, :n], U, np.full(n, float(P)), np.zeros((F, n)), 1))
    return MeanSpectra(tuple(blocks), S_Z, 3 * n * (P - 1))


def variance_ratios(runs: int) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Estimated over true variance (n_y, n_u), noise and total, of a 6 x 6 plant that is the same at 2000 lines."""
    rng, n, F = np.random.default_rng(1), 6, 2000
    G = np.broadcast_to(complex_normal(np.random.default_rng(2), 1, n, n) + np.eye(n), (F, n, n))
    mix = 0.05 * (np.eye(2 * n) + 0.5 * np.tri(2 * n))
    sums = {method: np.zeros((3, n, n)) for method in METHODS}
    for _ in range(runs):
        data = simulated(rng, G, mix)
        for method, (error, noise, total) in sums.items():
            found = METHODS[method](data)
            of_total = total_error(data, found)
            assert of_total is not None
            # A bias is no variance.
            error += np.mean(np.abs(found.G - found.G.mean(axis=0)) ** 2, axis=0) * F / (F - 1)
            C_V = equation_error(data, found.G)
            noise += noise_covariance(data, found, C_V).variance.mean(axis=0)
            total += total_covariance(data, found, *of_total).variance.mean(axis=0)
    return {method: (noise / error, total / error) for method, (error, noise, total) in sums.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="a small part of the size")
    parts, runs = (1, 2) if parser.parse_args().quick else (10, 100)
    worst = 0.0
    print(f"{'SNR y, u in dB':<16}" + "".join(f"{name:>24}" for name in ("arithmetic", "harmonic", "h1", "h2")))
    for snr_y_db, snr_u_db in LEVELS_DB:
        found = biases(snr_y_db, snr_u_db, parts)
        worst = max(worst, *(abs(a - b) for a, b in found.values()))
        cells = "".join(f"{f'{a:+.4f} ({b:+.4f})':>24}" for a, b in found.values())
        print(f"{f'{snr_y_db}, {snr_u_db}':<16}{cells}")
    print(f"worst deviation {worst:.4f} dB of {4e5 * parts:.0e} pairs\n")
    spread = {}
    for method, (noise, total) in variance_ratios(runs).items():
        spread[method] = [round(float(x), 4) for ratio in (noise, total) for x in (ratio.min(), ratio.max())]
        print(f"{method:<22}noise variance over true {noise.min():.4f} to {noise.max():.4f}, "
              f"total {total.min():.4f} to {total.max():.4f}")  # fmt: skip
    print(f"\n{json.dumps({'worst_bias_deviation_db': round(worst, 4), 'variance_over_true': spread})}")


if __name__ == "__main__":
    main()
