"""Do intervals of a friction law hold the truth, and are its numbers as good as the levels allow?

    python scripts/studies/friction_law.py [--quick] [--draws 500]

Levels of the published law of a large robot's joint (Bittencourt, Wernholt, Sander-Tavallaey and Brogardh, IROS 2010;
12 speeds, 4 loads, 5 temperatures: 240 levels), with noise of 2 % of the median level that is drawn again each time.
All twelve numbers are free. Of every number: the share of 95 % intervals that hold the truth, and the scatter of the
estimates over the Cramer-Rao bound at the truth; of all draws: how many of the starts reach the best optimum. The share
over all numbers must lie within 94 and 96 %, the scatter within 0.9 and 1.15 of the bound, and every start must arrive.
The last line is one JSON object.

Found at full size: 95.7 % of the intervals, 94.2 to 97.4 % of each number's; scatter 0.95 to 1.03 of the bound.
"""

# One BLAS thread must be asked for before NumPy is loaded.
# ruff: noqa: E402
import os

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import argparse
import json
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))
from plants.published_friction import TERMS, drawn, published_levels

from elastid.friction_study.laws import StaticLaw
from elastid.friction_study.levels import Levels
from elastid.friction_study.stribeck import fit_curve

COVERAGE = (0.94, 0.96)
SCATTER = (0.9, 1.15)


def law_of(levels: Levels) -> StaticLaw:
    """The law with all twelve numbers."""
    return StaticLaw(levels, fit_curve(levels, TERMS), ())


def main() -> None:
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--quick", action="store_true")
    options.add_argument("--draws", type=int, default=500)
    given = options.parse_args()
    draws = 4 if given.quick else given.draws
    exact = published_levels()
    truth = law_of(exact)
    bound = np.sqrt(np.diag(truth.covariance))
    laws = [law_of(drawn(exact, seed)) for seed in range(draws)]
    true = np.array(list(truth.values.values()))
    holds = np.array([
        [low < t < high for (_, _, low, high), t in zip(law.intervals.values(), true, strict=True)] for law in laws
    ])  # fmt: skip
    estimates = np.array([list(law.values.values()) for law in laws])
    scatter = np.sqrt(np.mean((estimates - true) ** 2, axis=0)) / bound
    arrived = sum(law.fit.hits for law in laws) / sum(law.fit.starts for law in laws)
    print(f"{'number':32}{'truth':>12}{'95 % holds':>12}{'scatter / bound':>17}")
    for i, name in enumerate(truth.names):
        print(f"{name:32}{true[i]:12.4g}{holds[:, i].mean():12.3f}{scatter[i]:17.3f}")
    coverage = float(holds.mean())
    print(f"{coverage:.1%} of all intervals hold the truth; {arrived:.1%} of the starts reach the best optimum")
    assert arrived == 1.0
    if not given.quick:
        assert COVERAGE[0] < coverage < COVERAGE[1]
        assert SCATTER[0] < scatter.min() < scatter.max() < SCATTER[1]
    found = {"draws": draws, "coverage": coverage, "scatter": [scatter.min(), scatter.max()], "arrived": arrived}
    print(json.dumps(found))


if __name__ == "__main__":
    main()
