"""How fast and how close to the bound experiments are shared out.

    python scripts/benchmarks/design.py [--quick]

7920 random candidates with 12 parameters (the size of Wernholt and Lofberg's study, CDC 2007), 15 whole experiments:
CPU seconds, certified gap, and the efficiency of the whole experiments against the bound that no design can exceed;
every gap is at most 1e-3 but for D over the worst guess. At the end the same as one line of JSON.
"""

from __future__ import annotations

import argparse
import json
import time

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.design.optimal import MAX_GAP, DesignCriterion, RelaxedDesign, relaxed_design, whole_experiments

CANDIDATES, PARAMETERS, EXPERIMENTS = 7920, 12, 15


def random_information(guesses: int, candidates: int, rank: int, seed: int = 0) -> FloatArray:
    """H (S, Q, d, d) of candidates that differ in size and direction, and a little between the guesses."""
    rng = np.random.default_rng(seed)
    J = rng.standard_normal((1, candidates, PARAMETERS, rank))
    J = J * np.exp(0.5 * rng.standard_normal((1, candidates, PARAMETERS, 1)))
    J = J + 0.3 * rng.standard_normal((guesses, candidates, PARAMETERS, rank))
    H: FloatArray = J @ np.swapaxes(J, -1, -2)
    return H


def bench(name: str, H: FloatArray, criterion: DesignCriterion) -> tuple[RelaxedDesign, float, float, float]:
    """The relaxed design, the efficiency of the whole experiments, CPU seconds of the shares and of both."""
    start = time.process_time()
    shares = relaxed_design(H, criterion)
    between = time.process_time()
    numbers = whole_experiments(H, shares.weights, EXPERIMENTS, criterion)
    end = time.process_time()
    value = float(criterion.value(np.einsum("q,sqij->sij", numbers, H) / EXPERIMENTS))
    efficiency = float(np.exp(value - shares.bound))
    print(
        f"{name:30}  gap {shares.gap:.1e}  {between - start:5.2f} s    {EXPERIMENTS} whole: {100 * efficiency:5.1f} %  "
        f"{end - between:5.2f} s    {np.count_nonzero(shares.weights > 1e-4)} positions carry weight"
    )
    return shares, efficiency, between - start, end - start


def main(quick: bool) -> dict[str, dict[str, float]]:
    """Every case by name: certified gap, efficiency of the whole experiments, CPU seconds."""
    Q = 60 if quick else CANDIDATES
    everything = np.eye(PARAMETERS)
    full, few = random_information(1, Q, PARAMETERS), random_information(1, Q, 3)
    robust = random_information(8, 40 if quick else 1000, PARAMETERS)
    cases = {
        f"D, {Q} candidates": (full, DesignCriterion("D", everything)),
        f"D, {Q} candidates of rank 3": (few, DesignCriterion("D", everything)),
        f"D, {Q}, 4 of the 12 parameters": (full, DesignCriterion("D", everything[:, :4])),
        f"A, {Q} candidates": (full, DesignCriterion("A", everything)),
        f"E, {Q} candidates": (full, DesignCriterion("E", everything)),
        f"E, {Q}, 4 of the 12 parameters": (full, DesignCriterion("E", everything[:, :4])),
        f"E, {robust.shape[1]}, worst of 3 guesses": (robust[:3], DesignCriterion("E", everything, "worst")),
        f"D, {robust.shape[1]}, mean of 8 guesses": (robust, DesignCriterion("D", everything)),
        f"D, {robust.shape[1]}, worst of 8 guesses": (robust, DesignCriterion("D", everything, "worst")),
    }
    results = {}
    for name, (H, criterion) in cases.items():
        shares, efficiency, shares_s, cpu_s = bench(name, H, criterion)
        results[name] = {"gap": shares.gap, "efficiency": efficiency, "cpu_s": cpu_s, "shares_s": shares_s}
        assert shares.gap <= MAX_GAP or (criterion.letter, criterion.over) == ("D", "worst"), (name, shares.gap)
    return results


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="fewer candidates")
    print(json.dumps(main(parser.parse_args().quick)))
