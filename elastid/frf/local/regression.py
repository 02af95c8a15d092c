"""The local regression at every line: a ladder of models, of which each line takes the simplest sufficient one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from elastid.base.arrays import BoolArray, ComplexArray, FloatArray, IntArray
from elastid.frf.local.least_squares import LocalFit, fit_block
from elastid.frf.local.windows import Windows, WindowTerms

# Numbers in the arrays of one block of lines: 64 MB.
_BLOCK_NUMBERS = 4_000_000
# A model replaces a simpler one where dof ln(residual power of that / its own) exceeds this in an output; poles that
# fit mere noise exceed it once in 100 lines.
_MIN_LOG_GAIN = 9.0
_ARRAYS = tuple(field.name for field in fields(LocalFit) if field.name != "dof")


@dataclass(frozen=True)
class LadderFit:
    """The fit of the model that each line takes, those of all models at all lines, and taken (F,): which it is."""

    chosen: LocalFit
    models: tuple[LocalFit, ...]
    taken: IntArray


def fit_ladder(Z: ComplexArray, R: ComplexArray, where: Windows, ladder: Sequence[WindowTerms]) -> LadderFit:
    """The local model at every line, from Z (E, B, n_z) and the input R (E, B, n_u) at the available bins.

    ladder: models of rising complexity, of which each line takes the first; a further one only where it leaves clearly
    less in some output.  Poles found in mere noise would make the residual too small, and needless orders make the
    estimate worse, most at the ends of the band.  dof of the chosen fit is that of the last.
    """
    fits = tuple(_in_blocks(Z, R, where, terms) for terms in ladder)
    chosen, (dof, poles) = fits[0], (fits[-1].dof, ladder[-1].poles)
    power, taken = _power(chosen), np.zeros(len(where.index), dtype=np.int64)
    for i, fit in enumerate(fits[1:], 1):
        clear = np.max(fit.dof * np.log(power / _power(fit)), axis=1) > _MIN_LOG_GAIN
        power, taken = np.where(clear[:, None], _power(fit), power), np.where(clear, i, taken)
        chosen = _chosen(clear, _grown(fit, poles, dof), _grown(chosen, poles, dof))
    return LadderFit(chosen, fits, taken)


def _power(fit: LocalFit) -> FloatArray:
    """Residual power (F, n_z) of each output."""
    return np.asarray(np.maximum(np.einsum("fzz->fz", fit.scatter).real, 1e-300) / fit.dof)


def _grown(fit: LocalFit, poles: int, dof: float) -> LocalFit:
    """The same fit with room for more poles, and a residual as if it had fewer degrees of freedom."""
    more = poles - fit.M.shape[1]
    return replace(
        fit,
        M=np.pad(fit.M, ((0, 0), (0, more), (0, 0), (0, 0))),
        A_cov=np.pad(fit.A_cov, ((0, 0), (0, more), (0, more))),
        scatter=fit.scatter * (dof / fit.dof),
        dof=dof,
    )


def _chosen(take: BoolArray, a: LocalFit, b: LocalFit) -> LocalFit:
    """a at the lines taken (F,), b elsewhere."""
    arrays = {name: getattr(b, name).copy() for name in _ARRAYS}
    for name, array in arrays.items():
        array[take] = getattr(a, name)[take]
    return LocalFit(dof=a.dof, **arrays)


def _in_blocks(Z: ComplexArray, R: ComplexArray, where: Windows, terms: WindowTerms) -> LocalFit:
    """One model at all lines, in blocks that bound the memory."""
    E, _, n_z = Z.shape
    F, n_w = where.index.shape
    numbers = E * n_w * (terms.columns + E * terms.transient_columns + 2 * (terms.poles + 2) * n_z)
    step = max(1, _BLOCK_NUMBERS // numbers)
    fits = [fit_block(Z, R, where.at(slice(i, i + step)), terms) for i in range(0, F, step)]
    return LocalFit(dof=fits[0].dof, **{name: np.concatenate([getattr(fit, name) for fit in fits]) for name in _ARRAYS})
