r"""Estimate of gear magnitudes and model parameters together, from all lines of the records, excited or not.

.. math:: V(x, f) = \sum_{c, k, m} r^H S^{-1} r + priors, \qquad
          r = y - G(x)\, u + C H(x) \sum_i f_i P_i \Phi_i(\hat q)

with S the covariance of the residuals, averaged over experiments and neighbouring lines as a multiple of what the model
makes of noise of torques and angles, so that what it does not explain widens the intervals. Gauss-Newton in x and f
with the motion fixed, then the motion along the new x and f, until neither moves. The fit of a strongly nonlinear gear
starts from that of a linear one and needs no amplitude to be small. Scales s are found with the magnitudes, by the
change f_i d Phi_i / d s of every effect that turns or bends over s.
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
from elastid.nonlinear.period_model import DriveLines, drive_lines
from elastid.nonlinear.spectra import PeriodLines
from elastid.nonlinear.variable_projection import inverse
from elastid.parameters import Parameters
from elastid.record import MOTION_ORDER
from elastid.response import Response

ROUNDS, MOVE = 25, 0.05  # until no number moves by more than this part of its standard deviation
_STEP = 0.5  # of itself, by which a positive number or a scale falls or grows at once, at most
MIN_SIGNIFICANCE = 3.0  # std of a magnitude, from which on its scale moves, and below which it is discarded at the end


@dataclass(frozen=True, eq=False)
class GearEstimate:
    """x (n_x,) of the parameters and magnitudes (n_f,) of the effects, with their covariance (n_x + n_f, n_x + n_f).

    weighted_cost: sum of ln det S of the residuals (-2 ln likelihood), by which alternatives are compared.
    scale_std (n_f,): std of the effects' scales, 0 for scales that are not estimated.
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
        """Return magnitudes of any effects, 0 of those that are not among these."""
        magnitudes = dict(zip(self.effects, self.magnitudes.tolist(), strict=True))
        return np.array([magnitudes.get(effect, 0.0) for effect in effects])

    def motions_of(self, effects: Sequence[GearEffect], further: int = 0) -> list[SmoothedMotion]:
        """Return the estimated motions with forces of any effects, 0 of those not among these and of further ones."""
        index_of = {effect: i for i, effect in enumerate(self.effects)}
        columns = [*(index_of.get(effect, -1) for effect in effects), *(-1,) * further]
        return [motion.of(columns) for motion in self.estimates]


@dataclass(frozen=True, eq=False)
class GearData:
    """Lines of each configuration, its response as fitted, and the linear model of the robot."""

    lines: Sequence[PeriodLines]
    responses: Sequence[Response]
    linearisation: Linearisation

    @property
    def joints(self) -> tuple[str, ...]:
        """The driven ones."""
        return self.linearisation.model.robot.driven_names

    def drives(self, parameters: Parameters, x: FloatArray) -> list[DriveLines]:
        """Return the model of each configuration at x (n_x,)."""
        pairs = zip(self.lines, self.responses, strict=True)
        return [drive_lines(lines, self.linearisation, G, parameters, x) for lines, G in pairs]

    def motions(
        self, drives: Sequence[DriveLines], effects: Sequence[GearEffect], magnitudes: FloatArray,
        previous: Sequence[SmoothedMotion], tolerance: float = 1e-4,
    ) -> list[SmoothedMotion]:  # fmt: skip
        """Return the motion in each configuration under effects of given magnitudes, as `smooth_motion` has it."""
        rows = zip(self.lines, drives, previous, strict=True)
        return [smooth_motion(lines, drive, effects, magnitudes, start, tolerance) for lines, drive, start in rows]

    def joint_normal_equations(
        self, estimate: GearEstimate, further: Sequence[GearEffect]
    ) -> "tuple[Sums, tuple[FloatArray, FloatArray]]":
        """Return normal equations, and priors, of parameters, magnitudes and magnitudes of further effects about 0."""
        effects, drives = [*estimate.effects, *further], self.drives(estimate.parameters, estimate.x)
        magnitudes = estimate.magnitudes_of(effects)
        estimates = self.motions(drives, effects, magnitudes, estimate.motions_of(effects))
        sums, _ = normal_equations(self.lines, drives, estimates, len(estimate.x), magnitudes)
        return sums, priors(estimate.parameters, estimate.x, len(estimate.x) + len(magnitudes))


def estimate_gear_parameters(
    data: GearData,
    start: GearEstimate,
    effects: Sequence[GearEffect],
    tolerance: float = MOVE,
    fixed: Collection[GearEffect] = (),
    target_cost: float = np.inf,
) -> GearEstimate:
    """Estimate parameters and magnitudes of the effects from another estimate, or without one (`initial_estimate`); 0
    for new effects.

    tolerance: largest step over its standard deviation at which the iteration ends.  fixed: effects whose scales stay.
    target_cost: the iteration also ends if the last round decreased weighted_cost by less than its distance to this
    value.
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
        # A scale, which magnitudes hardly follow, comes to rest with them.
        last_step_norm = float(np.max((np.abs(step) / np.where(std > 0, std, np.inf))[: n_x + n_f]))
        # The response is nearly linear in the number itself, of which the logarithm is to be found.
        x = x + np.where(parameters.is_log, np.log1p(np.clip(step[:n_x], -_STEP, _STEP)), step[:n_x])
        magnitudes = magnitudes + step[n_x : n_x + n_f]
        effects = _update_scales(effects, scales, step[n_x + n_f :])
        if last_step_norm < tolerance or (count > 2 and cost - target_cost > weighted_cost - cost):
            break
        weighted_cost = cost
    scale_std = np.zeros(n_f)
    for group, relative in zip(scales, std[n_x + n_f :], strict=True):
        scale_std[group] = [relative * effects[i].scale for i in group]
    covariance, estimated = covariance[: n_x + n_f, : n_x + n_f], tuple(e.of(range(n_f)) for e in estimates)
    end = tuple(effects), x, magnitudes, covariance, cost
    return GearEstimate(parameters, *end, estimated, tuple(drives), scale_std)


def scales_of(effects: Sequence[GearEffect]) -> list[list[int]]:
    """Group effects by scale: all friction effects of a motor share one smoothing velocity."""
    groups: dict[tuple[object, ...], list[int]] = {}
    for i, effect in enumerate(effects):
        if effect.edge is not None:
            groups.setdefault(("motor", effect.joint) if effect.kind in ("friction", "load") else (i,), []).append(i)
    return list(groups.values())


def _scale_jacobian(
    effects: Sequence[GearEffect], magnitudes: FloatArray, scales: Sequence[Sequence[int]], n_x: int
) -> FloatArray:
    """Return T (n, n_x + n_f + n_s) from parameters, magnitudes, scale steps to parameters and all magnitudes."""
    size, edges = n_x + len(magnitudes), [(s, i) for s, group in enumerate(scales) for i in group]
    T = np.zeros((size + len(edges), size + len(scales)))
    T[:size, :size] = np.eye(size)
    for row, (s, i) in enumerate(edges):
        T[size + row, size + s] = magnitudes[i] * effects[i].scale
    return T


def scale_priors(
    A: FloatArray, magnitudes: FloatArray, std: FloatArray, scales: Sequence[Sequence[int]], n_x: int
) -> FloatArray:
    """Return weights (n_s,) of priors on ln scale, std 1; scales of insignificant magnitudes stay fixed.

    A: normal matrix of parameters, magnitudes and scales.  magnitudes, std (n_f,), (n_x + n_f + ...): of the last
    round, which is the first where all std are 0.
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
    """Return effects with scales increased by fractions (n_s,), _STEP at most, relative to the first of each."""
    next_effects = list(effects)
    for group, step in zip(scales, np.clip(steps, -_STEP, _STEP).tolist(), strict=True):
        for i in group:
            next_effects[i] = replace(effects[i], scale=effects[group[0]].scale * (1 + step))
    return next_effects


def initial_estimate(data: GearData, parameters: Parameters, x: FloatArray) -> GearEstimate:
    """Return an estimate without effects at x (n_x,)."""
    drives, none = tuple(data.drives(parameters, x)), np.zeros(0)
    estimates = tuple(SmoothedMotion.start(c, drive, 0) for c, drive in zip(data.lines, drives, strict=True))
    (A, *_), weighted_cost = normal_equations(data.lines, drives, estimates, len(x), none)
    prior, _ = priors(parameters, x, len(x))
    covariance = inverse(A.sum(axis=0) + prior)
    return GearEstimate(parameters, (), x, none, covariance, weighted_cost, estimates, drives, none)


# Sums over lines and experiments of each realisation: A (R, n, n), b (R, n), c (R,) of J^H J, J^H r and r^H r.
Sums: TypeAlias = tuple[FloatArray, FloatArray, FloatArray]


def normal_equations(
    data: Sequence[PeriodLines],
    drives: Sequence[DriveLines],
    estimates: Sequence[SmoothedMotion],
    n_x: int,
    magnitudes: FloatArray,
) -> tuple[Sums, float]:
    """Sum the normal equations about magnitudes (n_f,), the motion fixed, without priors, and the weighted cost.

    Residuals have unit variance in each real component; n = n_x + n_f.
    """
    realisations = np.unique(np.concatenate([lines.realisation for lines in data]))
    R, n = len(realisations), n_x + len(magnitudes)
    A, b, c, weighted_cost = np.zeros((R, n, n)), np.zeros((R, n)), np.zeros(R), 0.0
    for lines, drive, estimate in zip(data, drives, estimates, strict=True):
        r = residuals(lines, drive, estimate, magnitudes)
        on = np.flatnonzero(lines.excited)
        # The excited lines, those between them, and some on either side.
        band = slice(int(on[0]) // 2, min(len(lines.s), int(1.2 * on[-1]) + 1))
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
    """Return the terms of the priors in A (n, n) and b (n,) at x (n_x,)."""
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
    response = np.einsum("fan,fnmi->fami", CH, Phi) + estimate.folded[band]
    J[..., n_x:] = -sensor[..., None] * response
    return J
