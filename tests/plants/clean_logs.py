"""Logs of robots with nothing wrong, of many kinds: other rigs, periods, grids, noise, encoders, wander, steps.

Half of the logs are of the simulated rig. The others come from equations of their own, which share nothing with it:
masses on elastic gears under a sampled controller,

    x_k+1 = e^(A h) x_k + A^-1 (e^(A h) - 1) B (u_k + w_k),     u = r + K_p e + K_d (e - e_k-1) / h,    e = c - q_m,

one axis of two masses, or two with the inertia of a planar arm.  u: link side.  q_m: the encoder's.  c: a carrier.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import expm, hadamard

from elastid.base.arrays import FloatArray
from elastid.excitation.spec import MultisineSpec
from elastid.experiment.plan.plan import make_plan
from elastid.experiment.simulated.rig import SimulatedRig
from elastid.experiment.specs.experiment import ExperimentSpec
from elastid.experiment.specs.simulated import CarrierSpec, ColoredNoiseSpec, NoiseSpec, SimulatedSpec
from elastid.robot import Body, Joint, Motor, Placement, Robot, Spring
from elastid.simulation.spec import ControllerSpec
from plants.outside_arm import Outside

RATE_HZ, PERIOD = 200.0, 400
# Lines 0.5 Hz apart: all from 1 to 40 Hz, odd ones, odd ones with gaps, every fourth.
GRIDS: Mapping[str, tuple[int, ...]] = {
    "full": tuple(range(2, 81)),
    "odd": tuple(range(3, 80, 2)),
    "odd-random": tuple(k for k in range(3, 80, 2) if (k * 7919) % 11 > 2),
    "sparse": tuple(range(3, 80, 4)),
}
RATIO, TORQUE_RMS = (100.0, 80.0), (60.0, 30.0)
GRAVITY = (0.0, 0.0, -9.81)


@dataclass(frozen=True)
class Log:
    """One experiment. signals: r, u (Nm, link side) and q (rad, motor side) of each motor, by name, (n,) each."""

    configuration: str
    realisation: int
    experiment: int
    signals: Mapping[str, FloatArray]


@dataclass(frozen=True)
class Kind:
    """What a set of logs is like.

    wander: rms of a slow torque that no log shows, over that of the excitation; step: of one that jumps once in a log.
    counts: of the encoder in a turn, 0 for a fine one.  noise: of the logged torque over its rms.  coulomb: friction
    over the rms of the torque.  bandwidth_hz: of the position loop.  carrier: amplitude of a slow movement, rad.
    """

    number: int
    seed: int
    source: str
    axes: int
    postures: int
    periods: int
    realisations: int
    grid: str
    noise: float
    wander: float
    step: float
    counts: int
    has_reference: bool
    coulomb: float
    bandwidth_hz: float
    carrier: float
    half_wave: bool

    @classmethod
    def drawn(cls, number: int, seed: int) -> Kind:
        """That of a set of logs by its number."""
        rng = np.random.default_rng((seed, number))
        source = "simulated" if number % 2 else "closed form"
        grid = str(rng.choice(list(GRIDS)))
        axes, realisations = int(rng.integers(1, 3)), int(rng.integers(1, 4))
        # One realisation does not show the distortion by friction.
        coulomb = float(rng.choice((0.0, 0.05))) if source == "simulated" and realisations > 1 else 0.0
        return cls(
            number=number,
            seed=seed,
            source=source,
            axes=axes,
            postures=int(rng.integers(1, 3)) if axes > 1 else 1,
            periods=int(rng.choice((2, 3, 5))),
            realisations=realisations,
            grid=grid,
            noise=float(rng.choice((0.001, 0.005, 0.02))),
            wander=float(rng.choice((0.0, 0.03, 0.1))),
            step=float(rng.choice((0.0, 0.0, 0.1))) if source == "closed form" else 0.0,
            counts=int(rng.choice((0, 1 << 14, 1 << 17, 1 << 20))),
            has_reference=bool(rng.random() < 0.8),
            coulomb=coulomb,
            bandwidth_hz=float(rng.choice((1.5, 3.0, 5.0))),
            carrier=float(rng.choice((0.0, 0.01))) if coulomb == 0 else 0.01,
            half_wave=grid.startswith("odd") and bool(rng.random() < 0.3),
        )

    @property
    def lines(self) -> tuple[int, ...]:
        """Those of its grid at which the controller does not cancel the excitation, from half its bandwidth on."""
        return tuple(k for k in GRIDS[self.grid] if k * RATE_HZ / PERIOD >= self.bandwidth_hz / 2)

    @property
    def rng(self) -> np.random.Generator:
        """Of everything that is drawn in its logs."""
        return np.random.default_rng((self.seed, self.number, 1))

    @property
    def robot(self) -> Robot:
        """Its robot with the true numbers."""
        return simulated_robot(self.axes, self.coulomb) if self.source == "simulated" else Chain.drawn(self).robot

    @property
    def configurations(self) -> dict[str, tuple[float, ...]]:
        """The angles of its joints in each posture, by name; a planar arm's first one does not matter."""
        rng = np.random.default_rng((self.seed, self.number, 2))
        angles = rng.uniform(-1.0, 1.0, (self.postures, self.axes))
        if self.source == "closed form":
            angles = np.stack([0 * angles[:, 0], 1.1 * np.sign(angles[:, -1]) + 0.5 * angles[:, -1]], 1)[:, : self.axes]
        return {f"c{i + 1}": tuple(row) for i, row in enumerate(angles.tolist())}

    def logs(self) -> Iterator[Log]:
        """All of them."""
        return _simulated(self) if self.source == "simulated" else Chain.drawn(self).logs()

    def disturbance(self, rng: np.random.Generator, n: int, n_u: int) -> FloatArray:
        """Torque (n, n_u) of slow wander with a time constant of 5 s, and of a step somewhere."""
        white = rng.standard_normal((n, n_u))
        decay = np.exp(-1 / (5.0 * RATE_HZ))
        slow = np.empty((n, n_u))
        last = rng.standard_normal(n_u)
        for i in range(n):
            last = decay * last + np.sqrt(1 - decay**2) * white[i]
            slow[i] = last
        jump = (np.arange(n) >= rng.integers(n))[:, None] * rng.choice((-1.0, 1.0), n_u)
        return np.asarray((self.wander * slow + self.step * jump) * TORQUE_RMS[:n_u])


@dataclass(frozen=True)
class Chain:
    """Motors behind elastic gears and the links of a planar arm with viscous friction, in one posture."""

    kind: Kind
    robot: Robot
    angles: tuple[float, ...]

    @classmethod
    def drawn(cls, kind: Kind) -> Chain:
        """Resonances of 8 to 25 Hz, damped by 1.5 to 4 %."""
        rng, n = kind.rng, kind.axes
        J = np.array((20.0, 7.0))[:n] * rng.uniform(0.7, 1.4, n)
        m1, c1, I1, l1, m2, c2, I2 = np.array((40.0, 0.3, 4.0, 0.6, 20.0, 0.25, 1.2)) * rng.uniform(0.9, 1.1, 7)

        def arm(springs: list[Spring], f: FloatArray) -> Robot:
            axes = zip("12", springs, J, RATIO, f, strict=False)
            joints = [Joint(name, "z", spring, Motor(J_m / i**2, i, f / i**2)) for name, spring, J_m, i, f in axes]
            upper = Body("upper", joints=(joints[0],), mass=m1, center_of_mass=(c1, 0, 0), inertia=(I1, I1, I1))
            fore = Body("fore", "upper", Placement((l1, 0, 0)), (*joints[1:],), m2, (c2, 0, 0), (I2, I2, I2))
            return Robot("planar arm", (upper, fore)[:n], gravity=(0.0, 0.0, 0.0))

        angles = (0.0, 1.2)[:n]
        inertia = np.diag(Outside(arm([Spring(1.0)] * n, 0 * J)).matrices(np.array(angles))[0])[:n]
        reduced = 1 / (1 / J + 1 / inertia)
        k = reduced * (2 * np.pi * np.array((11.0, 19.0))[:n] * rng.uniform(0.85, 1.15, n)) ** 2
        d = 2 * rng.uniform(0.015, 0.04, n) * np.sqrt(k * reduced)
        springs = [Spring(*each) for each in zip(k.tolist(), d.tolist(), strict=True)]
        return cls(kind, arm(springs, 0.8 * J * rng.uniform(0.5, 2, n)), angles)

    @cached_property
    def matrices(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """M, D, K (2 n, 2 n), joints before motors."""
        M, D, K, _ = Outside(self.robot).matrices(np.array(self.angles))
        return M, D, K

    @cached_property
    def step(self) -> tuple[FloatArray, FloatArray]:
        """e^(A h) (4 n, 4 n) and its integral times B (4 n, n), exact for torques that are held."""
        (M, D, K), n = self.matrices, self.kind.axes
        A = np.zeros((5 * n, 5 * n))
        A[: 2 * n, 2 * n : 4 * n] = np.eye(2 * n)
        A[2 * n : 4 * n, : 4 * n] = -np.linalg.solve(M, np.hstack([K, D]))
        A[2 * n : 4 * n, 4 * n :] = np.linalg.inv(M)[:, n:]
        whole = expm(A / RATE_HZ)
        return whole[: 4 * n, : 4 * n], whole[: 4 * n, 4 * n :]

    def logs(self) -> Iterator[Log]:
        """Those of every posture."""
        rng = self.kind.rng
        for name, angles in self.kind.configurations.items():
            yield from replace(self, angles=angles)._logs_there(name, rng)

    def _logs_there(self, name: str, rng: np.random.Generator) -> Iterator[Log]:
        """All experiments, run side by side, from three periods on: what they begin with has died out."""
        kind, n_u = self.kind, self.kind.axes
        pairs = [(m, e) for m in range(kind.realisations) for e in range(n_u)]
        first, n = 3 * PERIOD, (3 + kind.periods) * PERIOD
        periods = np.concatenate([self.multisines(rng) for _ in range(kind.realisations)])
        r = np.tile(periods, (1, 3 + kind.periods, 1))
        w = np.stack([kind.disturbance(rng, n, n_u) for _ in pairs])
        u, q = self.run(r, w + 0.002 * np.array(TORQUE_RMS[:n_u]) * rng.standard_normal(r.shape), rng)
        u = u + kind.noise * np.array(TORQUE_RMS[:n_u]) * rng.standard_normal(u.shape)
        for i, (m, e) in enumerate(pairs):
            names = {"r": r[i, first:], "u": u[i, first:], "q": q[i, first:] * RATIO[:n_u]}
            signals = {f"{role}{j + 1}": x[:, j] for role, x in names.items() for j in range(n_u)}
            yield Log(name, m, e, signals)

    def multisines(self, rng: np.random.Generator) -> FloatArray:
        """Torques (n_u, N, n_u) of the experiments of a realisation: orthogonal multisines of random phases."""
        n_u, lines = self.kind.axes, np.array(self.kind.lines)
        turns = np.exp(2j * np.pi * rng.random((len(lines), n_u)))
        wave = np.exp(2j * np.pi * np.outer(np.arange(PERIOD), lines) / PERIOD)
        amplitude = np.array(TORQUE_RMS[:n_u]) * np.sqrt(2 / len(lines))
        return np.stack([(wave @ (turns * amplitude * signs)).real for signs in hadamard(n_u)])

    def run(self, r: FloatArray, w: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
        """Torques and read angles (E, n, n_u), link side, of all experiments."""
        E, n, n_u = r.shape
        whole, of_torque = (matrix.T for matrix in self.step)
        total = np.diag(self.matrices[0])[n_u:] + np.diag(self.matrices[0])[:n_u]
        omega = 2 * np.pi * self.kind.bandwidth_hz
        stiffness, damping = total * omega**2, (1.6 if self.kind.bandwidth_hz < 2 else 0.8) * total * omega
        carrier = self.kind.carrier * np.sin(2 * np.pi * np.arange(n) / PERIOD)
        count = 2 * np.pi / self.kind.counts / np.array(RATIO[:n_u]) if self.kind.counts else 0.0
        noise = 1e-7 * (1 + 4 * rng.random()) * rng.standard_normal(r.shape)
        x, before = np.zeros((E, 4 * n_u)), np.zeros((E, n_u))
        u, q = np.empty(r.shape), np.empty(r.shape)
        for i in range(n):
            read = x[:, n_u : 2 * n_u] + noise[:, i]
            if self.kind.counts:
                read = np.round(read / count) * count
            error = carrier[i] - read
            u[:, i] = r[:, i] + stiffness * error + damping * (error - before) * RATE_HZ
            q[:, i], before = read, error
            x = x @ whole + (u[:, i] + w[:, i]) @ of_torque
        return u, q


def simulated_robot(axes: int, coulomb: float) -> Robot:
    """Of the simulated rig; Coulomb friction at the motors, over the rms of the torque, link side."""
    motors = [
        Motor(J, i, 0.02, coulomb * rms / i)
        for J, i, rms in zip((2.0e-3, 1.1e-3), RATIO, TORQUE_RMS, strict=True)
    ]  # fmt: skip
    upper = Body("upper", joints=(Joint("1", "z", Spring(60e3, 60), motors[0]),), mass=30,
                 center_of_mass=(0.05, 0, 0.3), inertia=(3, 3, 4))  # fmt: skip
    fore = Body("fore", "upper", Placement((0, 0, 0.6)), (Joint("2", "y", Spring(25e3, 20), motors[1]),), mass=20,
                center_of_mass=(0.3, 0.05, 0.05), inertia=(0.4, 1.5, 1.5))  # fmt: skip
    return Robot("rig", (upper, fore)[:axes], gravity=GRAVITY)


def _simulated(kind: Kind) -> Iterator[Log]:
    """Runs of the simulated rig; wander and steps are torques of its drives that the log does not show."""
    robot, n_u = kind.robot, kind.axes
    rms = TORQUE_RMS[:n_u]
    lines = MultisineSpec(RATE_HZ, PERIOD / RATE_HZ, (1.0, 40.0), rms, grid="lines", lines=kind.lines)
    wander = ColoredNoiseSpec("disturbance", kind.wander * rms[-1], 0.03) if kind.wander else None
    noise = NoiseSpec(kind.noise * rms[-1], 2e-7, 0.002 * rms[-1], kind.counts, colored=(wander,) if wander else ())
    carrier = CarrierSpec(kind.carrier, 1) if kind.carrier else None
    controller = ControllerSpec(kind.bandwidth_hz)
    simulated = SimulatedSpec(controller=controller, noise=noise, carrier=carrier, substeps=2)
    experiment = ExperimentSpec(kind.configurations, kind.realisations, kind.periods, 1, simulated=simulated)
    rig = SimulatedRig(robot, experiment, make_plan(lines, experiment, robot, kind.number), kind.number)
    for one in rig.experiments:
        record = rig.measure(one)
        assert record.r is not None
        names = {"r": record.r, "u": record.u, "q": record.y * RATIO[:n_u]}
        signals = {f"{name}{j + 1}": x[:, j] for name, x in names.items() for j in range(n_u)}
        yield Log(one.configuration.name, one.realisation, one.experiment, signals)
