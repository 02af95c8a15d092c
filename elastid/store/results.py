"""fit.h5 and validation.h5: the result of a fit, its validation, and the twin moved along logs."""

from __future__ import annotations

from pathlib import Path

from elastid.base.errors import check_kind
from elastid.fit.result import FitResult
from elastid.store.files import NO_STAMP, Stamp
from elastid.store.reading import read_part
from elastid.store.values import write_artefact
from elastid.validation.results import Validation
from elastid.validation.twin_run import NO_TWIN, TwinFindings

FIT, VALIDATION = "fit", "validation"


def write_fit(path: Path | str, result: FitResult, stamp: Stamp = NO_STAMP) -> None:
    """fit.h5: parameters, estimate with covariance, every start, modification indices and linear models."""
    check_kind(result, FitResult, "result", "identify and read_fit make one")
    write_artefact(path, FIT, stamp, {"fit": (result, FitResult)})


def read_fit(path: Path | str) -> FitResult:
    """The result in fit.h5."""
    return read_part(path, FIT, "fit", FitResult)


def write_validation(
    path: Path | str, validation: Validation, stamp: Stamp = NO_STAMP, twin: TwinFindings = NO_TWIN
) -> None:
    """validation.h5: agreement and replay of each configuration, folds, and the twin."""
    parts = {"validation": (validation, Validation), "twin": (twin, TwinFindings)}
    write_artefact(path, VALIDATION, stamp, parts)


def read_validation(path: Path | str) -> Validation:
    """The validation in validation.h5."""
    return read_part(path, VALIDATION, "validation", Validation)


def read_twin(path: Path | str, kind: str) -> TwinFindings:
    """The twin in a file of a kind (validation, friction)."""
    return read_part(path, kind, "twin", TwinFindings)
