r"""Springs of gears that are not straight, from records alone: no fit, no stiffness and no start goes into it.

.. math:: \tau = U - J s^2 Q, \qquad Q_i = \sum_j X_{ij}\, \tau_j + c_i \Phi(\tau_i), \qquad X = A + K^{-1}

U torques and Q angles of motors, tau torques of their gears, A the arm's motion by these, c Phi the deflection of a
gear beyond a straight line of its torque: a part of |tau| tau or of tau^3 (it grows stiffer), or of a sign that turns
over a little torque (it has a gap). Excited lines show it by the experiments that one X (n, n) does not explain, those
between them by X from their neighbours. Friction at motors and behind gears, which has gains of its own,

.. math:: -X\, d_j\, F_j \Phi_j(v_j), \qquad -(X - K^{-1})\, e_j\, F_j \Phi_j(w_j), \qquad F_j \ge 0,

and hysteresis of the gear are fitted beside it. Where the shape lowers V by much, a linear model has the stiffness of
this amplitude alone, though V of its fit may be that of the noise.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray, IntArray
from elastid.base.errors import DataError, Note
from elastid.frf.distortion import interpolated
from elastid.frf.spec import EstimatorSpec
from elastid.model.drivetrain import input_matrix, spring_deflections
from elastid.nonlinear.drives import geometric_torques
from elastid.nonlinear.effects import APART, KINDS, GearEffect, Kind, implicit_law
from elastid.nonlinear.levels import SLIGHT, solve, weights
from elastid.nonlinear.motion import NEIGHBOURS
from elastid.nonlinear.spectra import PeriodLines, gather_lines, some
from elastid.record import Configuration, Record
from elastid.response import BENT, NOT_STRAIGHT
from elastid.robot import Robot

_DROP = 60.0  # of V, by the shape of a spring that is not straight, at least
# Of the RMS: over which a sign turns, and a loop bends.
_TURN, _LOOP = KINDS["friction"].scales[-1], KINDS["stop"].scales[2]
_SHOWN = 1e-3  # of the RMS torque, that a shape must have beyond a straight line


@dataclass(frozen=True)
class Bend:
    """The shape that explains most of what a gear's deflection has beyond a straight line.

    drop: of V, a chi-square variable of one degree of freedom for a straight spring.  torque: RMS of the gear's, Nm.
    softer: change of the compliance by it, as a part of the whole, negative where the spring grows stiffer.
    """

    joint: str
    shape: str
    drop: float
    torque: float
    softer: float


def straightness_notes(
    records: Sequence[Record], robot: Robot, spec: EstimatorSpec, planned: IntArray | None
) -> tuple[Note, ...]:
    """A warning on each gear of a configuration whose spring is not straight.

    None where the records do not say: without a period, torques or angles of all motors, or lines to judge by.
    """
    first = records[0]
    if any(unit not in ("N*m", "N") for unit in first.units_of_inputs):
        return ()
    try:
        bends = tuple(find_bends(gather_lines(records, spec, planned), first.inputs, robot))
    except DataError:
        return ()
    place = f"configuration {first.configuration.name}"
    return tuple(Note(NOT_STRAIGHT, _words(bend), place) for bend in bends)


def _words(bend: Bend) -> str:
    stiffer = f"{100 * abs(bend.softer):.2g} % {'softer' if bend.softer > 0 else 'stiffer'}"
    like = "a gap or lost motion" if bend.shape == "gap" else f"a spring that is about {stiffer} there than unloaded"
    return (
        f"{BENT} {bend.joint} is not straight: at {bend.torque:.3g} N*m RMS in the gear it bends as {like}, "
        "which no friction explains; stiffness and damping are those of this amplitude alone: measure with half and "
        "with twice the torque, and compare"
    )


def find_bends(lines: PeriodLines, inputs: Sequence[str], robot: Robot) -> Iterator[Bend]:
    """Gears with springs that are not straight in the records of a configuration; inputs: motors of `lines`."""
    if set(inputs) != set(robot.motor_locations):
        return
    drives = _Drives.of(robot, inputs)
    problem = _Problem.of(lines, drives)
    if problem is None:
        return
    bent = [i for i, joint in enumerate(drives.joints) if joint and problem.bend(i, joint) is not None]
    if bent:  # the arm's own distortion looks like that of a gear
        problem = problem.on_arm(robot, lines.configuration)
    for i in bent:
        if (bend := problem.bend(i, drives.joints[i])) is not None:
            yield bend


@dataclass(frozen=True, eq=False)
class _Drives:
    """joints (n,): with a spring in the gear, else "".  rows (n, n): deflections of gears by angles of motors.

    inertia (n, n): of the motors on these.  shafts (n, n): angles of shafts by those of motors.  compliance (n,): of
    the robot's file, which friction behind the gears alone depends on.
    """

    joints: tuple[str, ...]
    rows: FloatArray
    inertia: FloatArray
    shafts: FloatArray
    compliance: FloatArray

    @classmethod
    def of(cls, robot: Robot, inputs: Sequence[str]) -> _Drives:
        """Drives of the motors in the order of the inputs."""
        order = [robot.motor_locations.index(place) for place in inputs]
        driven, B = robot.driven, input_matrix(robot)
        springs = spring_deflections(robot)
        rows = np.eye(len(driven))
        compliance = np.zeros(len(driven))
        for i, joint in enumerate(driven):
            if joint.spring is not None:
                compliance[i] = 1 / joint.spring.stiffness
                rows[i] = springs[f"k_{joint.name}"] @ B if f"k_{joint.name}" in springs else rows[i]
        rotors = np.diag([joint.motor.inertia for joint in driven if joint.motor is not None])
        J = robot.eta.T @ rotors @ robot.eta
        back = np.linalg.inv(rows[:, order])
        joints = tuple(joint.name if joint.spring is not None else "" for joint in driven)
        return cls(joints, rows[:, order], back.T @ J[np.ix_(order, order)] @ back, robot.mixing[:, order], compliance)


@dataclass(frozen=True, eq=False)
class _Problem:
    """tau, Q (K, n, M) of gears and X (K, n, n) on the lines used (K,).  torque (n, M, N): on the fine grid, its mean
    apart: load (n, M).  motion (L, n, M): of the joints on lines 1 to L, the highest that is excited.  at_motors:
    torque (n,) on the gears by one on a shaft, and Phi (K, M) of friction there; behind (K, n, M): of that behind the
    gears.  arm (K, n, M): torques of the arm beyond its linearisation, where they are known.
    """

    lines: PeriodLines
    used: IntArray
    tau: ComplexArray
    Q: ComplexArray
    X: ComplexArray
    torque: FloatArray
    load: FloatArray
    compliance: FloatArray
    motion: ComplexArray
    at_motors: list[tuple[FloatArray, ComplexArray]]
    behind: ComplexArray
    arm: ComplexArray | None = None

    @classmethod
    def of(cls, lines: PeriodLines, drives: _Drives) -> _Problem | None:
        """None where too few lines judge."""
        n, M = lines.U.shape[1:]
        on, s = np.flatnonzero(lines.excited), lines.s[:, None, None]
        used = np.arange(on[0], on[-1] + 1)  # X is known between its lines, not beyond them
        if n >= M:  # one X explains any experiments there
            used = used[~lines.excited[used]]
        used = some(used, 100)
        if len(used) < NEIGHBOURS or len(on) < 2:
            return None
        back = np.linalg.inv(drives.rows)
        Q = drives.rows @ lines.Y
        tau = back.T @ lines.U - drives.inertia @ (s**2 * Q)
        s2X = s[on] ** 2 * (Q[on] @ np.linalg.pinv(tau[on]))
        X = interpolated(used, on, s2X) / s[used] ** 2
        shafts, of_file = drives.shafts @ back, drives.compliance[:, None]
        angle, v, w, torque = (
            lines.fine(x.transpose(1, 2, 0)) for x in (shafts @ Q, shafts @ (s * Q), s * (Q - of_file * tau), tau)
        )
        # A sign that turns over a little speed, and a stop; a sign alone behind the gear.
        laws = [(_turning(v[j]), _along("stop", _LOOP * float(np.std(x)), x)) for j, x in enumerate(angle)]
        at_motors = [(shafts[j], _spectra(lines, used, x)) for j, own in enumerate(laws) for x in own]
        behind = np.stack([_spectra(lines, used, _turning(x)) for x in w], axis=1)
        compliance = _compliance(s2X, lines.s[on], drives.compliance)
        motion = (Q - compliance[:, None] * tau)[: on[-1] + 1]
        known = torque, back.T @ lines.load, compliance, motion, at_motors, behind
        return cls(lines, used, tau[used], Q[used], X, *known)

    def on_arm(self, robot: Robot, at: Configuration) -> _Problem:
        """Problem with the arm's torques."""
        torques = geometric_torques(robot, at, self.motion, self.lines.s[: len(self.motion)])
        return replace(self, arm=torques[1 + self.used])

    def bend(self, i: int, joint: str) -> Bend | None:
        """The shape of gear i that explains most; None where its spring is straight."""
        tau, size = self.torque[i], float(np.std(self.torque[i]))
        whole = tau + self.load[i][:, None]
        # A gap only adds to a deflection; the others may be of either sign.
        shapes = {
            "gap": size * np.tanh(whole / (_TURN * size)),
            "progressive": np.abs(whole) * whole / size,
            "cubic": whole * whole * whole / size**2,  # a power of three is slow
        }
        gains = [float(np.mean(x * tau) / np.mean(tau**2)) for x in shapes.values()]
        bent = [x - x.mean(axis=1)[:, None] - g * tau for x, g in zip(shapes.values(), gains, strict=True)]
        stop = _along("stop", _LOOP * size, tau)
        X = self.X[:, i]
        of_links = X - self.compliance[i] * np.eye(len(self.compliance))[i]
        others = [-(X @ place)[:, None] * phi for place, phi in self.at_motors]
        others += [*np.moveaxis(-of_links[:, :, None] * self.behind, 1, 0)]
        if self.arm is not None:
            others.append(-np.einsum("kj,kjm->km", of_links, self.arm))
        others.append(_spectra(self.lines, self.used, stop - np.mean(stop * tau) / np.mean(tau**2) * tau))
        columns = np.stack([*others, *(_spectra(self.lines, self.used, x) for x in bent)], axis=2)
        A, b = self._whitened(i, columns, len(others) + 1)
        R = len(others)
        V = _solve(A[:, :R], b, R)[1]
        # A gear that its load never lets cross zero has no gap to show.
        known = [m for m, x in enumerate(bent) if np.std(x) > _SHOWN * size]
        trials = {m: _solve(A[:, [*range(R), R + m]], b, R + (m == 0)) for m in known}
        best = min(trials, key=lambda m: trials[m][1])
        level, drop = float(trials[best][0][-1]), V - trials[best][1]
        if not drop > max(_DROP, SLIGHT * V):
            return None
        return Bend(joint, list(shapes)[best], drop, size, level * gains[best] / self.compliance[i])

    @cached_property
    def _basis(self) -> ComplexArray:
        """Basis of the torques' span over the experiments (K_on, M, n), at excited lines."""
        torques = self.tau[self.lines.excited[self.used]]
        return np.asarray(np.linalg.svd(torques.swapaxes(1, 2), full_matrices=False)[0])

    def _whitened(self, i: int, columns: ComplexArray, brakes: int) -> tuple[FloatArray, FloatArray]:
        """Real columns (2 K M, n_c) and what a straight spring leaves of angle i (2 K M,), over its residuals' std."""
        on = self.lines.excited[self.used]
        n, M = self.tau.shape[1:]
        basis, adjoint = self._basis, self._basis.conj().swapaxes(1, 2)

        def left(x: ComplexArray) -> ComplexArray:
            """Part of x (K, M, m), on excited lines, that no torque explains."""
            x = x.copy()
            x[on] -= basis @ (adjoint @ x[on])
            return x

        straight = np.where(on[:, None], 0.0, np.einsum("kj,kjm->km", self.X[:, i], self.tau))
        y, columns = left((self.Q[:, i] - straight)[:, :, None]), left(columns)
        dof = np.where(on, M - n, M)
        w = weights(np.sum(np.abs(y[:, :, 0]) ** 2, axis=1) / dof, on)
        e = y[:, :, 0] - columns @ _solve(_real(columns, w), _real(y, w)[:, 0], brakes)[0]
        w = weights(np.sum(np.abs(e) ** 2, axis=1) / dof, on)
        return _real(columns, w), _real(y, w)[:, 0]


def _turning(v: FloatArray) -> FloatArray:
    """A sign of v (M, N) that turns over a part of its size."""
    return np.tanh(v / (_TURN * np.std(v)))


def _along(kind: Kind, scale: float, x: FloatArray) -> FloatArray:
    """A shape with memory along x (M, N)."""
    return np.array([implicit_law(GearEffect(kind, "", scale), row)[0] for row in x])


def _spectra(lines: PeriodLines, used: IntArray, x: FloatArray) -> ComplexArray:
    """Amplitudes (K, M) of signals (M, N)."""
    return np.asarray(lines.amplitudes(x)[:, used].T)


def _compliance(s2X: ComplexArray, s: ComplexArray, of_file: FloatArray) -> FloatArray:
    """1 / k (n,) of s^2 X_ii = 1 / m + s^2 / k, of the robot's file where modes of the arm bend that line."""
    columns = np.stack([np.ones(len(s)), (s**2).real], axis=1)
    found = np.linalg.lstsq(columns, np.einsum("kii->ki", s2X).real, rcond=None)[0][1]
    is_near = (found > of_file / APART) & (found < of_file * APART)
    return np.asarray(np.where(is_near, found, of_file))


def _real(x: ComplexArray, w: FloatArray) -> FloatArray:
    """Rows (2 K M, m) of x (K, M, m) over the standard deviation of each part; w (K,): 1 over the variance of both."""
    rows = (x * np.sqrt(2 * w)[:, None, None]).reshape(-1, x.shape[2])
    return np.concatenate([rows.real, rows.imag])


def _solve(A: FloatArray, b: FloatArray, brakes: int) -> tuple[FloatArray, float]:
    """Least squares x of A x = b and its V; the first `brakes` of x are not negative."""
    both, n = np.concatenate([A, -A[:, brakes:]], axis=1), A.shape[1]
    f = solve(both.T @ both, both.T @ b)
    x = np.concatenate([f[:brakes], f[brakes:n] - f[n:]])
    return x, float(np.sum((b - A @ x) ** 2))
