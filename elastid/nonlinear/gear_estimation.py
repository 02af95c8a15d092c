r"""Joint estimation of gear magnitudes and model parameters from all lines of the records, excited or not.

.. math:: V(x, f) = \sum_{c, k, m} r^H S^{-1} r + priors, \qquad
          r = y - G(x)\, u + C H(x) \sum_i f_i P_i \Phi_i(\hat q)

S is the covariance of the residuals, averaged over experiments and neighbouring lines relative to the covariance that
noise of torques and angles causes: unexplained motion widens the intervals. Gauss-Newton steps of x and f at fixed
motion alternate with estimates of the motion at the new x and f until convergence. The fit of a strongly nonlinear
gear starts at the linear fit; no amplitude has to be small. Columns f_i d Phi_i / d s estimate the scales s of effects
together with the magnitudes.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.linear.linearise import Linearisation
from elastid.linear.response.derivatives import Columns
from elastid.nonlinear.basis_functions import GearEffect
from elastid.nonlinear.hidden_motion_smoother import SmoothedMotion, residuals, smooth_motion, smoothed_covariance
from elastid.nonlinear.period_lines import PeriodLines
from elastid.nonlinear.period_model import DriveLines, drive_lines
from elastid.nonlinear.variable_projection import inverse
from elastid.parameters import Parameters
from elastid.record import MOTION_ORDER
from elastid.response import Response

ROUNDS, MOVE = 25, 0.05  # most iterations, and the largest step over the standard deviation of a number at the end
_STEP = 0.5  # largest relative step of a positive number or a scale
MIN_SIGNIFICANCE = 3.0  # least magnitude over its std of an effect whose scale is estimated and that is not discarded


@dataclass(frozen=True, eq=False)
class GearEstimate:
    """Estimate of parameters x (n_x,) and magnitudes (n_f,) with their covariance (n_x + n_f, n_x + n_f).

    weighted_cost: sum of ln det S of the residuals (-2 ln likelihood), to compare alternatives.  estimates: motion in
    each configuration.  scale_std (n_f,): std of the effects' scales, 0 for scales that are not estimated.
    """

    parameters: Parameters
    effects: tuple[GearEffect, ...]
    x: FloatArray
    magnitudes: FloatArray
    covariance: FloatArray
    weighted_cost: float
    estimates: tuple[SmoothedMotion, ...]
    drives: tuple[DriveLines, ...]
    scale_std: FloatArray

    @property
    def std(self) -> FloatArray:
        """Standard deviation (n_f,) of the magnitudes."""
        return np.sqrt(np.diag(self.covariance)[len(self.x) :])

    def magnitudes_of(self, effects: Sequence[GearEffect]) -> FloatArray:
        """Return the magnitudes of any effects; 0 of effects that this estimate does not have."""
        magnitudes = dict(zip(self.effects, self.magnitudes.tolist(), strict=True))
        return np.array([magnitudes.get(effect, 0.0) for effect in effects])

    def motions_of(self, effects: Sequence[GearEffect], further: int = 0) -> list[SmoothedMotion]:
        """Return the motions with the forces of any effects; 0 for effects without an estimate and `further` ones."""
        index_of = {effect: i for i, effect in enumerate(self.effects)}
        columns = [*(index_of.get(effect, -1) for effect in effects), *(-1,) * further]
        return [motion.select(columns) for motion in self.estimates]


@dataclass(frozen=True, eq=False)
class GearData:
    """Lines of each configuration, its fitted response, and the linear model of the robot."""

    lines: Sequence[PeriodLines]
    responses: Sequence[Response]
    linearisation: Linearisation

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the driven joints."""
        return self.linearisation.model.robot.driven_names

    def drives(self, parameters: Parameters, x: FloatArray) -> list[DriveLines]:
        """Return the model of each configuration at x (n_x,)."""
        pairs = zip(self.lines, self.responses, strict=True)
        return [drive_lines(lines, self.linearisation, G, parameters, x) for lines, G in pairs]

    def motions(
        self, drives: Sequence[DriveLines], effects: Sequence[GearEffect], magnitudes: FloatArray,
        previous: Sequence[SmoothedMotion], tolerance: float = 1e-4,
    ) -> list[SmoothedMotion]:  # fmt: skip
        """Return the motion in each configuration by `smooth_motion`, with effects of these magnitudes (n_f,)."""
        rows = zip(self.lines, drives, previous, strict=True)
        return [smooth_motion(lines, drive, effects, magnitudes, start, tolerance) for lines, drive, start in rows]

    def joint_normal_equations(
        self, estimate: GearEstimate, further: Sequence[GearEffect]
    ) -> "tuple[Sums, tuple[FloatArray, FloatArray]]":
        """Return normal equations and priors of parameters and magnitudes, further effects with magnitude 0."""
        effects, drives = [*estimate.effects, *further], self.drives(estimate.parameters, estimate.x)
        magnitudes = estimate.magnitudes_of(effects)
        estimates = self.motions(drives, effects, magnitudes, estimate.motions_of(effects))
        sums, _ = normal_equations(self.lines, drives, estimates, len(estimate.x), magnitudes)
        return sums, priors(estimate.parameters, estimate.x, len(estimate.x) + len(magnitudes))


def estimate_gear_parameters(
    data: GearData, start: GearEstimate, effects: Sequence[GearEffect], tolerance: float = MOVE,
    fixed: Collection[GearEffect] = (), target_cost: float = np.inf
) -> GearEstimate:  # fmt: skip
    """Estimate parameters and magnitudes of the effects from a start, which may lack some of the effects.

    tolerance: largest step over its standard deviation at which the iteration ends.  fixed: effects with fixed scales.
    target_cost: the iteration also ends if the last decrease of weighted_cost was less than its distance to this value.
    """
    parameters, x, n_x, n_f = start.parameters, start.x, len(start.x), len(effects)
    magnitudes = start.magnitudes_of(effects)
    scales = [group for group in scales_of(effects) if not any(effects[i] in fixed for i in group)]
    estimates = start.motions_of(effects, sum(len(group) for group in scales))
    effects = _update_scales(effects, scales, np.zeros(len(scales)))
    covariance, std, weighted_cost = np.zeros((0, 0)), np.zeros(n_x + n_f), np.inf
    for count in range(1, ROUNDS + 1):
        drives = data.drives(parameters, x)
        elements = [*effects, *(edge for group in scales for i in group if (edge := effects[i].edge) is not None)]
        with_edges = np.concatenate([magnitudes, np.zeros(len(elements) - n_f)])
        for _ in range(1 if start.effects or count > 1 else 2):
            estimates = data.motions(drives, elements, with_edges, estimates, tolerance / 500)
        (A, b, _), cost = normal_equations(data.lines, drives, estimates, n_x, with_edges)
        T = _scale_jacobian(effects, magnitudes, scales, n_x)
        A, b = T.T @ A.sum(axis=0) @ T, T.T @ b.sum(axis=0)
        prior_curvature, pull = priors(parameters, x, len(b))
        np.fill_diagonal(prior_curvature[n_x + n_f :, n_x + n_f :], scale_priors(A, magnitudes, std, scales, n_x))
        covariance = inverse(A + prior_curvature)
        step = covariance @ (b + pull)
        std = np.sqrt(np.diag(covariance))
        # The steps of scales do not count, because the magnitudes hardly depend on them.
        last_step_norm = float(np.max((np.abs(step) / np.where(std > 0, std, np.inf))[: n_x + n_f]))
        # The response is nearly linear in the number itself, x is its logarithm.
        x = x + np.where(parameters.is_log, np.log1p(np.clip(step[:n_x], -_STEP, _STEP)), step[:n_x])
        magnitudes = magnitudes + step[n_x : n_x + n_f]
        effects = _update_scales(effects, scales, step[n_x + n_f :])
        if last_step_norm < tolerance or (count > 2 and cost - target_cost > weighted_cost - cost):
            break
        weighted_cost = cost
    scale_std = np.zeros(n_f)
    for group, relative in zip(scales, std[n_x + n_f :], strict=True):
        scale_std[group] = [relative * effects[i].scale for i in group]
    covariance, estimated = covariance[: n_x + n_f, : n_x + n_f], tuple(e.select(range(n_f)) for e in estimates)
    end = tuple(effects), x, magnitudes, covariance, cost
    return GearEstimate(parameters, *end, estimated, tuple(drives), scale_std)


def scales_of(effects: Sequence[GearEffect]) -> list[list[int]]:
    """Group the indices of effects by scale: all friction effects of a motor share one smoothing velocity."""
    groups: dict[tuple[object, ...], list[int]] = {}
    for i, effect in enumerate(effects):
        if effect.edge is not None:
            groups.setdefault(("motor", effect.joint) if effect.kind in ("friction", "load") else (i,), []).append(i)
    return list(groups.values())


def _scale_jacobian(
    effects: Sequence[GearEffect], magnitudes: FloatArray, scales: Sequence[Sequence[int]], n_x: int
) -> FloatArray:
    """Return T (n, n_x + n_f + n_s): parameters, magnitudes and magnitudes of edges by parameters, f and ln scales."""
    size, edges = n_x + len(magnitudes), [(s, i) for s, group in enumerate(scales) for i in group]
    T = np.zeros((size + len(edges), size + len(scales)))
    T[:size, :size] = np.eye(size)
    for row, (s, i) in enumerate(edges):
        T[size + row, size + s] = magnitudes[i] * effects[i].scale
    return T


def scale_priors(
    A: FloatArray, magnitudes: FloatArray, std: FloatArray, scales: Sequence[Sequence[int]], n_x: int
) -> FloatArray:
    """Return weights (n_s,) of priors on ln scale with std 1; scales of insignificant magnitudes stay fixed.

    A: normal matrix of parameters, magnitudes and scales.  magnitudes (n_f,), std (n_x + n_f + ...,): of the previous
    iteration; std is 0 in the first.
    """
    priors = np.ones(len(scales))
    for s, group in enumerate(scales):
        # The scale of a negligible effect is not identifiable.
        if np.all(np.abs(magnitudes[group]) < MIN_SIGNIFICANCE * std[n_x:][group]):
            priors[s] = 1e12 * max(1.0, float(A[n_x + len(magnitudes) + s, n_x + len(magnitudes) + s]))
    return priors


def _update_scales(
    effects: Sequence[GearEffect], scales: Sequence[Sequence[int]], steps: FloatArray
) -> list[GearEffect]:
    """Return effects with the scale of each group increased by a fraction; steps (n_s,), limited to _STEP."""
    next_effects = list(effects)
    for group, step in zip(scales, np.clip(steps, -_STEP, _STEP).tolist(), strict=True):
        for i in group:
            next_effects[i] = replace(effects[i], scale=effects[group[0]].scale * (1 + step))
    return next_effects


def initial_estimate(data: GearData, parameters: Parameters, x: FloatArray) -> GearEstimate:
    """Return an estimate without effects at x (n_x,)."""
    drives, empty = tuple(data.drives(parameters, x)), np.zeros(0)
    estimates = tuple(SmoothedMotion.start(c, drive, 0) for c, drive in zip(data.lines, drives, strict=True))
    (A, *_), weighted_cost = normal_equations(data.lines, drives, estimates, len(x), empty)
    prior, _ = priors(parameters, x, len(x))
    covariance = inverse(A.sum(axis=0) + prior)
    return GearEstimate(parameters, (), x, empty, covariance, weighted_cost, estimates, drives, empty)


# Sums over lines and experiments of each realisation: A (R, n, n), b (R, n), c (R,) of J^H J, J^H r and r^H r.
Sums: TypeAlias = tuple[FloatArray, FloatArray, FloatArray]


def normal_equations(
    data: Sequence[PeriodLines], drives: Sequence[DriveLines], estimates: Sequence[SmoothedMotion], n_x: int,
    magnitudes: FloatArray
) -> tuple[Sums, float]:  # fmt: skip
    """Sum the normal equations about magnitudes (n_f,) at fixed motion, without priors, and the weighted cost.

    Residuals have unit variance in each real component; n = n_x + n_f.
    """
    realisations = np.unique(np.concatenate([lines.realisation for lines in data]))
    R, n = len(realisations), n_x + len(magnitudes)
    A, b, c, weighted_cost = np.zeros((R, n, n)), np.zeros((R, n)), np.zeros(R), 0.0
    for lines, drive, estimate in zip(data, drives, estimates, strict=True):
        r = residuals(lines, drive, estimate, magnitudes)
        excited = np.flatnonzero(lines.excited)
        # The excited lines, the lines between them, and some on either side.
        band = slice(int(excited[0]) // 2, min(len(lines.s), int(1.2 * excited[-1]) + 1))
        S = smoothed_covariance(r, lines, drive)[band]
        weighted_cost += 2 * lines.U.shape[2] * float(np.linalg.slogdet(S)[1].sum())
        white = np.linalg.inv(np.linalg.cholesky(S / 2))
        J = np.einsum("fij,fjmp->fimp", white, _jacobian(lines, drive, estimate, magnitudes, n_x, band))
        e = white @ r[band]
        for i in np.searchsorted(realisations, np.unique(lines.realisation)):
            mask = lines.realisation == realisations[i]
            J_i, e_i = J[:, :, mask].reshape(-1, n), e[:, :, mask].ravel()
            A[i] += (J_i.conj().T @ J_i).real
            b[i] += (J_i.conj().T @ e_i).real
            c[i] += float(np.sum(np.abs(e_i) ** 2))
    return (A, b, c), weighted_cost


def priors(parameters: Parameters, x: FloatArray, n: int) -> tuple[FloatArray, FloatArray]:
    """Return the contributions of the priors to A (n, n) and b (n,) at x (n_x,)."""
    distance, slope = parameters.priors(x)
    return np.diag(np.pad(slope**2, (0, n - len(x)))), np.pad(-slope * distance, (0, n - len(x)))


def _jacobian(
    lines: PeriodLines, drive: DriveLines, estimate: SmoothedMotion, magnitudes: FloatArray, n_x: int, band: slice
) -> ComplexArray:
    """Return -dr / d(x, f) (K, n_u, M, n_x + n_f) at the K DFT lines of the band for a fixed motion."""
    s, U, Phi = lines.s[band, None, None], lines.U[band], estimate.Phi[band]
    H, sensor = drive.H[band], drive.sensor[band, :, None]
    J = np.zeros((*U.shape, n_x + len(magnitudes)), complex)
    dG = Columns(drive.kernel).evaluate(drive.theta)[1][:, band] / s ** MOTION_ORDER[drive.model.quantity]
    CH = drive.C @ H
    q = H @ np.tensordot(Phi, magnitudes, axes=1)
    for row, name, line_slope in zip(drive.chain, drive.kernel.parameters, dG, strict=True):
        slope = line_slope @ U
        change = drive.model.slopes.get(name)
        if change is not None:
            terms = [A * s**power for power, A in enumerate((change.K, change.D, change.M)) if A is not None]
            slope = slope + sensor * (CH @ (sum(terms) @ q))
        J[..., :n_x] += slope[..., None] * row
    J[..., n_x:] = -sensor[..., None] * (np.einsum("fan,fnmi->fami", CH, Phi) + estimate.folded[band])
    return J
