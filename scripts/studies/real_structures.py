"""A real structure: modes of the steel subframe of `configs/real/steel_frame.yml` and the peaks of Welch's method.

    python scripts/studies/real_structures.py DATA

DATA: the file flexible_structure_dat.mat, whose source the study names.  The study runs as it is shipped, with that
path; peaks are those of the largest singular value of H1 by SciPy (segments of 2 s, Hann, 75 % overlap) that stand out
by a factor of 1.8 above 50 Hz, interpolated by a parabola through their logarithms.

Each of the 14 peaks has a mode within 0.3 % of its frequency (0.132 % the furthest, among 21 modes).  The last line
is one JSON object.
"""

import argparse
import json
import re
import tempfile
from pathlib import Path

import numpy as np
from scipy.io import loadmat
from scipy.signal import csd, find_peaks

from elastid.app.cli import run_command
from elastid.store.measured import read_modes

STUDY = Path(__file__).parents[2] / "configs" / "real" / "steel_frame.yml"
RATE_HZ, SEGMENT, LOWEST_HZ = 1024.0, 2048, 50.0


def welch_peaks(data: np.ndarray) -> np.ndarray:
    """Frequencies in Hz of the peaks of H1, from columns of two forces and all accelerations."""
    data = data - data.mean(axis=0)
    u, y = data[:, :2], data[:, 2:]

    def spectra(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        options = {"fs": RATE_HZ, "nperseg": SEGMENT, "noverlap": 3 * SEGMENT // 4}
        return np.array([[csd(p, q, **options)[1] for p in b.T] for q in a.T])

    inverse = np.linalg.inv(np.moveaxis(spectra(u, u), 2, 0))
    G = np.einsum("yuf,fuv->fyv", spectra(y, u), inverse)
    level = np.log(np.linalg.svd(G, compute_uv=False)[:, 0])
    step = RATE_HZ / SEGMENT
    tops = np.array([k for k in find_peaks(level, prominence=0.6)[0] if k * step > LOWEST_HZ])
    a, b, c = level[tops - 1], level[tops], level[tops + 1]
    return (tops + (a - c) / (2 * (a - 2 * b + c))) * step


def main(path: Path) -> dict[str, object]:
    """The table, printed and asserted."""
    peaks = welch_peaks(loadmat(path)["flexible_structure_dat"])
    with tempfile.TemporaryDirectory() as folder:
        text = re.sub(r"path: \S+\.mat", f"path: {path.resolve()}", STUDY.read_text("utf-8"))
        study = Path(folder) / "study.yml"
        study.write_text(text, "utf-8")
        run = Path(folder) / "run"
        assert run_command(["run", str(study), "--run", str(run), "-q", "--set", "report.formats=[]"]) == 0
        (modes,) = read_modes(run / "modes.h5")
    gap = np.array([np.min(np.abs(modes.freq_hz / f - 1)) for f in peaks])
    table = {"peaks": len(peaks), "modes": modes.n_modes, "furthest": round(float(gap.max()), 5)}
    assert np.all(gap < 0.003), (peaks, gap)
    return table


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("data", type=Path, nargs="?")
    parser.add_argument("--quick", action="store_true", help="the same; nothing is run without DATA")
    given = parser.parse_args()
    if given.data is None and not given.quick:
        parser.error("DATA: the file flexible_structure_dat.mat, whose source configs/real/steel_frame.yml names")
    print(json.dumps({"skipped": "no DATA was given"} if given.data is None else main(given.data)))
