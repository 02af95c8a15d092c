"""How low the crest factors are: optimised phases beside random ones, Schroeder's and the clipping algorithm.

    python scripts/benchmarks/excitation.py [--quick]

True peaks, 32 samples per cycle of the highest line. random: median of 300 draws; clipping: van der Ouderaa, Schoukens
and Renneboog, IEEE Trans. Instrumentation and Measurement 37 (1988) 145, best of 5 starts of 1000 steps. The orthogonal
set is judged by the worst of its 36 signals. drawn: as one of several realisations, which must differ. Times are CPU
seconds of one process with one BLAS thread. Fails where a crest factor is above its goal, or a set takes 10 s.
The last line is one JSON object with the numbers of the table.
"""

# One BLAS thread must be asked for before NumPy is loaded.
# ruff: noqa: E402
import os

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import argparse
import json
import time
from collections.abc import Callable

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray, IntArray
from elastid.excitation.grids import grid_lines, with_detection
from elastid.excitation.multisine import orthogonal_set
from elastid.excitation.phases import Signals, crest_factors, minimise_peaks, orthogonal_basis, schroeder

# Line 1 is 1 Hz.
N = 2000
GOALS = {
    "full 15": None,
    "full 31": 1.41,
    "full 64": 1.41,
    "full 100": 1.41,
    "odd 31": 1.41,
    "odd 100": 1.41,
    "odd-random to 400": 1.46,
    "band 41-140": 1.48,
    "quasi-log 1-400": 1.87,
    "full 31, 1/f": 1.20,
    "3 inputs, 100 lines, worst of 9": None,
    "6 inputs, 100 lines, worst of 36": 1.48,
}
MAX_SECONDS = 10.0


def lines_of(name: str) -> IntArray:
    """The lines of a case."""
    if name.startswith("full"):
        return grid_lines("full", (1, int(name.split()[1].rstrip(","))), N, N)
    if name.startswith("odd-random"):
        return with_detection(grid_lines("odd", (1, 400), N, N), 4, np.random.default_rng(0)).excited
    if name.startswith("odd"):
        return grid_lines("odd", (1, 2 * int(name.split()[1]) - 1), N, N)
    if name.startswith("band"):
        return grid_lines("full", (41, 140), N, N)
    return grid_lines("quasi-log", (1, 400), N, N, ratio=1.11)


def of_one(lines: IntArray, amplitude: FloatArray) -> Signals:
    """One signal with these amplitudes (F,)."""
    F = len(lines)
    rms = np.sqrt(np.sum(amplitude**2) / 2)
    return Signals(lines, amplitude[None, :, None].astype(complex), np.ones((F, 1, 1), complex), np.array([rms]))


def crest(lines: IntArray, amplitude: FloatArray, phases: FloatArray) -> float:
    """Of one signal with phases (F,)."""
    return float(crest_factors(lines, amplitude * np.exp(1j * phases)))


def clipped(lines: IntArray, amplitude: FloatArray, rng: np.random.Generator, steps: int) -> FloatArray:
    """Phases (F,) by clipping the signal and giving it its amplitudes back, the clip level rising on the way."""
    n = 16 * (int(lines[-1]) + 1)
    phases = 2 * np.pi * rng.random(len(lines))
    for step in range(steps):
        spectrum = np.zeros(n // 2 + 1, complex)
        spectrum[lines] = amplitude * np.exp(1j * phases)
        x = np.fft.irfft(spectrum, n)
        level = (0.75 + 0.2 * step / steps) * np.abs(x).max()
        phases = np.angle(np.fft.rfft(np.clip(x, -level, level))[lines])
    return phases


def timed(work: Callable[[], float]) -> tuple[float, float]:
    """A crest factor and the CPU seconds that it took."""
    start = time.process_time()
    value = work()
    return value, time.process_time() - start


def optimised(signals: Signals, is_alone: bool = True) -> float:
    """Worst crest factor of the signals."""
    _, S = signals.spectra(*minimise_peaks(signals, np.random.default_rng(0), is_alone))
    return float(crest_factors(signals.lines, S).max())


def single(name: str, quick: bool) -> dict[str, float]:
    """One row of the table."""
    lines = lines_of(name)
    amplitude = 1.0 / lines if name.endswith("1/f") else np.ones(len(lines))
    rng = np.random.default_rng(1)
    draws = [crest(lines, amplitude, 2 * np.pi * rng.random(len(lines))) for _ in range(300)]
    clip = min(
        crest(lines, amplitude, clipped(lines, amplitude, rng, 200 if quick else 1000))
        for _ in range(1 if quick else 5)
    )
    signals = of_one(lines, amplitude)
    normal, seconds = timed(lambda: optimised(signals))
    return {
        "lines": len(lines),
        "random": float(np.median(draws)),
        "schroeder": crest(lines, amplitude, schroeder(amplitude)),
        "clipping": clip,
        "optimised": normal,
        "drawn": optimised(signals, is_alone=False),
        "seconds": seconds,
    }


def of_set(n_u: int, F: int) -> dict[str, float]:
    """The worst of n_u^2 signals of an orthogonal set with F lines, all inputs flat."""
    lines = np.arange(1, F + 1)
    response = np.repeat(np.eye(n_u)[None], F, axis=0).astype(complex)

    def worst(U: ComplexArray) -> float:
        return float(crest_factors(lines, U.transpose(0, 2, 1)).max())

    rng = np.random.default_rng(1)
    basis = orthogonal_basis("dft", F, n_u)
    signals = Signals(lines, basis, response, np.full(n_u, np.sqrt(F / 2)))
    normal, seconds = timed(lambda: optimised(signals))
    return {
        "lines": F,
        "random": float(np.median([worst(orthogonal_set(np.ones((F, n_u)), rng)) for _ in range(100)])),
        "schroeder": worst(basis * np.exp(1j * schroeder(np.ones(F)))[:, None]),
        "clipping": float("nan"),
        "optimised": normal,
        "drawn": optimised(signals, is_alone=False),
        "seconds": seconds,
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="one start of clipping")
    quick = parser.parse_args().quick
    optimised(of_one(np.arange(1, 16), np.ones(15)))  # SciPy is loaded, FFT plans are made
    sets = {"6 inputs, 100 lines, worst of 36": (6, 100), "3 inputs, 100 lines, worst of 9": (3, 100)}
    columns = ("lines", "random", "schroeder", "clipping", "drawn", "optimised", "goal", "seconds")
    print(f"{'grid':34}" + "".join(f"{column:>10}" for column in columns), flush=True)
    rows: dict[str, dict[str, float]] = {}
    for name, goal in GOALS.items():
        row = rows[name] = of_set(*sets[name]) if name in sets else single(name, quick)
        numbers = [row[k] for k in ("random", "schroeder", "clipping", "drawn", "optimised")]
        cells = [f"{row['lines']}", *(f"{v:.3f}" for v in numbers), "" if goal is None else f"{goal:.2f}"]
        cells += [f"{row['seconds']:.2f}"]
        print(f"{name:34}" + "".join(f"{cell:>10}" for cell in cells), flush=True)
        assert goal is None or (row["optimised"] <= goal and row["seconds"] < MAX_SECONDS), (name, row)
    finite = {name: {k: None if v != v else round(v, 4) for k, v in row.items()} for name, row in rows.items()}
    print(json.dumps(finite))


if __name__ == "__main__":
    main()
