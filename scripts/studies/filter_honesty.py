"""Does the band of a filter that follows friction hold the truth on a joint that is not as the filter has it?

    python scripts/studies/filter_honesty.py [--quick] [--logs 100] [--draws 2]

The joint is simulated here, with equations and an integrator of its own (Heun's method in steps of a twentieth of a
sample, the bristle exactly): two inertias, a spring, LuGre's bristle, a cascade of P and PI controllers with gravity
fed forward, unlogged torque noise, a rounded angle. F_c falls by 15 % and f by 30 % while it warms up over 30 s; and
one by one or together: F_s / F_c falls from 1.40 to 1.25, the motor cogs by 5 % of F_c, friction grows with 4 % of the
load, F_c changes by 10 % with the angle, gravity is 15 % off. The filter has the numbers of the cold joint, and finds
its noise. Motions: pick and place with stops of two seconds, reversals of three sines, ways between random points.

Table: share of time in which the 95 % band of F_c holds the Coulomb level of that instant, load and angle included;
NEES; NIS; `is_honest`. The band must hold it 90 % of the time, or `is_honest` must be False. Then clean logs of drawn
joints of 0.3 to 200 Nm, with bristles that a step resolves, and their false alarms by note. The last line is JSON.

Two draws: 16 of the 24 rows hold the truth all of the time and are honest; F_c by angle and all together hold it 66 to
80 % and are not, nor is cogging under reversals, with 100 %. Of 100 clean logs 95 hold F_c 90 % of the time and all but
two are honest, where 99 are asked for: numbers 32 and 35, with 79 and 47 %; 8, 14 and 92 hold it 90, 80 and 85 % and
are called honest.
"""

# One BLAS thread must be asked for before NumPy is loaded.
# ruff: noqa: E402
import os

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import argparse
import json
import shutil
import subprocess
import tempfile
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path

import casadi as ca
import numpy as np
from numba import njit

from elastid.base.arrays import FloatArray
from elastid.export.code import c_sources
from elastid.friction_study.extended_kalman_filter import (
    PIECE,
    FilterNoise,
    FollowedJoint,
    JointSamples,
    KalmanFilter,
    Track,
    first_estimate,
)
from elastid.friction_study.filter_consistency import Consistency, consistency
from elastid.friction_study.follow import _noise, estimate_noise

SETTLED_S, DURATION_S, PARTS = 8.0, 40.0, 20
DRIFT = 1e-2  # relative, in a root second: 35 % within 20 min


@dataclass(frozen=True)
class Axis:
    """A joint on the motor's side, SI, and what it does besides; gear: ratio of motor and link angle.

    fallen: F_s / F_c warm.  cogging, by_angle: over F_c.  by_load: of gravity's torque.  wrong_gravity: relative.
    """

    motor_inertia: float = 8e-3
    link_inertia: float = 12e-3
    stiffness: float = 47.0
    damping: float = 0.05
    coulomb: float = 1.0
    stiction_ratio: float = 1.4
    stribeck_velocity: float = 3.0
    viscous: float = 8e-3
    sigma_0: float = 250.0
    sigma_1: float = 0.8
    count: float = 2 * np.pi / 2**16
    rate_hz: float = 1000.0
    noise: float = 0.05
    gravity: float = 3.0
    posture: float = 0.3
    gear: float = 100.0
    speed: float = 60.0
    cycles: float = 7.0  # of F_c over a turn of the link
    warm_s: float = 30.0
    offset: float = 0.05
    fallen: float = 1.4
    cogging: float = 0.0
    by_load: float = 0.0
    by_angle: float = 0.0
    wrong_gravity: float = 0.0

    def followed(self) -> FollowedJoint:
        """As the filter has it: cold, without anything else."""
        return FollowedJoint(
            self.motor_inertia, self.coulomb, self.viscous, self.sigma_0, link_inertia=self.link_inertia,
            stiffness=self.stiffness, damping=self.damping, stiction_ratio=self.stiction_ratio,
            stribeck_velocity=self.stribeck_velocity if self.stiction_ratio > 1 else 0.0, bristle_damping=self.sigma_1,
        )  # fmt: skip


CASES: dict[str, dict[str, float]] = {
    "clean": {},
    "F_s / F_c falls": {"fallen": 1.25},
    "cogging": {"cogging": 0.05},
    "F_s / F_c falls, cogging": {"fallen": 1.25, "cogging": 0.05},
    "friction by load": {"by_load": 0.04},
    "F_c by angle": {"by_angle": 0.1},
    "gravity 15 % off": {"wrong_gravity": 0.15},
}
CASES["all together"] = {key: value for case in CASES.values() for key, value in case.items()}


@njit(cache=True)  # type: ignore[untyped-decorator]
def _simulated(reference, noise, rate_hz, J_m, J_l, k, d, levels, law, gravity, extras, warm_s):  # type: ignore[no-untyped-def]
    """Torque, angle, velocity, Coulomb level, f (n, 5); levels: F_c, f, F_s / F_c cold and warm; law: v_s, s_0, s_1."""
    n, h = len(reference), 1 / rate_hz / PARTS
    F_c, viscous, ratio, fallen = levels
    v_s, s_0, s_1 = law
    true_g, posture, gear, fed = gravity
    cogging, order, by_load, by_angle, cycles = extras
    out = np.empty((n, 5))
    x = np.array([0.0, -true_g * np.cos(posture) / k, 0.0, 0.0])
    a, new, z, integral, wanted = np.zeros(4), np.zeros(4), 0.0, 0.0, 0.0
    K = 25.0 * (J_m + J_l)
    for i in range(n):
        warmth = 1 - np.exp(-i / rate_hz / warm_s)
        wanted += reference[i] / rate_hz
        error = reference[i] + 12.0 * (wanted - x[0]) - x[2]
        integral += error / rate_hz
        u = K * error + 12.0 * K * integral + fed * np.cos(posture + x[0] / gear)
        excess = ratio + (fallen - ratio) * warmth - 1
        f = viscous * (1 - 0.3 * warmth)
        level = 0.0
        for _ in range(PARTS):
            load = true_g * np.cos(posture + x[1] / gear)
            level = F_c * (1 - 0.15 * warmth) + by_load * abs(load)
            level *= 1 + by_angle * np.sin(cycles * x[0] / gear)
            v = x[2]
            for stage in range(2):
                state = x if stage == 0 else new
                rate = s_0 * abs(state[2]) / (level * (1 + excess * np.exp(-((state[2] / v_s) ** 2))))
                friction = s_0 * z + s_1 * (state[2] - rate * z) + f * state[2] + cogging * np.sin(order * state[0])
                spring = k * (state[0] - state[1]) + d * (state[2] - state[3])
                load = true_g * np.cos(posture + state[1] / gear)
                slope_m, slope_l = (u + noise[i] - friction - spring) / J_m, (spring - load) / J_l
                if stage == 0:
                    a[0], a[1], a[2], a[3] = x[2], x[3], slope_m, slope_l
                    new = x + h * a
                    mean = (v + new[2]) / 2
                    rate = s_0 * abs(mean) / (level * (1 + excess * np.exp(-((mean / v_s) ** 2))))
                    fade = np.exp(-rate * h)
                    z = z * fade + (mean / rate * (1 - fade) if rate * h > 1e-8 else mean * h)
                else:
                    x = x + h / 2 * (a + np.array([new[2], new[3], slope_m, slope_l]))
        out[i] = np.array([u, x[0], x[2], level, f])
    return out


def stops(axis: Axis, rng: np.random.Generator) -> FloatArray:
    """There and back at one speed, with stops of two seconds."""
    r = int(axis.rate_hz)
    ramp, rest = np.arange(3 * r // 10) / (3 * r // 10), np.zeros(2 * r)
    way = np.concatenate([ramp, np.ones(4 * r // 10), ramp[::-1], rest])
    return np.resize(axis.speed * np.concatenate([way, -way]), round(DURATION_S * r))


def reversals(axis: Axis, rng: np.random.Generator) -> FloatArray:
    """Three sines."""
    t = np.arange(round(DURATION_S * axis.rate_hz)) / axis.rate_hz
    parts = ((0.5, 0.7, 0), (0.33, 0.23, 1), (0.13, 2.1, 0))
    return np.asarray(axis.speed * sum(size * np.sin(2 * np.pi * freq * t + phase) for size, freq, phase in parts))


def points(axis: Axis, rng: np.random.Generator) -> FloatArray:
    """Between random points at random speeds, with rests of 0.2 to 1.5 s."""
    parts, at, ramp_s = [np.zeros(0)], 0.0, 0.25
    while sum(map(len, parts)) < DURATION_S * axis.rate_hz:
        way = axis.speed * rng.uniform(-0.8, 0.8) - at
        speed = min(axis.speed * rng.uniform(0.1, 1), abs(way) / ramp_s)
        times = np.cumsum([0, ramp_s, abs(way) / speed - ramp_s, ramp_s, rng.uniform(0.2, 1.5)])
        t = np.arange(round(times[-1] * axis.rate_hz)) / axis.rate_hz
        parts.append(np.sign(way) * np.interp(t, times, [0, speed, speed, 0, 0]))
        at += way
    return np.concatenate(parts)[: round(DURATION_S * axis.rate_hz)]


MOTIONS = {"stops": stops, "reversals": reversals, "points": points}


@dataclass(frozen=True)
class Log:
    """What a filter is given, and the true Coulomb level and f (n,)."""

    samples: JointSamples
    coulomb: FloatArray
    viscous: FloatArray


def simulate(axis: Axis, motion: str, seed: int) -> Log:
    """A log of an axis."""
    rng = np.random.default_rng(seed)
    reference = MOTIONS[motion](axis, rng)
    noise = axis.noise * rng.standard_normal(len(reference)) - axis.offset
    order = 2 * np.pi / (0.1 * axis.speed)
    u, q, _, coulomb, viscous = _simulated(
        reference, noise, axis.rate_hz, axis.motor_inertia, axis.link_inertia, axis.stiffness, axis.damping,
        (axis.coulomb, axis.viscous, axis.stiction_ratio, axis.fallen),
        (axis.stribeck_velocity, axis.sigma_0, axis.sigma_1),
        (axis.gravity * (1 + axis.wrong_gravity), axis.posture, axis.gear, axis.gravity),
        (axis.cogging * axis.coulomb, order, axis.by_load, axis.by_angle, axis.cycles), axis.warm_s,
    ).T  # fmt: skip
    angle = np.round(q / axis.count) * axis.count
    load = axis.gravity * np.cos(axis.posture + np.concatenate([[0.0], angle[:-1]]) / axis.gear)
    return Log(JointSamples(u, load, angle), coulomb, viscous)


def filter_of(axis: Axis) -> KalmanFilter:
    """The filter of a joint, its step compiled where there is a compiler."""
    kalman = KalmanFilter(axis.followed(), axis.rate_hz)
    if shutil.which("cc") is None:
        return kalman
    with tempfile.TemporaryDirectory() as folder:
        source, library = Path(folder) / "step.c", Path(folder) / "step.so"
        source.write_text(c_sources("step", [kalman._step])["step.c"])
        source.with_suffix(".h").write_text(c_sources("step", [kalman._step])["step.h"])
        subprocess.run(["cc", "-O1", "-shared", "-fPIC", source, "-o", library, "-lm"], check=True)
        kalman._step = ca.external("filter_step", str(library))
        kalman._loop = kalman._step.mapaccum("filter", PIECE, 2)
    return kalman


@dataclass(frozen=True)
class Row:
    """Share of time in the band and NEES of F_c, width of its band (relative std), and the judgement."""

    held: float
    nees: float
    std: float
    nis: float
    is_honest: bool
    notes: tuple[str, ...]


def judged(kalman: KalmanFilter, axis: Axis, log: Log) -> Row:
    """A log followed, with the noise that is found in its first 7 s."""
    guess = FilterNoise(
        axis.count / np.sqrt(12), 0.05 * axis.coulomb,
        drift={"Fc": DRIFT, "f": DRIFT, "offset": DRIFT * axis.coulomb},
    )  # fmt: skip
    s, cut = log.samples, slice(0, round(7 * axis.rate_hz))
    start = first_estimate(kalman.joint, float(s.angle[0]), float(s.load[0]))
    noise = estimate_noise(kalman, JointSamples(s.torque[cut], s.load[cut], s.angle[cut]), guess, start, 1.0)
    track = kalman.run(s, noise, start)
    found: Consistency = consistency(track, SETTLED_S)
    z = _errors(track, log)
    codes = tuple(note.code for note in _noise("", found))
    i = kalman.joint.states.index("Fc")
    share, nees = float(np.mean(np.abs(z) < 1.96)), float(np.mean(z**2))
    return Row(share, nees, float(track.std[:, i].mean()), found.nis, found.is_honest, codes)


def _errors(track: Track, log: Log) -> FloatArray:
    """Of ln F_c over its std, after settling."""
    i, first = track.joint.states.index("Fc"), round(SETTLED_S * track.rate_hz)
    return np.asarray(((track.x[:, i] - np.log(log.coulomb)) / track.std[:, i])[first:])


def drawn(number: int) -> Axis:
    """A clean axis: friction of 0.3 to 200 Nm, half without stiction, half without gravity."""
    rng = np.random.default_rng((number, 17))
    F_c, speed, share = 10 ** rng.uniform(-0.5, 2.3), 60 * 10 ** rng.uniform(-2, 0), rng.uniform(0.3, 0.7)
    J = F_c / (speed / 0.3) * rng.uniform(0.3, 4)
    J_m, J_l, omega = J * share, J * (1 - share), 2 * np.pi * rng.uniform(8, 25)
    k, bend = omega**2 * J_m * J_l / J, speed * 10 ** rng.uniform(-3.8, -2.5)
    sigma_0, ratio = 1.4 * F_c / bend, 1 + rng.integers(2) * rng.uniform(0.1, 0.5)
    return Axis(
        J_m, J_l, k, 2 * rng.uniform(0.01, 0.05) * k / omega, F_c, ratio, speed * rng.uniform(0.02, 0.1),
        F_c / speed * rng.uniform(0.1, 1), sigma_0, rng.uniform(0.3, 1.5) * np.sqrt(sigma_0 * J_m),
        bend / 10 ** rng.uniform(1.1, 2.3), float(rng.choice([1000, 2000])), F_c * 10 ** rng.uniform(-2, -1),
        F_c * rng.integers(2) * rng.uniform(0.5, 4), rng.uniform(-1, 1), max(1.0, speed / rng.uniform(0.5, 2)), speed,
        warm_s=rng.uniform(60, 600), offset=F_c * rng.uniform(-0.1, 0.1), fallen=ratio,
    )  # fmt: skip


def table(draws: int, motions: list[str], cases: list[str]) -> dict[str, dict[str, float]]:
    """Of each motion and case the means over draws; asserts that no row is sure and wrong."""
    kalman, rows = filter_of(Axis()), dict[str, dict[str, float]]()
    for motion in motions:
        for case in cases:
            axis = replace(Axis(), **CASES[case])
            found = [judged(kalman, axis, simulate(axis, motion, seed)) for seed in range(draws)]
            wrong = [row for row in found if row.is_honest and row.held < 0.9]
            assert not wrong, (motion, case, wrong)
            values = {
                name: float(np.mean([getattr(row, name) for row in found]))
                for name in Row.__annotations__
                if name != "notes"
            }
            rows[f"{motion}, {case}"] = values
            codes = sorted({code for row in found for code in row.notes})
            print(
                f"{motion:10} {case:26} in band {values['held']:4.0%}  NEES {values['nees']:6.2f}  "
                f"std {values['std']:.1%}  NIS {values['nis']:.2f}  honest {values['is_honest']:4.0%}  "
                f"{', '.join(codes)}",
                flush=True,
            )
    return rows


def clean(count: int) -> tuple[int, dict[str, int], float]:
    """Clean logs that are called honest, notes by code, and the mean share of time in the band."""
    honest, codes, held = 0, Counter[str](), []
    for number in range(count):
        axis = drawn(number)
        row = judged(filter_of(axis), axis, simulate(axis, list(MOTIONS)[number % len(MOTIONS)], number))
        honest += row.is_honest
        codes.update(row.notes)
        held.append(row.held)
        if not row.is_honest or row.held < 0.9:
            print(f"clean log {number}: {row}", flush=True)
    print(
        f"{honest} of {count} clean logs honest; F_c in its band {np.mean(held):.1%} of the time; notes {dict(codes)}"
    )
    return honest, dict(codes), float(np.mean(held))


def main() -> None:
    """Print the table, the clean logs, then one JSON line; assert the figures that texts quote."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="one case of one motion, and one clean log")
    parser.add_argument("--logs", type=int, default=100, help="clean logs")
    parser.add_argument("--draws", type=int, default=2, help="of each row of the table")
    options = parser.parse_args()
    rows = (
        table(1, ["stops"], ["F_s / F_c falls"]) if options.quick else table(options.draws, list(MOTIONS), list(CASES))
    )
    for name, row in rows.items():
        if name.endswith((", clean", "F_s / F_c falls")):
            assert row["is_honest"] == 1, (name, row)
            assert row["held"] > 0.95, (name, row)
    count = 1 if options.quick else options.logs
    honest, codes, held = clean(count)
    assert honest >= np.floor(0.99 * count), (honest, codes)
    print(json.dumps({"table": rows, "clean": count, "honest": honest, "held": held, "notes": codes}))


if __name__ == "__main__":
    main()
