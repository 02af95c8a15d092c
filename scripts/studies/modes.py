"""Are modes modes? False ones in noise, found ones of random structures, and intervals of frequency and damping.

    python scripts/studies/modes.py [--quick] [--draws 100] [--seed 0] [--excitation multisine]

Random structures of 3 to 12 modes of 0.3 to 3 % damping, 512 samples a second, band to 0.4 of the rate; noise of 0.1 to
3 % of each output's rms.  multisine: two realisations of three periods of 8 s; random: 60 s, local_rational on lines
0.05 Hz apart; segments: the same by h1; sweep: a logarithmic one of 60 s for each input, which ends with its record, by
h1; hammer: six hits in 48 s, local_rational on lines 0.04 Hz apart.  Each response by `estimate`, its modes by
`estimate_modes`.

noise: records whose outputs are noise alone, 1 x 1 and 3 x 1.  found: share of the modes whose peak is above three
standard deviations of the response there.  false: modes that are none, over modes.  held: share of the 95 % intervals,
of modes that were found, that hold the true frequency and damping.  The last line is one JSON object.

Random noise is estimated as `auto` does, by the local rational method, whose model holds leakage; segments: the same
records by h1, whose intervals of frequency are too wide.  With seeds on which nothing was tuned:

    hammer, 24 draws, seed 100      noise 0 of 24, found 148 of 149, false 0, held 96.0 % (frequency), 96.0 % (damping)
    multisine, 24 draws, seed 100   noise 0 of 24, found 148 of 149, false 0, held 94.6 %, 92.6 %
    random, 24 draws, seed 100      noise 0 of 24, found all, false 0, held 96.7 %, 92.0 %
    random, 48 draws, seed 200      noise 0 of 48, found 369 of 369, false 0, held 95.7 %, 94.9 %
    sweep, 24 draws, seed 100       noise 0 of 24, found 142 of 142, false 0, held 93.3 %, 97.3 %
    segments, 12 draws, seed 100    noise 0 of 12, found 79 of 81, false 0, held 98.8 %, 96.2 %

Modes of one record have its noise in common, so that a share of 149 intervals is uncertain by 2 % and more: both
of random together hold 96.0 % and 94.0 %.
The assertions are the goals: of noise at most 1 %, found at least 98 %, false at most 1 %, held at least 92 % (a bound
for 95 % with that many modes, of which those of one record have noise in common).  Two runs of the table end in one:
random with seed 100, whose damping is held by 92.0 %, and segments, with 2 of 81 not found.
"""

import json
from collections.abc import Iterator
from dataclasses import dataclass

import study_run
import numpy as np
from scipy.linalg import hadamard
from scipy.signal import chirp

from elastid.base.arrays import ComplexArray, FloatArray, IntArray
from elastid.base.errors import DataError
from elastid.excitation.multisine import synthesise
from elastid.frf.estimate import estimate
from elastid.frf.spec import EstimatorSpec
from elastid.modal.estimate import estimate_modes
from elastid.modal.modes import Modes
from elastid.record import Configuration, Record
from elastid.response import Response

RATE_HZ, HIGHEST = 512.0, 0.4
BENCH = Configuration("bench", np.zeros(0))
SPECS = {
    "multisine": EstimatorSpec(),
    "random": EstimatorSpec(method="local_rational", resolution_hz=0.05),
    "segments": EstimatorSpec(method="h1"),
    "sweep": EstimatorSpec(method="h1"),
    "hammer": EstimatorSpec(method="local_rational", resolution_hz=0.04),
}


@dataclass(frozen=True)
class Structure:
    """Frequencies and dampings (n,), shapes (n_y, n); driven at the first n_u outputs."""

    freq_hz: FloatArray
    zeta: FloatArray
    shapes: FloatArray
    n_u: int

    @classmethod
    def draw(cls, rng: np.random.Generator, n_y: int, n_u: int) -> "Structure":
        """Draw modes with distances of at least two of their bandwidths."""
        n = int(rng.integers(3, 13))
        while True:
            freq_hz = np.sort(rng.uniform(8, 0.36 * RATE_HZ, n))
            zeta = 10 ** rng.uniform(np.log10(0.003), np.log10(0.03), n)
            width = 2 * freq_hz * zeta
            if np.all(np.diff(freq_hz) > width[:-1] + width[1:] + 1):
                return cls(freq_hz, zeta, rng.normal(size=(n_y, n)), n_u)

    def response(self, freq_hz: FloatArray) -> ComplexArray:
        """Return G (F, n_y, n_u), acceleration per force."""
        w, natural = 2 * np.pi * freq_hz[:, None], 2 * np.pi * self.freq_hz
        modal = -(w**2) / (natural**2 - w**2 + 2j * self.zeta * natural * w)
        return np.einsum("ir,fr,jr->fij", self.shapes, modal, self.shapes[: self.n_u])

    def peak(self) -> FloatArray:
        """Return |G| (n, n_y, n_u) of each single mode at its natural frequency."""
        shapes = self.shapes.T
        return np.abs(shapes[:, :, None] * shapes[:, None, : self.n_u]) / (2 * self.zeta[:, None, None])

    def motion(self, u: FloatArray) -> FloatArray:
        """Return outputs (n, n_y) for periodic forces (n, n_u)."""
        spectrum = np.fft.rfft(u, axis=0)
        freq_hz = np.maximum(np.fft.rfftfreq(len(u), 1 / RATE_HZ), 1e-9)
        return np.fft.irfft(np.einsum("fij,fj->fi", self.response(freq_hz), spectrum), len(u), axis=0)


def records(kind: str, structure: Structure, level: float, rng: np.random.Generator, noise_only: bool) -> list[Record]:
    """Simulate records of one excitation with noise on forces and outputs."""
    n_u, measured = structure.n_u, []
    for m, e, force, part in _forces(kind, n_u, rng):
        u, y = force[part], structure.motion(force)[part]
        scale, period = level * y.std(axis=0), len(u)
        y = (0 if noise_only else y) + scale * rng.normal(size=y.shape)
        if kind == "multisine":
            u, y = np.tile(u, (3, 1)), np.tile(y, (3, 1))
            y = y + scale * rng.normal(size=y.shape)
        u = u + 0.2 * level * u.std() * rng.normal(size=u.shape)
        names = tuple(f"u{j}" for j in range(n_u)), tuple(f"y{j}" for j in range(y.shape[1]))
        motion = (("acceleration",) * y.shape[1], u, y)
        record = Record(f"{m}{e}", BENCH, m, e, RATE_HZ, period, *names, *motion, is_periodic=kind == "multisine")
        measured.append(record)
    return measured


def _forces(kind: str, n_u: int, rng: np.random.Generator) -> Iterator[tuple[int, int, FloatArray, slice]]:
    """Yield realisation, experiment, force (n, n_u), and the slice of recorded samples."""
    if kind == "multisine":
        N = 4096
        lines = np.arange(32, int(HIGHEST * N))
        for m in range(2):
            X = np.exp(2j * np.pi * rng.random((len(lines), n_u)))
            for e, signs in enumerate(hadamard(n_u)):
                yield m, e, _signal(lines, X * signs, N), slice(None)
    elif kind in ("random", "segments"):
        N, L = int(60 * RATE_HZ), int(90 * RATE_HZ)
        lines = np.arange(10, int(0.42 * L))
        X = rng.normal(size=(len(lines), n_u)) + 1j * rng.normal(size=(len(lines), n_u))
        yield 0, 0, _signal(lines, X, L), slice(-N, None)
    elif kind == "sweep":
        N = int(60 * RATE_HZ)
        for e in range(n_u):
            u = np.zeros((N + int(30 * RATE_HZ), n_u))
            u[:N, e] = chirp(np.arange(N) / RATE_HZ, 4.0, 60, 0.42 * RATE_HZ, "logarithmic", phi=-90)
            yield 0, e, u, slice(0, N)
    else:
        hits, gap = 6, 8.0
        N, t = int(hits * gap * RATE_HZ), np.arange(int((hits * gap + 40) * RATE_HZ)) / RATE_HZ
        for e in range(n_u):
            u = np.zeros((len(t), n_u))
            for hit in range(hits):
                x = (t - (hit + 0.1) * gap - rng.uniform(0, 0.3)) / 0.004
                u[:, e] += rng.uniform(0.7, 1.3) * np.where((x > 0) & (x < 1), np.sin(np.pi * np.clip(x, 0, 1)), 0)
            yield 0, e, u, slice(0, N)


def _signal(lines: IntArray, spectrum: ComplexArray, N: int) -> FloatArray:
    x = synthesise(lines, spectrum, N)
    return x / x.std()


def modes_of(kind: str, structure: Structure, level: float, rng: np.random.Generator, noise_only: bool = False):
    """Estimate the response and its modes; no modes if the estimation fails or the response has no coherence."""
    response = estimate(records(kind, structure, level, rng, noise_only), SPECS[kind])
    try:
        return response, estimate_modes(response)
    except DataError:
        return response, None


def judge(structure: Structure, response: Response, modes: Modes | None):
    """Count strong, detected and false modes. Return also errors (n, 2) of frequency and damping in stds."""
    std = np.sqrt(response.uncertainty.variance)
    lines = np.clip(np.searchsorted(response.freq_hz, structure.freq_hz), 0, response.n_lines - 1)
    strong = np.any(structure.peak() > 3 * std[lines], axis=(1, 2))
    if modes is None:
        return int(strong.sum()), 0, 0, np.empty((0, 2))
    is_used, n_found, deviations = np.zeros(modes.n_modes, bool), 0, []
    for f, zeta, is_strong in zip(structure.freq_hz, structure.zeta, strong, strict=True):
        gap = np.abs(modes.freq_hz - f) + np.where(is_used, np.inf, 0.0)
        if len(gap) and gap.min() < f * zeta:
            k = int(np.argmin(gap))
            is_used[k] = True
            n_found += is_strong
            deviations.append(((modes.freq_hz[k] - f) / modes.freq_std[k], (modes.zeta[k] - zeta) / modes.zeta_std[k]))
    return int(strong.sum()), int(n_found), int(np.sum(~is_used)), np.array(deviations).reshape(-1, 2)


def main(draws: int, seed: int, kinds: list[str], quick: bool) -> dict[str, object]:
    """Print the table, and assert the limits."""
    table: dict[str, object] = {"draws": draws}
    for kind in kinds:
        counts, deviations, noise = np.zeros(3, int), [], 0
        for draw in range(draws):
            rng = np.random.default_rng(seed + draw)
            structure = Structure.draw(rng, *((1, 1), (3, 1), (4, 2))[draw % 3])
            level = 10 ** rng.uniform(-3, np.log10(0.03))
            *each, z = judge(structure, *modes_of(kind, structure, level, rng))
            counts += each
            deviations.append(z)
            if each[1] < each[0] or each[2]:
                print(f"  {kind} draw {draw}: {each}, noise {level:.4f}", flush=True)
            silent = modes_of(kind, Structure.draw(rng, *((1, 1), (3, 1))[draw % 2]), 0.1, rng, noise_only=True)[1]
            noise += silent is not None and silent.n_modes > 0
        z, (strong, found, false) = np.concatenate(deviations), counts.tolist()
        fractions = np.mean(np.abs(z) < 1.96, axis=0)
        rates = {"noise": noise / draws, "found": found / strong, "false": false / max(found, 1)}
        squares = np.mean(z**2, axis=0).round(3).tolist()
        table[kind] = {**rates, "modes": strong, "held": fractions.round(4).tolist(), "squares": squares}
        print(kind, json.dumps(table[kind]), flush=True)
        few = 2 if quick else 0  # of a quick run one or two modes are many percent
        assert noise <= max(0.01 * draws, few / 2)
        assert strong - found <= max(0.02 * strong, few)
        assert false <= max(0.01 * strong, few / 2)
        assert np.all(fractions > (0.85 if quick else 0.92))
    return table


if __name__ == "__main__":
    options = study_run.options(__doc__, "3 draws of two excitations", draws=100, seed=0, excitation=tuple(SPECS))
    kinds = options.excitation[:: 2 if options.quick else 1]
    print(json.dumps(main(3 if options.quick else options.draws, options.seed, kinds, options.quick)))
