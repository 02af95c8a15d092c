r"""Shares that make the smallest eigenvalue of the information largest, with a bound: a semidefinite program.

.. math:: \max_{\lambda, t}\ \frac{1}{S} \sum_s \ln t_s, \qquad \sum_q \lambda_q H_{sq} \succeq t_s K K^T,
          \quad \lambda_q \ge 0, \ \sum_q \lambda_q = 1

with one t for all guesses s where the worst of them counts. Clarabel solves it. From its dual matrices W_s follows the
bound ln max_q sum_s Tr(W_s H_sq) - mean_s ln(S Tr(W_s K K^T)), valid wherever the solver has stopped.

.. math:: \max_{\lambda, t}\ \frac{1}{S} \sum_s \ln t_s - \sum_i \lambda_i, \qquad
          Z_s = \sum_i \lambda_i H_{si} - t_s K K^T \succeq 0, \quad \lambda_i \ge 0

S guesses, K the parameters of interest: 1 / t_s is the largest eigenvalue of K^T M_s^-1 K. For the worst guess all have
one t. However many the candidates, the dual has few unknowns, one matrix W_s for each guess:

.. math:: \min_W\ -\frac{1}{S} \sum_s \ln(S\,\mathrm{Tr}\,W_s K K^T), \qquad
          s_i = 1 - \sum_s \mathrm{Tr}\,W_s H_{si} \ge 0, \quad W_s \succeq 0

(for the worst guess -ln sum_s Tr(W_s K K^T)), and every W that is allowed bounds all designs. Both are solved together:
lambda_i s_i = mu, W_s Z_s = mu I and t_s Tr(W_s K K^T) = 1 / S with mu -> 0, by Newton's method with a prediction and a
correction of second order. (Helmberg, Rendl, Vanderbei and Wolkowicz, SIAM J. Optimization 6 (1996) 342, for the
direction, Mehrotra, SIAM J. Optimization 2 (1992) 575, for the correction; Pukelsheim, Optimal Design of Experiments,
chapter 7, for the dual.)
"""

from __future__ import annotations

import numpy as np

from elastid.base.arrays import FloatArray

# Of the dual; 1700 with 200 candidates take half a second, 600 with 8000 candidates 5 s. Beyond, updates climb.
MAX_UNKNOWNS = 2000


def pack(matrices: FloatArray) -> FloatArray:
    """Symmetric (..., d, d) as (..., d (d + 1) / 2), so that Tr(A B) is a dot product."""
    rows, columns = np.tril_indices(matrices.shape[-1])
    return np.ascontiguousarray(matrices[..., rows, columns] * np.where(rows == columns, 1.0, np.sqrt(2)))


def unpack(vectors: FloatArray) -> FloatArray:
    """Symmetric (..., d, d) of vectors (..., d (d + 1) / 2)."""
    d = round((np.sqrt(8 * vectors.shape[-1] + 1) - 1) / 2)
    rows, columns = np.tril_indices(d)
    matrices = np.empty((*vectors.shape[:-1], d, d))
    matrices[..., rows, columns] = vectors / np.where(rows == columns, 1.0, np.sqrt(2))
    matrices[..., columns, rows] = matrices[..., rows, columns]
    return matrices


def bounded_shares(
    H: FloatArray, interest: FloatArray, worst: bool, tolerance: float
) -> tuple[FloatArray, float] | None:
    """Shares (Q,) of candidates with packed information H (S, Q, p), and the bound of phi that no design exceeds.

    interest: K (d, s).  worst: the worst guess counts, not the mean.  None where there are too many unknowns, where the
    information of equal shares is singular in floating point, and where the solver fails.
    """
    # Both are slow to import, and needed for this criterion alone.
    import clarabel
    from scipy import sparse

    S, Q, p = H.shape
    if S * p > MAX_UNKNOWNS:
        return None
    # In coordinates in which the mean information of equal shares is the identity, and its smallest eigenvalue is 1.
    try:
        whitening = np.linalg.inv(np.linalg.cholesky(unpack(H.mean(axis=(0, 1)))))
    except np.linalg.LinAlgError:
        return None
    K = whitening @ interest
    scale = float(np.linalg.eigvalsh(K.T @ K).max())
    C = pack(K @ K.T) / scale
    H = pack(whitening @ unpack(H) @ whitening.T)
    T = 1 if worst else S
    # Unknowns: t (T,), their logarithms (T,), the shares (Q,).  right - constraints @ unknowns lies in the cones.
    matrices = [np.kron(np.ones((S, 1)) if worst else np.eye(S), C[:, None]), np.zeros((S * p, T)), -np.vstack([*H.mT])]
    logarithms = np.zeros((3 * T, 2 * T))
    for s in range(T):
        logarithms[3 * s, T + s] = logarithms[3 * s + 2, s] = -1.0
    constraints = sparse.vstack([
        sparse.csc_matrix(np.concatenate([np.zeros(2 * T), np.ones(Q)])[None]),
        sparse.hstack([sparse.csc_matrix((Q, 2 * T)), -sparse.eye(Q)]),
        sparse.csc_matrix(np.hstack(matrices)),
        sparse.hstack([sparse.csc_matrix(logarithms), sparse.csc_matrix((3 * T, Q))]),
    ])  # fmt: skip
    right = np.concatenate([[1.0], np.zeros(Q + S * p), np.tile([0.0, 1.0, 0.0], T)])
    cones = [clarabel.ZeroConeT(1), clarabel.NonnegativeConeT(Q)]
    cones += [clarabel.PSDTriangleConeT(len(K))] * S + [clarabel.ExponentialConeT()] * T
    goal = np.concatenate([np.zeros(T), -np.ones(T) / T, np.zeros(Q)])
    settings = clarabel.DefaultSettings()
    settings.verbose, settings.max_threads = False, 1
    settings.tol_gap_abs = settings.tol_gap_rel = tolerance / 10
    solver = clarabel.DefaultSolver(
        sparse.csc_matrix((len(goal), len(goal))), goal, sparse.csc_matrix(constraints), right, cones, settings
    )
    solution = solver.solve()
    weights = np.maximum(solution.x[2 * T :], 0.0)
    W = np.array(solution.z[1 + Q : 1 + Q + S * p]).reshape(S, p)
    largest, normal = np.einsum("sqp,sp->q", H, W).max(), W @ C
    if not (weights.sum() > 0 and np.isfinite(largest) and largest > 0 and (normal > 0).all()):
        return None
    mean = np.log(normal.sum()) if worst else np.mean(np.log(S * normal))
    return weights / weights.sum(), float(np.log(largest) - mean - np.log(scale))
