"""How long do modes take? 28 outputs, 2 inputs, 4000 lines, 20 modes with 1 % of noise, polynomials to order 60.

    python scripts/benchmarks/modes.py [--quick]

CPU time of `estimate_modes` on one core; all modes must be found to a thousandth of their frequency.  --quick: 800
lines to order 30.  The last line is one JSON object.  At full size 3.3 s were found, on a busy machine of two cores.
"""

# One BLAS thread must be asked for before NumPy is loaded.
# ruff: noqa: E402
import os

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import argparse
import json
import time

import numpy as np

from elastid.modal.estimate import estimate_modes
from elastid.record import Configuration
from elastid.response import Covariance, FrequencyResponse

OUTPUTS, INPUTS, MODES, HIGHEST_HZ = 28, 2, 20, 200.0


def response(lines: int) -> tuple[FrequencyResponse, np.ndarray]:
    """A response with noise, and the true frequencies (n,)."""
    rng = np.random.default_rng(3)
    natural_hz, zeta = np.sort(rng.uniform(5, 190, MODES)), 10 ** rng.uniform(-2.5, -1.7, MODES)
    shapes = rng.normal(size=(OUTPUTS, MODES))
    freq_hz = np.arange(1, lines + 1) * HIGHEST_HZ / lines
    omega, natural = 2 * np.pi * freq_hz[:, None], 2 * np.pi * natural_hz
    modal = -(omega**2) / (natural**2 - omega**2 + 2j * zeta * natural * omega)
    G = np.einsum("ir,fr,jr->fij", shapes, modal, shapes[:INPUTS])
    std = 0.01 * float(np.sqrt(np.mean(np.abs(G) ** 2)))
    G = G + std * (rng.normal(size=G.shape) + 1j * rng.normal(size=G.shape)) / np.sqrt(2)
    names = tuple("ab"), tuple(f"y{i}" for i in range(OUTPUTS))
    covariance = Covariance(np.full(G.shape, std**2), np.inf)
    bench = Configuration("bench", np.zeros(0))
    return FrequencyResponse(freq_hz, G, *names, "acceleration", bench, noise=covariance), natural_hz


def main(quick: bool) -> dict[str, object]:
    """The time, printed; and that the modes are those of the structure."""
    measured, natural_hz = response(800 if quick else 4000)
    estimate_modes(measured.lines(measured.freq_hz < 20), max_order=4)  # loads SciPy
    begin = time.process_time()
    modes = estimate_modes(measured, max_order=30 if quick else 60)
    seconds = time.process_time() - begin
    found = np.array([np.min(np.abs(modes.freq_hz / f - 1)) for f in natural_hz])
    assert modes.n_modes == MODES
    assert np.all(found < 1e-3)
    return {"lines": measured.n_lines, "cpu_s": round(seconds, 2), "largest_relative_error": float(found.max())}


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="800 lines to order 30")
    print(json.dumps(main(parser.parse_args().quick)))
