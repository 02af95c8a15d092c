"""Hammer logs: how often clean ones are blamed, and faulty ones named.

    python scripts/studies/hammer_faults.py [--quick] [--logs 100] [--seed 0]

Logs of 2 to 8 hits 2 to 5 s apart, 5120 samples a second, half sines of 2 to 8 ms on 3 to 8 modes of 0.2 to 3 %
damping, 16 bits and 0.1 to 1 % of noise.  Each log is judged clean, and with each fault: a second blow 10 to 80 ms
later with 20 to 90 % of the force, an amplifier that ends at 50 to 90 % of the largest force, or of the largest
answer, a record that begins within its first hit, and a drift of one to ten times the rms of an answer.

100 logs: no clean one is blamed; all double hits, overloads of the force, wrong triggers and drifts are named, and 95 %
of the overloads of answers.  Asserted: at most 1 % of the
clean logs with each note, at least 90 % of each fault.  The last line is one JSON object.
"""

import argparse
import json

import numpy as np
from scipy.signal import lfilter

from elastid.frf.hits import hit_notes
from elastid.record import Configuration, Record

RATE_HZ = 5120.0
FAULTS = {
    "double": "frf/hits", "force": "overload", "answer": "overload", "trigger": "frf/hits", "drift": "drift",
}  # fmt: skip


def force_of(rng: np.random.Generator, double: bool) -> tuple[np.ndarray, int, int]:
    """The force (n,), the first sample of its first hit and that hit's length."""
    hits, gap = int(rng.integers(2, 9)), rng.uniform(2, 5)
    n, width = int((hits * gap + 1) * RATE_HZ), int(rng.uniform(0.002, 0.008) * RATE_HZ)
    u, pulse = np.zeros(n), np.sin(np.pi * (np.arange(width) + rng.uniform(0.1, 0.9)) / width) ** 1.5
    pulse = np.nan_to_num(pulse)
    starts = [int((0.3 + hit * gap + rng.uniform(0, 0.3)) * RATE_HZ) for hit in range(hits)]
    for start in starts:
        u[start : start + width] += rng.uniform(0.6, 1.4) * pulse
    if double:
        start = starts[int(rng.integers(hits))]
        late = start + max(width + 10, int(rng.uniform(0.01, 0.08) * RATE_HZ))
        u[late : late + width] += rng.uniform(0.2, 0.9) * u[start : start + width].max() * pulse
    return u, starts[0], width


def answers(rng: np.random.Generator, u: np.ndarray) -> np.ndarray:
    """Accelerations (n, 2) of a random structure."""
    y = np.zeros((len(u), 2))
    for _ in range(int(rng.integers(3, 9))):
        omega, zeta = 2 * np.pi * rng.uniform(10, 800), 10 ** rng.uniform(np.log10(0.002), np.log10(0.03))
        pole = np.exp(omega / RATE_HZ * (1j * np.sqrt(1 - zeta**2) - zeta))
        x = lfilter([0, pole.imag], [1, -2 * pole.real, abs(pole) ** 2], u)
        y += np.outer(x, rng.normal(size=2))
    return y


def log(rng: np.random.Generator, fault: str | None) -> Record:
    """A record of hits with a fault, or none."""
    u, start, width = force_of(rng, fault == "double")
    y, level = answers(rng, u), 10 ** rng.uniform(-3, -2)
    if fault == "drift":
        y[:, 0] += rng.uniform(1, 10) * y[:, 0].std() * np.linspace(0, 1, len(y))
    x = np.column_stack([u, y])
    x += level * x.std(axis=0) * rng.normal(size=x.shape)
    if fault == "trigger":
        x = x[start + int(rng.uniform(0.35, 0.65) * width) :]
    limit = np.abs(x).max(axis=0)
    if fault in ("force", "answer"):
        channels = [0] if fault == "force" else [1, 2]
        limit[channels] *= rng.uniform(0.5, 0.9)
        x = np.clip(x, -limit, limit)
    step = limit / 2**15
    x = np.round(x / step) * step
    bench = Configuration("bench", np.zeros(0))
    names = ("hammer",), ("a", "b"), ("acceleration",) * 2
    return Record("log", bench, 0, 0, RATE_HZ, len(x), *names, x[:, :1], x[:, 1:], is_periodic=False)


def main(logs: int, seed: int) -> dict[str, object]:
    """The table, printed and asserted."""
    named = dict.fromkeys(FAULTS, 0)
    blamed = dict.fromkeys(FAULTS.values(), 0)
    for k in range(logs):
        for code in {note.code for note in hit_notes([log(np.random.default_rng(seed + k), None)])}:
            blamed[code] += 1
        for fault, code in FAULTS.items():
            found = {note.code for note in hit_notes([log(np.random.default_rng(seed + k), fault)])}
            named[fault] += code in found
    table = {"logs": logs, "blamed": blamed, "named": {fault: round(n / logs, 3) for fault, n in named.items()}}
    assert all(count <= 0.01 * logs for count in blamed.values()), table
    assert all(count >= 0.9 * logs for count in named.values()), table
    return table


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="10 logs")
    parser.add_argument("--logs", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    print(json.dumps(main(10 if asked.quick else asked.logs, asked.seed)))
