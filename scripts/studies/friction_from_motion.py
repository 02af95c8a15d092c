"""Do 95 % intervals of inertia and friction of one axis from any motion hold the truth, on rigs that differ?

    python scripts/studies/friction_from_motion.py [--quick] [--draws 300] [--seed 0] [--kinds lugre ...]

Outside rigs, each with equations and an integrator of its own here (leapfrog of 0.5 ms, all draws at once), under a PD
controller, for 60 s: half of the draws follow five sines, half go through points by trapezoids of speed with rests.

- lugre: bristles that bend by 1e-4 rad, a Stribeck effect of 30 % over 0.03 to 0.1 rad/s;
- cogging: a torque of 13 % of F_c that a harmonic of the motor's turns has;
- asymmetric: Coulomb and viscous friction that differ between the directions by up to 20 %;
- gravity: up to four times F_c over the angle;
- elastic: a gear's spring between motor and link (resonance 10 to 18 Hz), friction at the motor.

Inertia, friction and motions are drawn; the torque has white noise and noise that is correlated over 50 ms, each of 2 %
of its rms, the encoder 2^20 counts, the log 500 Hz. Of each kind: the share of draws that end as `misfit`, and of the
others the share of 95 % intervals that hold the truth. It must lie between 94 and 96 %, three of its own standard
deviations allowed for chance, where fewer than 90 % of the draws are misfits. The last line is one JSON object.

300 draws: misfits and coverage of the rest 0.7 % and 96.5 % (gravity), 0.3 % and 95.8 % (lugre), 0.3 % and 94.5 %
(asymmetric), 0.7 % and 95.4 % (cogging), each with a std of 0.5 to 0.8 %; of elastic axes 98.3 % are misfits, and all
intervals of the others hold the truth. Where directions that do not differ are taken in, 1 % of draws, their numbers
miss the truth.
"""

# One BLAS thread must be asked for before NumPy is loaded.
# ruff: noqa: E402
import os

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import argparse
import json
from dataclasses import dataclass
from typing import Any

import numpy as np

from elastid.base.arrays import FloatArray
from elastid.base.statistics import QUANTILE_95
from elastid.friction_study.motion import regress_motion
from elastid.friction_study.motion_signals import Motion

STEP_S, THINNED, DURATION_S, COUNTS, RATIO = 5e-4, 4, 60.0, 2**20, 100.0
NOISE, CORRELATED_S = 0.02, 0.05
KINDS = ("lugre", "cogging", "asymmetric", "gravity", "elastic")
# Of the 95 % intervals, those that must hold the truth, and standard deviations of chance beside it.
COVERED, CHANCE, MISFITS = (0.94, 0.96), 3.0, 0.9


@dataclass(frozen=True)
class Axes:
    """Axes of one kind, a draw each; SI, link side, all (draws,)."""

    kind: str
    inertia: FloatArray
    viscous: FloatArray
    coulomb: FloatArray
    uneven_viscous: FloatArray
    uneven_coulomb: FloatArray
    gravity_cos: FloatArray
    gravity_sin: FloatArray
    cogging: FloatArray
    harmonic: FloatArray
    phase: FloatArray
    stribeck_velocity: FloatArray
    link_share: FloatArray
    resonance: FloatArray

    @classmethod
    def drawn(cls, kind: str, draws: int, rng: np.random.Generator) -> "Axes":
        """Those of a kind."""

        def of(own: str, low: float, high: float) -> FloatArray:
            values = rng.uniform(low, high, draws)
            return values if kind == own else np.zeros(draws)

        inertia, coulomb = rng.uniform(4, 8, draws), rng.uniform(8, 25, draws)
        phase = rng.uniform(0, 2 * np.pi, draws)
        gravity = of("gravity", 1, 4) * coulomb
        return cls(
            kind, inertia, coulomb * rng.uniform(0.5, 1.5, draws), coulomb,
            of("asymmetric", -0.2, 0.2) * coulomb, of("asymmetric", -0.2, 0.2) * coulomb,
            gravity * np.cos(phase), gravity * np.sin(phase), 0.13 * coulomb if kind == "cogging" else np.zeros(draws),
            rng.choice([1.0, 2.0, 6.0], draws), phase, rng.uniform(0.03, 0.1, draws), of("elastic", 0.4, 0.7),
            2 * np.pi * rng.uniform(10, 18, draws),
        )  # fmt: skip

    def truth(self, draw: int) -> dict[str, float]:
        """By the names of a regression."""
        each = {
            "inertia": self.inertia, "viscous": self.viscous, "coulomb": self.coulomb,
            "directions.viscous": self.uneven_viscous, "directions.coulomb": self.uneven_coulomb,
            "gravity.cos": self.gravity_cos, "gravity.sin": self.gravity_sin,
        }  # fmt: skip
        return {name: float(values[draw]) for name, values in each.items()}


def references(draws: int, rng: np.random.Generator, duration_s: float) -> FloatArray:
    """Angles (n, draws) every STEP_S: sines in the first half of the draws, trapezoids of speed in the second."""
    t = np.arange(round(duration_s / STEP_S)) * STEP_S
    angle = np.empty((len(t), draws))
    for draw in range(draws):
        if draw < draws / 2:
            freq_hz, phase = rng.uniform(0.1, 1.5, 5), rng.uniform(0, 2 * np.pi, 5)
            size = rng.uniform(0.1, 0.4, 5) / freq_hz**0.7
            angle[:, draw] = size @ np.sin(2 * np.pi * np.outer(freq_hz, t) + phase[:, None])
        else:
            angle[:, draw] = _trapezoids(rng, len(t))
    return angle


def _trapezoids(rng: np.random.Generator, n: int) -> FloatArray:
    """Angles (n,): moves at drawn speeds to drawn points, with rests."""
    speeds, q = [np.zeros(200)], 0.0
    while sum(map(len, speeds)) < n:
        goal, speed, acceleration = rng.uniform(-0.8, 0.8), np.exp(rng.uniform(*np.log([0.1, 1.2]))), rng.uniform(3, 6)
        speed = min(speed, np.sqrt(abs(goal - q) * acceleration))
        ramp_s, travel = speed / acceleration, abs(goal - q)
        t = np.arange(0, ramp_s + travel / speed, STEP_S)
        trapezoid = np.minimum(speed, acceleration * np.minimum(t, t[-1] - t))
        speeds += [np.sign(goal - q) * trapezoid, np.zeros(int(rng.uniform(0, 0.5) / STEP_S))]
        q += np.sign(goal - q) * trapezoid.sum() * STEP_S
    velocity = np.concatenate(speeds)[:n]
    window = np.hanning(81) / np.hanning(81).sum()  # 40 ms of jerk
    return np.asarray(np.cumsum(np.convolve(velocity, window, "same")) * STEP_S)


def simulated(axes: Axes, rng: np.random.Generator, duration_s: float) -> tuple[FloatArray, FloatArray]:
    """Motor angle and torque (n, draws) every THINNED steps, without noise."""
    reference = references(len(axes.inertia), rng, duration_s)
    desired = np.gradient(reference, STEP_S, axis=0)
    link = axes.inertia * axes.link_share
    motor = axes.inertia - link
    stiffness = axes.resonance**2 * link * motor / axes.inertia
    damping = 0.03 * stiffness / axes.resonance
    bend, bristles = 1e-4, axes.kind == "lugre"
    sigma_0 = axes.coulomb / bend
    sigma_1 = 0.6 * np.sqrt(sigma_0 * axes.inertia)
    q, v = reference[0].copy(), desired[0].copy()
    q_l, v_l, z = q.copy(), v.copy(), np.zeros_like(q)
    kept = -(-len(reference) // THINNED)
    angle, torque = np.empty((kept, len(q))), np.empty((kept, len(q)))
    for i in range(len(reference)):
        u = axes.inertia * (700 * (reference[i] - q) + 50 * (desired[i] - v))
        if i % THINNED == 0:
            angle[i // THINNED], torque[i // THINNED] = q, u
        spring = stiffness * (q - q_l) + damping * (v - v_l)
        driven = u - spring - axes.gravity_cos * np.cos(q) - axes.gravity_sin * np.sin(q)
        driven = driven - axes.cogging * np.cos(axes.harmonic * RATIO * q + axes.phase)
        if bristles:
            level = axes.coulomb * (1 + 0.3 * np.exp(-((v / axes.stribeck_velocity) ** 2)))
            decay = np.exp(-sigma_0 * np.abs(v) / level * STEP_S)
            after = np.where(np.abs(v) > 1e-9, level / sigma_0 * np.sign(v) * (1 - decay) + z * decay, z)
            friction = sigma_0 * (z + after) / 2 + sigma_1 * (after - z) / STEP_S * np.exp(-((v / 0.01) ** 2))
            z, dry = after, 0.0
            driven = driven - friction
        else:
            dry = (axes.coulomb + np.sign(v) * axes.uneven_coulomb) * STEP_S / motor
        viscous = (axes.viscous + np.sign(v) * axes.uneven_viscous) * STEP_S / (2 * motor)
        free = (1 - viscous) * v + driven * STEP_S / motor
        # Coulomb friction takes momentum until there is none.
        v = np.sign(free) * np.maximum(np.abs(free) - dry, 0) / (1 + viscous)
        q = q + STEP_S * v
        if axes.kind == "elastic":
            v_l = v_l + spring / link * STEP_S
            q_l = q_l + STEP_S * v_l
    return angle, torque


def logged(angle: FloatArray, torque: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """A log (n,) with noise and counts."""
    decay = np.exp(-THINNED * STEP_S / CORRELATED_S)
    white = rng.standard_normal((2, len(torque)))
    slow = np.empty(len(torque))
    state = 0.0
    for i, each in enumerate(white[1] * np.sqrt(1 - decay**2)):
        state = slow[i] = decay * state + each
    size = NOISE * np.sqrt(np.mean(torque**2))
    return np.round(angle * COUNTS / (2 * np.pi)) * 2 * np.pi / COUNTS, torque + size * (white[0] + slow)


def covered(kind: str, draws: int, seed: int, duration_s: float) -> dict[str, Any]:
    """The figures of a kind."""
    rng = np.random.default_rng((seed, KINDS.index(kind)))
    axes = Axes.drawn(kind, draws, rng)
    angle, torque = simulated(axes, rng, duration_s)
    hits: dict[str, list[bool]] = {}
    errors: dict[str, list[float]] = {}
    widths: dict[str, list[float]] = {}
    shares, misfits = [], 0
    for draw in range(draws):
        q, u = logged(angle[:, draw], torque[:, draw], rng)
        fit = regress_motion(_motion(q, u, kind))
        if fit.misfit:
            misfits += 1
            continue
        own, truth = [], axes.truth(draw)
        for name, std in ((name, fit.chosen.std(name)) for name in fit.chosen.names if name in truth):
            own.append(abs(fit.chosen[name] - truth[name]) <= QUANTILE_95 * std)
            hits.setdefault(name, []).append(own[-1])
            errors.setdefault(name, []).append((fit.chosen[name] - truth[name]) / std)
            widths.setdefault(name, []).append(std / axes.truth(draw)["coulomb" if name != "inertia" else "inertia"])
        shares.append(np.mean(own))
    return {
        "kind": kind,
        "misfit": misfits / draws,
        "coverage": float(np.mean(shares)) if shares else None,
        "chance": float(max(np.std(shares), 0.05) / np.sqrt(len(shares))) if shares else None,
        "by_number": {name: round(float(np.mean(own)), 3) for name, own in hits.items()},
        "bias_over_stated": {name: round(float(np.mean(own)), 2) for name, own in errors.items()},
        "stated_percent": {name: round(100 * float(np.median(own)), 3) for name, own in widths.items()},
    }


def _motion(q: FloatArray, u: FloatArray, kind: str) -> Motion:
    return Motion("axis", 1 / (STEP_S * THINNED), q, u, turns_against_gravity=kind == "gravity", turn=2 * np.pi / RATIO)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="two draws of 10 s, without limits")
    parser.add_argument("--draws", type=int, default=300)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--kinds", nargs="*", default=list(KINDS), choices=KINDS)
    given = parser.parse_args()
    draws, duration_s = (2, 10.0) if given.quick else (given.draws, DURATION_S)
    rows = []
    for kind in given.kinds:
        rows.append(row := covered(kind, draws, given.seed, duration_s))
        print("  ".join(f"{name} {value}" for name, value in row.items()), flush=True)
        if given.quick or row["misfit"] >= MISFITS:
            continue
        spread = CHANCE * row["chance"]
        assert COVERED[0] - spread <= row["coverage"] <= COVERED[1] + spread, row
    print(json.dumps({"rigs": rows}))


if __name__ == "__main__":
    main()
