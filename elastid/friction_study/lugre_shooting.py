r"""LuGre friction of an elastic joint from the motor's angle and torque, by multiple shooting.

The log is cut into intervals of a few samples, each simulated from a state of its own:

.. math:: \min_{p, x_1 \dots x_K} \sum_k \left\| \frac{y - q_m(x_k, p)}{\sigma_y} \right\|^2
          + \sum_k \left\| W_k^{-1/2} (x_k^{end} - x_{k+1}) \right\|^2 + (\ln p - \ln p_0)^T \Lambda (\ln p - \ln p_0)

W_k is the covariance that torque noise gives the end of an interval: without gaps the output error drifts by far more
than the encoder's noise, so that the gaps are the noise model and no numerical trick. Gauss-Newton over ln p and all
states, by one sparse factorisation of the normal equations a step: SciPy's searches take a dense Jacobian, or an
iterative solver that these states of different sizes make slow. (Bock, Recent advances in
parameter identification techniques for ODE, 1983.) The last term is the knowledge of the static numbers from passes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
from scipy.sparse import block_diag, csc_matrix, diags, hstack, vstack
from scipy.sparse.linalg import SuperLU, splu

from elastid.base.arrays import FloatArray, frozen_value
from elastid.base.errors import FitError
from elastid.base.statistics import QUANTILE_95
from elastid.simulation.elastic_joint import FRICTION, STATES, ElasticJoint

# Samples of an interval.
INTERVAL = 20
# A step that changes the cost by less has converged: of 8000 samples that is a quarter of a standard deviation.
MIN_PROGRESS = 1e-5


@frozen_value
class JointLog:
    """Torque (n,) held from sample to sample and angle (n,) of the motor at the end of each sample, one side, SI.

    torque_std, angle_std: of their noise, white; an encoder's counts have count / sqrt(12).
    """

    place: str
    rate_hz: float
    torque: FloatArray
    angle: FloatArray
    torque_std: float
    angle_std: float


@dataclass(frozen=True)
class LuGreFit:
    """The numbers by name, covariance of their logarithms (6, 6), cost and degrees of freedom."""

    values: Mapping[str, float]
    covariance: FloatArray
    cost: float
    dof: int
    iterations: int

    def interval(self, name: str) -> tuple[float, float]:
        """95 %, symmetric in the logarithm."""
        reach = QUANTILE_95 * float(np.sqrt(self.covariance[FRICTION.index(name), FRICTION.index(name)]))
        return self.values[name] * float(np.exp(-reach)), self.values[name] * float(np.exp(reach))


def fit_lugre(
    log: JointLog,
    joint: ElasticJoint,
    start: Mapping[str, float],
    prior: Prior | None = None,
    exponent: float = 2.0,
) -> LuGreFit:
    """All six numbers from a log that sticks, breaks away and slides.

    prior: from passes and responses at rest; `start` needs only the numbers that it does not have.
    exponent: of the Stribeck curve.
    Where the residual of a search is far above the noise, it begins again with stiffer and with softer bristles.
    Raises FitError where the log is shorter than a few intervals, or no search explains it.
    """
    known = prior or Prior(np.zeros(len(FRICTION)), np.zeros((len(FRICTION),) * 2))
    begin = {**start, **known.known}
    problem = _Problem.of(log, joint.step(log.rate_hz, exponent=exponent), begin, known)
    first, X = np.log([begin[name] for name in FRICTION]), problem.first_states()
    dof = len(log.angle) - len(FRICTION)
    searches: list[_Search] = []
    for factor in (1.0, 2.0, 0.5):  # of the stiffness of the bristles
        p = first + np.log(factor) * np.eye(len(FRICTION))[0]
        searches.append(_Search(p, X, problem.at(p, X)).descended(problem, 8))
        if searches[-1].system.cost < 1.25 * dof:
            break
    best = min(searches, key=lambda search: search.system.cost).descended(problem, 60)
    cost = best.system.cost
    if not cost < 2.0 * dof:
        raise FitError(
            "friction/law",
            f"the best LuGre law leaves {cost / dof:.2g} times what the noise explains; start "
            "nearer (passes give the static numbers), check inertia and stiffness of the joint and the stds of torque "
            "and angle, or take Maxwell slip",
            f"friction of {log.place}",
        )
    covariance = best.system.covariance() * max(1.0, cost / dof)
    return LuGreFit(dict(zip(FRICTION, np.exp(best.p).tolist(), strict=True)), covariance, cost, dof, best.iterations)


@dataclass(frozen=True)
class _Search:
    """Where a search is: ln p (6,), states (K, 5), its normal equations and damping, and whether it has ended."""

    p: FloatArray
    X: FloatArray
    system: _System
    damping: float = 1e-3
    iterations: int = 0
    has_ended: bool = False

    def descended(self, problem: _Problem, iterations: int) -> _Search:
        """The search when it has ended, or has made so many iterations."""
        search = self
        while not search.has_ended and search.iterations < iterations:
            search = search.next(problem)
        return search

    def next(self, problem: _Problem) -> _Search:
        """After one step, as long as the problem allows; damped less only where the first length was right."""
        damping, cost = self.damping, self.system.cost
        while True:
            dp, dX = self.system.step(damping)
            p, X = self.p + np.clip(dp, -1.0, 1.0), self.X + dX
            system = problem.at(p, X)
            if system.cost < (1 + MIN_PROGRESS) * cost or damping > 1e8:
                break
            damping *= 10
        if system.cost >= cost:
            return replace(self, has_ended=True)
        damping = max(damping / 10, 1e-9) if damping == self.damping else damping
        return _Search(p, X, system, damping, self.iterations + 1, cost - system.cost < MIN_PROGRESS * cost)


@dataclass(frozen=True)
class _System:
    """Normal equations N d = g for changes d of the states of all intervals, then of ln p; infinite cost: none."""

    cost: float
    N: csc_matrix
    g: FloatArray

    def step(self, damping: float) -> tuple[FloatArray, FloatArray]:
        """Changes of ln p (6,) and of the states (K, 5)."""
        d = _factor(self.N + damping * diags(self.N.diagonal())).solve(self.g)
        return d[-len(FRICTION) :], d[: -len(FRICTION)].reshape(-1, len(STATES))

    def covariance(self) -> FloatArray:
        """Of ln p (6, 6), the states eliminated."""
        last = np.eye(len(self.g))[:, -len(FRICTION) :]
        return np.asarray(_factor(self.N).solve(last)[-len(FRICTION) :])


def _factor(N: csc_matrix) -> SuperLU:
    """Factors of a positive definite matrix; its order, intervals one after the other and then ln p, has no fill."""
    return splu(csc_matrix(N), permc_spec="NATURAL", diag_pivot_thresh=0.0)


_NO_SYSTEM = _System(np.inf, csc_matrix((0, 0)), np.zeros(0))


@dataclass(frozen=True)
class _Problem:
    """A log cut into K intervals, and the functions that simulate them: torque, angle (K, INTERVAL).

    scale (5,): of the states.  bend: of bristles before they slide, by the start.
    """

    log: JointLog
    simulate: ca.Function
    noise_gain: ca.Function
    torque: FloatArray
    angle: FloatArray
    scale: FloatArray
    bend: float
    prior: Prior

    @classmethod
    def of(cls, log: JointLog, step: ca.Function, start: Mapping[str, float], prior: Prior) -> _Problem:
        """The intervals of a log; FitError where they are too few."""
        K = len(log.angle) // INTERVAL
        if K < 10:
            raise FitError(
                "friction/law",
                f"{len(log.angle)} samples are too few; record seconds of motion",
                f"friction of {log.place}",
            )
        x, lnp, u = ca.SX.sym("x", len(STATES)), ca.SX.sym("p", len(FRICTION)), ca.SX.sym("u", INTERVAL)
        state, angles = x, []
        for i in range(INTERVAL):
            state = step(state, ca.exp(lnp), u[i])
            angles.append(state[0])
        out, given = ca.vertcat(*angles, state), ca.vertcat(x, lnp)
        simulate = ca.Function("simulate", [x, lnp, u], [out, ca.jacobian(out, given)], {"cse": True})
        gain = ca.Function("gain", [x, lnp, u], [ca.jacobian(state, u)], {"cse": True})
        bend = start["coulomb"] / start["sigma_0"]
        scale = np.array([log.angle_std, log.angle_std * log.rate_hz / INTERVAL] * 2 + [bend])
        cut = slice(0, K * INTERVAL)
        return cls(
            log, simulate.map(K), gain.map(K), log.torque[cut].reshape(K, -1), log.angle[cut].reshape(K, -1), scale,
            bend, prior,
        )  # fmt: skip

    def first_states(self) -> FloatArray:
        """States (K, 5) at the beginning of the intervals: the measured motion, link and motor together."""
        q = np.concatenate([[self.angle[0, 0]], self.angle.ravel()])
        width = max(3, INTERVAL // 2)
        v = np.convolve(np.gradient(q) * self.log.rate_hz, np.ones(width) / width, "same")
        z = np.empty_like(q)
        bend = 0.0
        for i, moved in enumerate(np.diff(q, prepend=q[0]).tolist()):
            bend = min(max(bend + moved, -self.bend), self.bend)
            z[i] = bend
        return np.stack([q, v, q, v, z], axis=1)[: len(q) - 1 : INTERVAL]

    def at(self, p: FloatArray, X: FloatArray) -> _System:
        """The normal equations at ln p (6,) and states X (K, 5)."""
        K, n_x, n_p = len(X), len(STATES), len(FRICTION)
        given = X.T, np.tile(p[:, None], K), self.torque.T
        out, slopes = self.simulate(*given)
        Y = out.full().T
        J = slopes.full().reshape(INTERVAL + n_x, K, n_x + n_p).transpose(1, 0, 2)
        gains = self.noise_gain(*given).full().reshape(n_x, K, INTERVAL).transpose(1, 0, 2)
        # Rounding and integration error of a gap, of the std of the angle and of the bend of the bristles.
        floor = np.diag(np.append(0.05 * self.scale[:4], 1e-3 * self.scale[4]) ** 2)
        W = self.log.torque_std**2 * gains @ gains.transpose(0, 2, 1) + floor
        try:
            root = np.linalg.inv(np.linalg.cholesky(W[:-1]))
        except np.linalg.LinAlgError:
            return _NO_SYSTEM
        angle = (self.angle - Y[:, :INTERVAL]) / self.log.angle_std
        gap = np.einsum("kij,kj->ki", root, X[1:] - Y[:-1, INTERVAL:])
        by_angle, by_gap = J[:, :INTERVAL] / self.log.angle_std, root @ J[:-1, INTERVAL:]
        far = p - self.prior.mean
        cost = float(np.sum(angle**2) + np.sum(gap**2) + far @ self.prior.information @ far)
        if not np.isfinite(cost):
            return _NO_SYSTEM
        # Residuals fall along A d; the next interval's state enters its gap with the opposite sign.
        own, following = block_diag(by_gap[:, :, :n_x]), block_diag(root)
        none = csc_matrix(((K - 1) * n_x, n_x))
        A = vstack([
            hstack([block_diag(by_angle[:, :, :n_x]), by_angle[:, :, n_x:].reshape(-1, n_p)]),
            hstack([hstack([own, none]) - hstack([none, following]), by_gap[:, :, n_x:].reshape(-1, n_p)]),
        ]).tocsc()  # fmt: skip
        known = block_diag([csc_matrix((K * n_x, K * n_x)), self.prior.information])
        g = A.T @ np.concatenate([angle.ravel(), gap.ravel()])
        g[-n_p:] -= self.prior.information @ far
        return _System(cost, csc_matrix(A.T @ A + known), g)


@frozen_value
class Prior:
    """ln of the numbers of `FRICTION`: mean (6,), and information (6, 6), the inverse covariance; 0 of unknown ones."""

    mean: FloatArray
    information: FloatArray

    @classmethod
    def of(cls, values: Mapping[str, float], covariance: FloatArray) -> Prior:
        """From numbers by name and their covariance in this order, to first order in the logarithm.

        A number that is not positive has no logarithm and is left out, with the others' variances as they are.
        """
        names, value = list(values), np.array(list(values.values()))
        used = [i for i, name in enumerate(names) if name in FRICTION and value[i] > 0]
        rows = [FRICTION.index(names[i]) for i in used]
        mean, information = np.zeros(len(FRICTION)), np.zeros((len(FRICTION),) * 2)
        mean[rows] = np.log(value[used])
        relative = covariance[np.ix_(used, used)] / np.outer(value[used], value[used])
        information[np.ix_(rows, rows)] = np.linalg.inv(relative)
        return cls(mean, information)

    def with_other(self, other: Prior) -> Prior:
        """The knowledge of both, of different numbers."""
        return Prior(self.mean + other.mean, self.information + other.information)

    @property
    def known(self) -> dict[str, float]:
        """The numbers with a mean, by name."""
        used = np.diag(self.information) > 0
        return {name: float(np.exp(x)) for name, x, known in zip(FRICTION, self.mean, used, strict=True) if known}
