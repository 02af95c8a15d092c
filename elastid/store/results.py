"""fit.h5 and validation.h5: the result of a fit and its validation."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from elastid.base.errors import check_kind
from elastid.fit.result import FitResult
from elastid.fit.solve.local_optimum import LocalOptimum
from elastid.store.files import (
    NO_STAMP,
    Stamp,
    attributes,
    created,
    key,
    opened,
    read_notes,
    scale,
    texts,
    variable,
    write_notes,
)
from elastid.store.linear_models import read_linear, write_linear
from elastid.store.modification_indices import read_indices, write_indices
from elastid.store.parameters import read_parameters, write_parameters
from elastid.store.twin import write_twin
from elastid.validation.resonances import Peak
from elastid.validation.results import Agreement, Fold, Replay, Validation
from elastid.validation.twin_run import NO_TWIN, TwinFindings

_FIT_ATTRIBUTES = ("cost", "dof", "cost_expected", "status", "message", "hits", "criterion", "cost_dof")


def write_fit(path: Path | str, result: FitResult, stamp: Stamp = NO_STAMP) -> None:
    """fit.h5: the parameters as a table, x with its covariance, every start."""
    check_kind(result, FitResult, "result", "identify and read_fit make one")
    with created(path, "fit", stamp) as file:
        for name in _FIT_ATTRIBUTES:
            file.attrs[name] = getattr(result, name)
        names, values = [p.name for p in result.parameters], result.values
        parameter = scale(file, "parameter", names, "parameter")
        estimates = [values[name] for name in names]
        variable(file, "theta", estimates, [parameter], "estimate, fixed and tied ones included", "SI")
        write_parameters(file, result.parameters, parameter)
        free = scale(file, "free_parameter", result.parameters.free_names, "parameter that the solver varies")
        variable(file, "x", result.x, [free], "estimate as the solver's variable (ln p where log)")
        variable(file, "covariance", result.covariance, [free, free], "covariance of x")
        variable(file, "at_bound", result.at_bound, [free], "whether the estimate sits at a bound")
        singular = scale(file, "direction", np.arange(len(result.singular_values)), "direction, best known first")
        variable(file, "singular_values", result.singular_values, [singular], "of the Jacobian, columns scaled")
        _write_starts(file, result, free)
        _write_further(file, result, free)
        write_indices(file, result.indices, free)
        write_linear(file, result.linear)
        write_notes(file, result.notes)


def read_fit(path: Path | str) -> FitResult:
    """The result in fit.h5."""
    with opened(path, "fit") as file:
        known = attributes(file)
        return FitResult(
            parameters=read_parameters(file),
            x=file["x"][:],
            covariance=file["covariance"][:],
            starts=_read_starts(file),
            at_bound=file["at_bound"][:],
            singular_values=file["singular_values"][:],
            notes=read_notes(file),
            indices=read_indices(file),
            linear=read_linear(file),
            **_read_further(file),
            **{name: known[name] for name in _FIT_ATTRIBUTES},
        )


def _write_further(file: Any, result: FitResult, free: Any) -> None:
    """Optional results: intervals of two ends, and the information on each parameter."""
    end = scale(file, "end", ["lower", "upper"], "end of an interval")
    for name, what in (("profile95", "95 % interval by profile likelihood"), ("bootstrap95", "and by bootstrap")):
        if len(getattr(result, name)):
            variable(file, name, getattr(result, name), [free, end], what, "SI")
    if len(result.share):
        configuration = scale(file, "configuration", result.configurations, "configuration")
        variable(file, "share", result.share, [configuration, free], "share of the information about a parameter")
        variable(file, "informing_hz", result.informing_hz, [free, end], "middle half of that information", "Hz")
        variable(file, "weakest", result.weakest, [free], "least known combination of parameters")


def _read_further(file: Any) -> dict[str, Any]:
    found = {
        name: file[name][:] for name in ("profile95", "bootstrap95", "share", "informing_hz", "weakest") if name in file
    }
    return found | ({"configurations": texts(file, "configuration")} if "configuration" in file else {})


def _write_starts(group: Any, result: FitResult, free: Any) -> None:
    starts, n_x = result.starts, len(result.x)
    axis = scale(group, "start", np.arange(len(starts)), "start of the multistart, lowest cost first")
    for name, what in (("x_start", "where it began"), ("x", "where it ended")):
        values = np.array([getattr(start, name) for start in starts]).reshape(len(starts), n_x)
        variable(group, f"start_{name}", values, [axis, free], what)
    for name, dtype, what in (
        ("cost", float, "V where it ended"),
        ("iterations", int, "iterations"),
        ("converged", bool, "whether the solver converged"),
    ):
        values = np.array([getattr(start, name) for start in starts], dtype=dtype)
        variable(group, f"start_{name}", values, [axis], what)
    variable(group, "start_message", [start.message for start in starts], [axis], "how the solver ended")


def _read_starts(group: Any) -> tuple[LocalOptimum, ...]:
    columns = [group[f"start_{name}"][:] for name in ("x_start", "x")]
    columns += [group[f"start_{name}"][:].tolist() for name in ("cost", "iterations", "converged")]
    return tuple(LocalOptimum(*row) for row in zip(*columns, texts(group, "start_message"), strict=True))


_ELEMENT_VARIABLES = {
    "lines": "lines judged for magnitude and phase",
    "rms_log_db": "rms of 20 log10 |measured / modelled|",
    "phase_rms_deg": "rms of the phase of measured / modelled",
    "inside_2sigma": "share of the lines within 2 standard deviations",
    "rms_sigma": "rms of the residual over its standard deviation",
    "normality": "Anderson-Darling statistic of the residual",
}
_ELEMENT_UNITS = {"rms_log_db": "dB", "phase_rms_deg": "deg"}
_LAG_VARIABLES = {
    "autocorrelation": "autocorrelation of the normalised residual",
    "autocorrelation_bound": "bound of a white residual at 95 % probability",
}
_VERDICTS, _TESTS = ("verdict", "cost", "replayed", "folded"), ("power_ratio", "power_dof", "white_p")
_FOLD_NUMBERS = {"misfit": "mean |E|^2 / sigma^2", "rms_log_db": "dB rms", "phase_rms_deg": "degrees rms"}
_PEAK_TEXTS, _PEAK_NUMBERS = ("output", "input", "kind"), ("measured_hz", "modelled_hz")


def write_validation(
    path: Path | str, validation: Validation, stamp: Stamp = NO_STAMP, twin: TwinFindings = NO_TWIN
) -> None:
    """validation.h5: a group for each configuration, arrays by element (output, input), records replayed in it."""
    with created(path, "validation", stamp) as file:
        for name in _VERDICTS:
            file.attrs[name] = getattr(validation, name)
        names = [agreement.configuration for agreement in validation.configurations]
        scale(file, "configuration", names, "configuration, in the order measured")
        for agreement in validation.configurations:
            _write_agreement(file.create_group(key(agreement.configuration)), agreement)
        _write_folds(file, validation.folds)
        for replay in validation.replays:
            _write_replay(file[key(replay.configuration)].create_group("replay"), replay)
        write_twin(file, twin)


def read_validation(path: Path | str) -> Validation:
    """The validation in validation.h5."""
    with opened(path, "validation") as file:
        names, known = texts(file, "configuration"), attributes(file)
        return Validation(
            configurations=tuple(_read_agreement(file[key(name)], name) for name in names),
            replays=tuple(
                _read_replay(file[key(name)]["replay"], name) for name in names if "replay" in file[key(name)]
            ),
            folds=_read_folds(file),
            **{name: known[name] for name in _VERDICTS},
        )


def _write_agreement(group: Any, agreement: Agreement) -> None:
    group.attrs["left_out"] = agreement.left_out
    group.attrs["inside_expected"] = agreement.inside_expected
    for name in _TESTS:
        group.attrs[name] = getattr(agreement, name)
    elements = [scale(group, "output", agreement.outputs, "output"), scale(group, "input", agreement.inputs, "input")]
    for name, what in _ELEMENT_VARIABLES.items():
        variable(group, name, getattr(agreement, name), elements, what, _ELEMENT_UNITS.get(name, ""))
    lag = scale(group, "lag", np.arange(1, len(agreement.autocorrelation) + 1), "lag in lines")
    for name, what in _LAG_VARIABLES.items():
        variable(group, name, getattr(agreement, name), [lag, *elements], what)
    peak = scale(group, "peak", np.arange(len(agreement.peaks)), "resonances and antiresonances")
    for name in _PEAK_TEXTS:
        variable(group, f"peak_{name}", [getattr(p, name) for p in agreement.peaks], [peak], f"{name} of the peak")
    for name in _PEAK_NUMBERS:
        values = np.array([getattr(p, name) for p in agreement.peaks], dtype=float)
        variable(group, f"peak_{name}", values, [peak], name.removesuffix("_hz"), "Hz")


def _read_agreement(group: Any, name: str) -> Agreement:
    known = attributes(group)
    columns = [texts(group, f"peak_{column}") for column in _PEAK_TEXTS]
    columns += [group[f"peak_{column}"][:].tolist() for column in _PEAK_NUMBERS]
    return Agreement(
        configuration=name,
        left_out=known["left_out"],
        outputs=texts(group, "output"),
        inputs=texts(group, "input"),
        inside_expected=known["inside_expected"],
        **{name: known[name] for name in _TESTS if name in known},
        peaks=tuple(Peak(*row) for row in zip(*columns, strict=True)),
        **{field: group[field][:] for field in (*_ELEMENT_VARIABLES, *_LAG_VARIABLES)},
    )


_REPLAY_VARIABLES = {
    "fit_percent": ("100 (1 - rms error / rms motion)", "%"),
    "reachable_percent": ("the same of a true model, from the part that does not repeat", "%"),
    "error_rms": ("rms error", ""),
}
_REPLAY_SIGNALS = {
    "measured": "motion within the band as measured",
    "replayed": "and of the model under the same torque",
}
_REPLAY_ATTRIBUTES = ("quantity", "shown", "rate_hz", "rate_is_known")


def _write_replay(group: Any, replay: Replay) -> None:
    """One period of one record is kept for plots, in single precision."""
    for name in _REPLAY_ATTRIBUTES:
        group.attrs[name] = getattr(replay, name)
    group.attrs["band_hz"] = replay.band_hz
    record = scale(group, "record", replay.records, "record")
    output = scale(group, "output", replay.outputs, "output")
    variable(group, "units", replay.units, [output], "unit of each output")
    for name, (what, unit) in _REPLAY_VARIABLES.items():
        variable(group, name, getattr(replay, name), [record, output], what, unit)
    unit = "s" if replay.rate_is_known else "1 / sampling rate"
    time = scale(group, "time", np.arange(len(replay.measured)) / replay.rate_hz, "time", unit)
    for name, what in _REPLAY_SIGNALS.items():
        variable(group, name, getattr(replay, name).astype(np.float32), [time, output], what)


def _read_replay(group: Any, name: str) -> Replay:
    known = attributes(group)
    return Replay(
        configuration=name,
        records=texts(group, "record"),
        outputs=texts(group, "output"),
        units=texts(group, "units"),
        band_hz=tuple(known["band_hz"].tolist()),
        **{field: known[field] for field in _REPLAY_ATTRIBUTES},
        **{field: group[field][:] for field in (*_REPLAY_VARIABLES, *_REPLAY_SIGNALS)},
    )


def _write_folds(file: Any, folds: tuple[Fold, ...]) -> None:
    axis = scale(file, "fold", [fold.configuration for fold in folds], "configuration left out of one more fit")
    for name, what in _FOLD_NUMBERS.items():
        variable(file, f"fold_{name}", np.array([getattr(fold, name) for fold in folds]), [axis], what)
    variable(file, "fold_message", [fold.message for fold in folds], [axis], "why there is no fit without it")


def _read_folds(file: Any) -> tuple[Fold, ...]:
    columns = [texts(file, "fold"), *(file[f"fold_{name}"][:].tolist() for name in _FOLD_NUMBERS)]
    return tuple(Fold(*row) for row in zip(*columns, texts(file, "fold_message"), strict=True))
