"""Export to CSV: parameters, modes, friction, and the frequency response of each configuration.

A study can read the responses as `experiment.responses`: columns freq_hz, re_<y>_<u>, im_<y>_<u>.
"""

import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from elastid.base.arrays import ComplexArray, FloatArray
from elastid.base.escape import file_name
from elastid.fit.fitted_robot import FittedRobot
from elastid.friction_study.result import FrictionResult
from elastid.modal.modes import Modes
from elastid.response import Response
from elastid.store.files import write_rows
from elastid.targets.numbers import exported_numbers
from elastid.targets.target import Target


def write_modes_csv(path: Path, modes: Sequence[Modes]) -> Path:
    """Write one row for each mode of each response; frequencies in Hz, or in units of an unknown sampling rate.

    Mode shapes, with the largest entry 1: re_<place>, im_<place> and std_<place>, empty without this place.
    """
    return write_rows(path, _measured_modes(modes))


def _measured_modes(modes: Sequence[Modes]) -> Iterable[Sequence[Any]]:
    places = list(dict.fromkeys(place for mode_set in modes for place in mode_set.places))
    columns = "frequency", "frequency_std", "damping_ratio", "damping_ratio_std", "phase_collinearity"
    yield "configuration", *columns, *(f"{kind}_{place}" for place in places for kind in ("re", "im", "std"))
    for mode_set in modes:
        shapes, std = mode_set.place_shapes
        numbers = mode_set.freq_hz, mode_set.freq_std, mode_set.zeta, mode_set.zeta_std, mode_set.collinearity
        for r, row in enumerate(zip(*numbers, strict=True)):
            entries = zip(mode_set.places, shapes[:, r].real, shapes[:, r].imag, std[:, r], strict=True)
            by_place = {place: entry for place, *entry in entries}
            yield mode_set.configuration, *row, *(x for place in places for x in by_place.get(place, ("", "", "")))


def write_csv(folder: Path, model: FittedRobot) -> tuple[Path, ...]:
    """Write parameters.csv, modes.csv, <configuration>-fitted.csv and <configuration>-measured.csv."""
    paths = [write_rows(folder / "parameters.csv", _parameters(model)), write_rows(folder / "modes.csv", _modes(model))]
    for plant, G in zip(model.models, model.measured, strict=True):
        fitted, std = plant.response(G.freq_hz, sampled=True).G, plant.response_std(G.freq_hz)
        paths.append(write_rows(folder / f"{file_name(G.configuration.name)}-fitted.csv", _response(G, fitted, std**2)))
        paths.append(_measured(folder, G))
    return tuple(paths)


def write_responses_csv(
    folder: Path, name: str, responses: Sequence[Response], modes: Sequence[Modes] = ()
) -> tuple[Path, ...]:
    """Write <configuration>-measured.csv for each response, and modes.csv."""
    return (*(_measured(folder, G) for G in responses), write_modes_csv(folder / "modes.csv", modes))


def write_friction_csv(folder: Path, friction_result: FrictionResult) -> tuple[Path, ...]:
    """Write parameters.csv of friction, and base_parameters.csv of each rigid body.

    The last columns are the coefficients of the regressor's parameters in each base parameter.
    """
    rows = [(n.name, n.unit, n.value, n.std, n.low, n.high) for n in friction_result.numbers]
    head = "parameter", "unit", "value", "std"
    paths = [write_rows(folder / "parameters.csv", [(*head, "lower_95", "upper_95"), *rows])]
    for i, body in enumerate(friction_result.rigid_bodies, start=1):
        numbers = (body.values.tolist(), body.std.tolist(), body.predicting.tolist(), body.regrouped.tolist())
        base = [(name, unit, *n, *r) for name, unit, *n, r in zip(body.names, body.units, *numbers, strict=True)]
        path = folder / f"base_parameters{f'_{i}' if i > 1 else ''}.csv"
        paths.append(write_rows(path, [(*head, "predicting", *body.columns), *base]))
    return tuple(paths)


def _measured(folder: Path, G: Response) -> Path:
    variance = None if G.uncertainty is None else G.uncertainty.variance
    return write_rows(folder / f"{file_name(G.configuration.name)}-measured.csv", _response(G, G.G, variance))


def _parameters(model: FittedRobot) -> Iterable[Sequence[Any]]:
    numbers = exported_numbers(model)
    yield "parameter", "unit", *numbers[0].row
    for number in numbers:  # a fixed number has no std
        yield number.name, number.unit, *("" if math.isnan(value) else value for value in number.row.values())


def _modes(model: FittedRobot) -> Iterable[Sequence[Any]]:
    yield "configuration", "mode", "frequency_hz", "damping_ratio", "frequency_std", "damping_ratio_std"
    for plant in model.models:
        modal = plant.modes()
        columns = (column.tolist() for column in (modal.freq_hz, modal.zeta, modal.freq_std, modal.zeta_std))
        for i, (*values, freq_std, zeta_std) in enumerate(zip(*columns, strict=True), start=1):
            # A mode that depends only on fixed parameters has no std.
            yield plant.linear.configuration.name, i, *values, freq_std or "", zeta_std or ""


def _response(measured: Response, G: ComplexArray, variance: FloatArray | None) -> Iterable[Sequence[Any]]:
    elements = [(a, b, f"{y}_{u}") for a, y in enumerate(measured.outputs) for b, u in enumerate(measured.inputs)]
    names = [f"{component}_{name}" for component in ("re", "im") for _, _, name in elements]
    names += [f"std_{name}" for _, _, name in elements] if variance is not None else []
    yield "freq_hz", *names
    rows, columns = [a for a, _, _ in elements], [b for _, b, _ in elements]
    for line, frequency in enumerate(measured.freq_hz):
        g = G[line, rows, columns]
        std = [] if variance is None else np.sqrt(variance[line, rows, columns]).tolist()
        yield float(frequency), *g.real.tolist(), *g.imag.tolist(), *std


TARGETS = (
    Target("csv", ("model",), "parameters with intervals, modes, fitted and measured FRFs as tables", write_csv),
    Target("csv", ("name", "responses", "modes"), "measured FRFs and modes as tables", write_responses_csv),
    Target(
        "csv", ("friction_result",), "friction parameters and rigid-body base parameters as tables", write_friction_csv
    ),
)
