"""The same records of a two-axis elastic arm for elastid, MuJoCo's `sysid` and an afternoon of SciPy.

    uv run --group oracles --with "mujoco[sysid]" python scripts/benchmarks/peers.py [--quick] [--seeds 1] [--peers ...]

MuJoCo simulates a planar arm with elastic gears under gravity: three realisations of two experiments in two postures,
a sampled controller, torques in multisines, encoders of 16384 counts, friction of a tenth of the rms torque, torque
that no log shows. Each of the three is given the records and a robot's file that is exact, or off as data sheets are
(masses 3 %, inertias 10 %, motor inertias 5 %, centres 10 mm, 1 std each), with springs a factor two off.

- elastid: the twelve lines of the README, tolerances as they are by default.
- scipy: responses by FFT, their variance over realisations, two masses an axis, a held torque, priors on the file.
- sysid: references in, the sampled controller in the rollout, friction as frictionloss, priors on the file; weights by
  the residuals of a first fit.

For each: the largest error of k and of d, how many of the four 95 % intervals hold, CPU seconds, and the lines of this
file that a user would write. The last line is one JSON object.
"""

# One BLAS thread must be asked for before NumPy is loaded.
# ruff: noqa: E402
import os

for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[variable] = "1"

import argparse
import inspect
import json
import logging
import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

import mujoco
import numpy as np
from scipy.linalg import expm
from scipy.optimize import least_squares

import elastid as ei
from elastid.base.arrays import ComplexArray, FloatArray
from elastid.robot import Placement, Tolerances

RATE_HZ, PERIOD, LINES = 500, 1000, np.arange(5, 121, 2)
POSTURES, REALISATIONS, PERIODS = {"a": (0.3, 0.9), "b": (-0.5, -1.2)}, 3, 3
RATIO, TORQUE_RMS, COUNTS = np.array([100.0, 80.0]), np.array([60.0, 30.0]), 16384
STIFF, DAMPING = np.array([2e4, 6e3]), np.array([800.0, 250.0])  # of the controller
TRUE = {
    "J1": 24.0, "J2": 7.68, "f1": 20.0, "f2": 8.3, "k1": 220e3, "k2": 110e3, "d1": 120.0, "d2": 60.0, "F1": 6.0,
    "F2": 3.0, "m1": 40.0, "c1": 0.3, "I1": 4.0, "l1": 0.6, "m2": 20.0, "c2": 0.25, "I2": 1.2,
}  # fmt: skip
WANTED = ("k1", "k2", "d1", "d2")
START = {"k1": 440e3, "k2": 55e3, "d1": 240.0, "d2": 30.0, "f1": 30.0, "f2": 12.0, "F1": 3.0, "F2": 1.5}
# One standard deviation of a data sheet, relative; of the centres 10 mm.
SHEET = {"m1": 0.03, "m2": 0.03, "I1": 0.1, "I2": 0.1, "J1": 0.05, "J2": 0.05, "c1": 0.01 / 0.3, "c2": 0.01 / 0.25}
XML = """<mujoco><compiler inertiafromgeom="false"/><option gravity="0 -9.81 0" timestep="{step}" integrator="RK4"/>
<worldbody><body><joint name="m1" axis="0 0 1" armature="{J1}" damping="{f1}" frictionloss="{loss1}"
solreffriction="0.002 1"/>
<joint name="s1" axis="0 0 1" stiffness="{k1}" damping="{d1}"/>
<inertial pos="{c1} 0 0" mass="{m1}" diaginertia="{I1} {I1} {I1}"/>
<body pos="{l1} 0 0"><joint name="m2" axis="0 0 1" armature="{J2}" damping="{f2}" frictionloss="{loss2}"
solreffriction="0.002 1"/>
<joint name="s2" axis="0 0 1" stiffness="{k2}" damping="{d2}"/>
<inertial pos="{c2} 0 0" mass="{m2}" diaginertia="{I2} {I2} {I2}"/></body></body></worldbody></mujoco>"""

Numbers: TypeAlias = Mapping[str, float]
Estimates: TypeAlias = dict[str, tuple[float, float]]  # value and standard deviation


@dataclass(frozen=True, eq=False)
class Log:
    """One experiment, link side, from its start at rest on: reference, torque, angle of the motors (n, 2)."""

    posture: str
    realisation: int
    experiment: int
    r: FloatArray
    u: FloatArray
    q: FloatArray


def arm(numbers: Numbers, step: float, loss: bool) -> Any:
    """The arm as MuJoCo has it; loss: with its dry friction."""
    losses = {f"loss{i}": numbers[f"F{i}"] if loss else 0.0 for i in (1, 2)}
    return mujoco.MjModel.from_xml_string(XML.format(step=step, **losses, **numbers))


def held(numbers: Numbers, q: FloatArray) -> FloatArray:
    """Torque of gravity (2,)."""
    fore = numbers["m2"] * 9.81 * numbers["c2"] * math.cos(q.sum())
    upper = (numbers["m1"] * numbers["c1"] + numbers["m2"] * numbers["l1"]) * 9.81 * math.cos(q[0])
    return np.array([upper + fore, fore])


def run(
    numbers: Numbers, model: Any, posture: FloatArray, r: FloatArray, rng: np.random.Generator | None
) -> tuple[FloatArray, FloatArray]:
    """Torque and motor angle (n, 2) under a sampled controller; rng: noise, counts and the true law of friction."""
    data, gravity = mujoco.MjData(model), held(numbers, posture)
    k, steps = np.array([numbers["k1"], numbers["k2"]]), round(1 / RATE_HZ / model.opt.timestep)
    count = 2 * np.pi / COUNTS / RATIO
    data.qpos[[0, 2]], data.qpos[[1, 3]] = posture, -gravity / k
    rub = [numbers["F1"], numbers["F2"]]

    def passive(_: Any, now: Any) -> None:
        force, v = now.qfrc_passive, now.qvel
        force[0] -= rub[0] * math.tanh(2e3 * v[0])
        force[2] -= rub[1] * math.tanh(2e3 * v[2])

    mujoco.set_mjcb_passive(passive if rng is not None else None)
    u, q, before = np.zeros_like(r), np.zeros_like(r), posture
    for n in range(len(r)):
        now = data.qpos[[0, 2]].copy()
        now = now if rng is None else np.round(now / count) * count
        torque = gravity + r[n] + STIFF * (posture - now) - DAMPING * (now - before) * RATE_HZ
        u[n], q[n], before = torque, now, now
        unseen = 0.0 if rng is None else 0.5 * rng.standard_normal(2)
        data.qfrc_applied[[0, 2]] = torque + unseen
        mujoco.mj_step(model, data, steps)
    mujoco.set_mjcb_passive(None)
    return u if rng is None else u + 0.3 * rng.standard_normal(u.shape), q


def records(seed: int) -> list[Log]:
    """Of all postures, realisations and experiments, a period to settle before those that count."""
    rng, model, logs = np.random.default_rng(seed), arm(TRUE, 1 / 8000, False), []
    waves = np.exp(2j * np.pi * np.outer(np.arange((PERIODS + 1) * PERIOD) / PERIOD, LINES))
    for name, posture in POSTURES.items():
        for realisation in range(REALISATIONS):
            phases = np.exp(2j * np.pi * rng.random((len(LINES), 2))) * np.sqrt(2 / len(LINES)) * TORQUE_RMS
            for experiment, signs in enumerate(([1, 1], [1, -1])):
                r = (waves @ (phases * signs)).real
                logs.append(Log(name, realisation, experiment, r, *run(TRUE, model, np.array(posture), r, rng)))
    return logs


def sheet(seed: int, is_exact: bool) -> dict[str, float]:
    """The robot's file, its springs, dampers and friction as guessed."""
    rng = np.random.default_rng(1000 + seed)
    off = {name: value * (1 + SHEET[name] * rng.standard_normal()) for name, value in TRUE.items() if name in SHEET}
    return {**TRUE, **({} if is_exact else off), **START}


def by_elastid(logs: list[Log], file: Numbers, is_exact: bool) -> Estimates:
    """Friction is taken out by default; the file has the tolerances of a data sheet."""
    bodies = []
    for i, n in enumerate(RATIO.tolist(), start=1):
        motor = ei.Motor(file[f"J{i}"] / n**2, n, file[f"f{i}"] / n**2)
        joint = ei.Joint(str(i), "z", ei.Spring(file[f"k{i}"], file[f"d{i}"]), motor)
        place = ("base", Placement()) if i == 1 else ("1", Placement((file["l1"], 0, 0)))
        inertia = file[f"I{i}"]
        centre = file[f"c{i}"], 0.0, 0.0
        bodies.append(ei.Body(str(i), *place, (joint,), file[f"m{i}"], centre, (inertia, inertia, inertia)))
    robot = ei.Robot("arm", tuple(bodies), gravity=(0, -9.81, 0), tolerances="exact" if is_exact else Tolerances())
    motors = ("motor 1", "motor 2")
    measured = [
        ei.Record(
            f"{log.posture}-{log.realisation}-{log.experiment}",
            ei.Configuration(log.posture, np.array(POSTURES[log.posture])),
            log.realisation, log.experiment, RATE_HZ, PERIOD, motors, motors, ("position", "position"),
            log.u[PERIOD:], log.q[PERIOD:], log.r[PERIOD:], hold="zero-order",
        )
        for log in logs
    ]  # fmt: skip
    result = ei.identify(ei.estimate(measured, robot), robot, ei.choose(robot, "k_*", "d_*", "fm_*"))
    return {name.replace("_", ""): (result.values[name], result.std[name]) for name in ("k_1", "k_2", "d_1", "d_2")}


def by_scipy(logs: list[Log], file: Numbers, is_exact: bool) -> Estimates:
    """G = Y / U line by line, variances over realisations smoothed over lines, least squares with priors."""
    measured = {}
    for name in POSTURES:
        every = []
        for realisation in range(REALISATIONS):
            own = [log for log in logs if (log.posture, log.realisation) == (name, realisation)]
            U, Y = (
                np.stack([_lines(x) for x in signal], axis=2) for signal in zip(*((x.u, x.q) for x in own), strict=True)
            )
            every.append(Y @ np.linalg.inv(U))
        variance = np.var(every, axis=0, ddof=1) / REALISATIONS
        smooth = [np.convolve(np.pad(v, 4, "edge"), np.ones(9) / 9, "valid") for v in variance.reshape(len(LINES), 4).T]
        measured[name] = np.mean(every, axis=0), np.stack(smooth, axis=1).reshape(variance.shape)
    free = () if is_exact else tuple(SHEET)

    def numbers(x: FloatArray) -> dict[str, float]:
        own = {name: file[name] * (1 + SHEET[name] * z) for name, z in zip(free, x[6:], strict=True)}
        return {**file, **own, **dict(zip(WANTED, np.exp(x[:4]), strict=True)), "f1": x[4], "f2": x[5]}

    def residuals(x: FloatArray) -> FloatArray:
        rows = [(modelled(numbers(x), np.array(POSTURES[c])) - G) * np.sqrt(2 / V) for c, (G, V) in measured.items()]
        flat = np.concatenate([row.ravel() for row in rows])
        return np.concatenate([flat.real, flat.imag, x[6:]])

    start = np.array([*np.log([file[name] for name in WANTED]), file["f1"], file["f2"], *(0.0 for _ in free)])
    end = least_squares(residuals, start, x_scale=np.array([1, 1, 1, 1, 20, 10, *(1.0 for _ in free)]))
    level = max(1.0, 2 * end.cost / (len(end.fun) - len(start)))
    std = np.sqrt(level * np.diag(np.linalg.inv(end.jac.T @ end.jac)))
    values = np.exp(end.x[:4])
    return {name: (values[i], values[i] * std[i]) for i, name in enumerate(WANTED)}


def _lines(signal: FloatArray) -> ComplexArray:
    """Amplitudes (F, 2) of the mean period."""
    return np.asarray(np.fft.rfft(signal[PERIOD:].reshape(-1, PERIOD, 2).mean(axis=0), axis=0)[LINES])


def modelled(n: Numbers, q: FloatArray) -> ComplexArray:
    """G (F, 2, 2) of two masses an axis, torques held over a sample."""
    c, s12 = math.cos(q[1]), math.sin(q.sum())
    outer = n["I2"] + n["m2"] * n["c2"] ** 2
    both = outer + n["m2"] * n["l1"] * n["c2"] * c
    inner = n["I1"] + n["m1"] * n["c1"] ** 2 + n["m2"] * n["l1"] ** 2 + 2 * both - outer
    M, K, D = np.zeros((4, 4)), np.zeros((4, 4)), np.diag([n["f1"], n["f2"], 0.0, 0.0])
    M[:2, :2], M[2:, 2:] = np.diag([n["J1"], n["J2"]]), [[inner, both], [both, outer]]
    twist = np.hstack([np.eye(2), -np.eye(2)])
    K, D = K + twist.T @ np.diag([n["k1"], n["k2"]]) @ twist, D + twist.T @ np.diag([n["d1"], n["d2"]]) @ twist
    fore = -n["m2"] * 9.81 * n["c2"] * s12
    upper = -(n["m1"] * n["c1"] + n["m2"] * n["l1"]) * 9.81 * math.sin(q[0]) + fore
    K[2:, 2:] += [[upper, fore], [fore, fore]]
    A = np.block([[np.zeros((4, 4)), np.eye(4)], [-np.linalg.solve(M, K), -np.linalg.solve(M, D)]])
    B = np.vstack([np.zeros((4, 2)), np.linalg.inv(M)[:, :2]])
    E = expm(np.block([[A, B], [np.zeros((2, 10))]]) / RATE_HZ)
    z = np.exp(2j * np.pi * LINES / PERIOD)[:, None, None]
    return np.asarray(np.linalg.solve(z * np.eye(8) - E[:8, :8], np.broadcast_to(E[:8, 8:], (len(z), 8, 2)))[:, :2])


def by_sysid(logs: list[Log], file: Numbers, is_exact: bool) -> Estimates:
    """Angles of one period of each log under its reference; each channel weighs by the residuals of a first fit."""
    from mujoco import sysid

    logging.disable(logging.CRITICAL)
    free, wanted = () if is_exact else tuple(SHEET), tuple(START)
    parameters, weight = sysid.ParameterDict(), np.array([1e5, 1e5])
    for name in wanted:
        parameters.add(sysid.Parameter(name, 1.0, 0.05, 20.0))
    for name in free:
        parameters.add(sysid.Parameter(name, 1.0, 0.5, 1.5))

    def residuals(x: FloatArray, given: Any) -> tuple[list[FloatArray], None, None]:
        columns = [
            _replayed(logs, file, dict(zip((*wanted, *free), own, strict=True)), weight) for own in np.atleast_2d(x.T)
        ]
        priors = [(own[len(wanted) :] - 1) / np.array([SHEET[name] for name in free]) for own in np.atleast_2d(x.T)]
        both = np.stack([np.concatenate(pair) for pair in zip(columns, priors, strict=True)], axis=1)
        return [both[:, 0] if x.ndim == 1 else both], None, None

    for _ in range(2):
        parameters, end = sysid.optimize(parameters, residuals, optimizer="mujoco", verbose=False, max_iters=30)
        left = residuals(parameters.as_vector(), parameters)[0][0]
        angles = left[: left.size - len(free)].reshape(-1, 2)
        last, weight = left, weight / angles.std(axis=0)
    _, reach = sysid.calculate_intervals([last], np.asarray(end.jac))
    x = parameters.as_vector()
    return {name: (file[name] * x[i], file[name] * reach[i] / 1.96) for i, name in enumerate(wanted) if name in WANTED}


def _replayed(logs: list[Log], file: Numbers, factors: Numbers, weight: FloatArray) -> FloatArray:
    numbers = {name: value * factors.get(name, 1.0) for name, value in file.items()}
    model, left = arm(numbers, 5e-4, True), []
    for log in logs:
        _, q = run(numbers, model, np.array(POSTURES[log.posture]), log.r[: 2 * PERIOD], None)
        left.append((log.q[PERIOD : 2 * PERIOD] - q[PERIOD:]) * weight)
    return np.concatenate(left).ravel()


PEERS: dict[str, tuple[Callable[[list[Log], Numbers, bool], Estimates], tuple[Callable[..., Any], ...]]] = {
    "elastid": (by_elastid, (by_elastid,)),
    "scipy": (by_scipy, (by_scipy, _lines, modelled)),
    "sysid": (by_sysid, (by_sysid, _replayed, run, arm, held)),
}


def main() -> None:
    """Print a row for each peer, file and seed."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--quick", action="store_true", help="elastid and scipy alone")
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--peers", nargs="+", choices=PEERS, default=list(PEERS))
    given = parser.parse_args()
    rows = []
    for seed in range(given.seeds):
        logs = records(seed)
        for name in given.peers if not given.quick else ("elastid", "scipy"):
            for is_exact in (True, False):
                fit, sources = PEERS[name]
                begin = time.process_time()
                found = fit(logs, sheet(seed, is_exact), is_exact)
                cpu_s = time.process_time() - begin
                off = {key: abs(value / TRUE[key] - 1) for key, (value, _) in found.items()}
                hold = sum(bool(abs(value - TRUE[key]) < 1.96 * std) for key, (value, std) in found.items())
                lines = sum(len(inspect.getsource(source).splitlines()) for source in sources)
                k_off, d_off = (100 * float(max(off[f"{letter}{i}"] for i in (1, 2))) for letter in "kd")
                kind = "exact" if is_exact else "data sheet"
                figures = {"k_off_percent": k_off, "d_off_percent": d_off, "hold": hold, "cpu_s": cpu_s, "lines": lines}
                rows.append({"peer": name, "file": kind, "seed": seed, **figures})
                off_by = f"k {k_off:.3f} %, d {d_off:.3f} %, {hold} of 4"
                print(f"{name:8s} {kind:10s} {off_by}, {cpu_s:.1f} s, {lines} lines", flush=True)
    print(json.dumps({"peers": rows}))


if __name__ == "__main__":
    main()
