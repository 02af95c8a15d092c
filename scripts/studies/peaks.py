"""Do the intervals of peaks hold frequency and damping as often as they say? Records of three masses on springs.

    python scripts/studies/peaks.py [--quick] [--draws 150] [--seed 100]

Each draw: two realisations of two experiments, periodic multisines on two shakers, three periods of 2048 samples at
256 Hz, forces and accelerations with sensor noise; the response by the arithmetic mean, its peaks without a model.
For each of the three modes: the share of the 95 % intervals that hold the true frequency, and damping, and the mean
square of error over standard deviation.  Every draw must show all three modes and no other; no share may be below 95 %
by more than chance explains in all but one of 2000 studies.
The last line is one JSON object with the numbers of the table.

150 draws: 94.0 to 95.3 % for the frequencies, 90.0 to 94.0 % for the damping; 400 others: 94.5 to 97.0 %, and 92.0 to
95.5 %.
"""

# One BLAS thread must be asked for before NumPy is loaded.
# ruff: noqa: E402
import os

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import argparse
import json

import numpy as np
from scipy.stats import binom

from elastid.base.arrays import FloatArray
from elastid.experiment.simulated.structure import shake, true_modes
from elastid.frf.estimate import estimate
from elastid.frf.peaks import Peak, peaks
from elastid.frf.spec import EstimatorSpec
from elastid.record import Configuration, Record

RATE_HZ, PERIOD, PERIODS = 256.0, 2048, 3
# A share of this or less is that of true intervals by chance once in 2000 studies.
STATED, CHANCE = 0.95, 5e-4


def peaks_of_draw(seed: int) -> tuple[Peak, ...]:
    """Peaks of the response of two realisations with noise of their own."""
    configuration, places = Configuration("bench", np.zeros(0)), ("1", "2", "3")
    records = []
    for m in range(2):
        for e, log in enumerate(shake(RATE_HZ, PERIOD, PERIODS, 2 * seed + m)):
            signals = (log.force, log.acceleration)
            quantities = ("acceleration",) * 3
            name = f"bench-r{m}-e{e}"
            records.append(Record(name, configuration, m, e, RATE_HZ, PERIOD, ("a", "b"), places, quantities, *signals))
    return peaks(estimate(records, EstimatorSpec(method="arithmetic")))


def deviations(found: tuple[Peak, ...]) -> FloatArray:
    """Errors of frequency and damping over their standard deviations (2, 3)."""
    natural, damping, _ = true_modes()
    truth = zip(found, natural / (2 * np.pi), damping, strict=True)
    return np.array([((p.freq_hz - f) / p.freq_std, (p.damping - d) / p.damping_std) for p, f, d in truth]).T


def main(draws: int, seed: int) -> dict[str, object]:
    """The table, printed and asserted."""
    found = [peaks_of_draw(seed + draw) for draw in range(draws)]
    counts = [len(each) for each in found]
    print(f"peaks found in {draws} draws: {min(counts)} to {max(counts)}")
    assert set(counts) == {3}
    z = np.array([deviations(each) for each in found])
    truth = np.array([true_modes()[0] / (2 * np.pi), true_modes()[1]])
    low, high = (np.array([[(p.freq95[i], p.damping95[i]) for p in each] for each in found]) for i in (0, 1))
    held = (np.swapaxes(low, 1, 2) < truth) & (truth < np.swapaxes(high, 1, 2))
    coverage, squares = held.mean(axis=0), np.mean(z**2, axis=0)
    print(f"{'mode':<12}{'quantity':<12}{'interval holds':>16}{'mean (error / std)^2':>24}")
    for i, name in enumerate(("frequency", "damping")):
        for k in range(3):
            print(f"{truth[0, k]:6.2f} Hz   {name:<12}{100 * coverage[i, k]:14.1f} %{squares[i, k]:24.2f}")
    fewest = binom.ppf(CHANCE, draws, STATED) / draws
    assert np.all(coverage >= fewest), f"less than {fewest:.3f}"
    return {"draws": draws, "coverage": coverage.tolist(), "mean_square": squares.tolist()}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="20 draws")
    parser.add_argument("--draws", type=int, default=150)
    parser.add_argument("--seed", type=int, default=100)
    asked = parser.parse_args()
    print(json.dumps(main(20 if asked.quick else asked.draws, asked.seed)))
