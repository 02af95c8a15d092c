"""How fast and how close to the bound experiments are shared out.

    python scripts/bench_design.py

7920 random candidates with 12 parameters (the size of Wernholt and Lofberg's study, CDC 2007), 15 whole experiments:
CPU seconds, certified gap, and the efficiency of the whole experiments against the bound that no design can exceed.
"""

from __future__ import annotations

import time

import numpy as np

from elastid.arrays import FloatArray
from elastid.experiment.optimal import Criterion, Relaxed, relaxed, whole

CANDIDATES, PARAMETERS, EXPERIMENTS = 7920, 12, 15


def random_information(guesses: int, candidates: int, rank: int, seed: int = 0) -> FloatArray:
    """H (S, Q, d, d) of candidates that differ in size and direction, and a little between the guesses."""
    rng = np.random.default_rng(seed)
    J = rng.standard_normal((1, candidates, PARAMETERS, rank))
    J = J * np.exp(0.5 * rng.standard_normal((1, candidates, PARAMETERS, 1)))
    J = J + 0.3 * rng.standard_normal((guesses, candidates, PARAMETERS, rank))
    H: FloatArray = J @ np.swapaxes(J, -1, -2)
    return H


def bench(name: str, H: FloatArray, criterion: Criterion) -> tuple[Relaxed, float, float]:
    """The relaxed design, the efficiency of the whole experiments, CPU seconds; a line is printed."""
    start = time.process_time()
    shares = relaxed(H, criterion)
    between = time.process_time()
    numbers = whole(H, shares.weights, EXPERIMENTS, criterion)
    end = time.process_time()
    value = float(criterion.value(np.einsum("q,sqij->sij", numbers, H) / EXPERIMENTS))
    efficiency = float(np.exp(value - shares.bound))
    print(
        f"{name:30}  gap {shares.gap:.1e}  {between - start:5.2f} s    {EXPERIMENTS} whole: {100 * efficiency:5.1f} %  "
        f"{end - between:5.2f} s    {np.count_nonzero(shares.weights > 1e-6)} positions carry weight"
    )
    return shares, efficiency, end - start


def main() -> None:
    everything = np.eye(PARAMETERS)
    full, few = random_information(1, CANDIDATES, PARAMETERS), random_information(1, CANDIDATES, 3)
    bench("D, 7920 candidates", full, Criterion("D", everything))
    bench("D, 7920 candidates of rank 3", few, Criterion("D", everything))
    bench("D, 4 of the 12 parameters", full, Criterion("D", everything[:, :4]))
    bench("A, 7920 candidates", full, Criterion("A", everything))
    bench("E, 7920 candidates", full, Criterion("E", everything))
    robust = random_information(8, 1000, PARAMETERS)
    bench("D, mean of 8 guesses, 1000", robust, Criterion("D", everything))
    bench("D, worst of 8 guesses, 1000", robust, Criterion("D", everything, "worst"))


if __name__ == "__main__":
    main()
