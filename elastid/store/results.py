"""fit.h5, gears.h5, validation.h5, compare.json, map.h5, tune.h5, loops.h5: results of a study."""

import json
import math
from collections.abc import Callable, Iterator, Mapping
from itertools import chain
from pathlib import Path
from pkgutil import resolve_name
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from elastid.base.arrays import FloatArray, frozen_value, labelled
from elastid.base.errors import check_kind
from elastid.fit.result import Result
from elastid.nonlinear.gear_result import GearResult
from elastid.response import Response
from elastid.store.artefacts import NO_STAMP, Stamp
from elastid.store.files import write_rows
from elastid.store.reading import read_part, reader
from elastid.store.values import SCHEMA, from_json, or_text, write_artefact, write_json, writer
from elastid.validation.frf_error import Validation
from elastid.validation.log_comparison import NO_COMPARISON, LogComparison
from elastid.validation.measured_modes import MeasuredModes

if TYPE_CHECKING:
    from elastid.use.loops import Loops
    from elastid.use.map import WorkspaceMap
    from elastid.use.tune import TunedMove
    from elastid.validation.comparison import Comparison

FIT, GEARS, VALIDATION, MAP = "fit", "gears", "validation", "map"


read_fit, read_validation = reader(FIT, "fit", Result), reader(VALIDATION, "validation", Validation)
write_gears, write_map = writer(GEARS, gears=(None, None)), writer(MAP, map=(None, None))
write_tune, write_loops = writer("tune", tune=(None, None)), writer("loops", loops=(None, None))
# FRF errors of each configuration, comparison with logs, and modes of the measured responses.
write_validation = writer(
    VALIDATION,
    validation=(Validation, None),
    simulation=(LogComparison, NO_COMPARISON),
    measured_modes=(tuple[MeasuredModes, ...], ()),
)
read_simulation = reader(VALIDATION, "simulation", LogComparison)
read_measured_modes = reader(VALIDATION, "measured_modes", tuple[MeasuredModes, ...])
read_map: "Callable[[Path | str], WorkspaceMap]" = reader(MAP, "map", "elastid.use.map:WorkspaceMap")
# Responses of the fitted model; None in a file that `elastid.save` wrote.
read_modelled = reader(FIT, "modelled", tuple[Response, ...], may_miss=True)
# These bring the simulation, which a fit does without.
read_tune: "Callable[[Path | str], TunedMove]" = reader("tune", "tune", "elastid.use.tune:TunedMove")
read_loops: "Callable[[Path | str], Loops]" = reader("loops", "loops", "elastid.use.loops:Loops")


def read_gears(path: Path | str | None) -> GearResult | None:
    """Read the effects in gears.h5; None without such a file."""
    return None if path is None else read_part(path, GEARS, "gears", GearResult)


@frozen_value
class Numbers:
    """The table of a fit for readers of HDF5 alone: identified numbers in SI, std in parts, 95 % intervals."""

    name: tuple[str, ...]
    unit: tuple[str, ...]
    value: FloatArray = labelled("estimate", "SI", "name")
    std: FloatArray = labelled("standard deviation", "SI", "name")
    std_noise: FloatArray = labelled("contribution of the noise to std, NaN for an exact robot model", "SI", "name")
    std_prior: FloatArray = labelled("contribution of the robot model's tolerances", "SI", "name")
    std_systematic: FloatArray = labelled("remaining contribution", "SI", "name")
    lower_95: FloatArray = labelled("lower end of the 95 % interval", "SI", "name")
    upper_95: FloatArray = labelled("upper end of the 95 % interval", "SI", "name")

    @classmethod
    def of(cls, result: Result) -> "Numbers":
        """Select the requested numbers."""
        focus = result.parameters.of_interest
        parts = (*result.std_contributions.values(),) or (dict.fromkeys(result.std, math.nan),) * 3
        rows = [
            (result.values[p.name], result.std[p.name], *(stds[p.name] for stds in parts), *result.interval(p.name))
            for p in focus
        ]  # fmt: skip
        return cls(tuple(p.name for p in focus), tuple(p.unit for p in focus), *np.array(rows).reshape(-1, 7).T)


def write_fit(
    path: Path | str,
    result: Result,
    stamp: Stamp = NO_STAMP,
    modelled: tuple[Response, ...] | None = None,
    figures: Mapping[str, tuple[Any, Any]] = MappingProxyType({}),
) -> None:
    """Write fit.h5: parameters, estimate with covariance, every start, modification indices, linear models; a table.

    modelled: responses of the fitted model at the lines of each measured one.  figures: values and types of the page.
    """
    check_kind(result, Result, "result", "elastid.identify(...) and elastid.load(path) give one")
    contents: dict[str, tuple[Any, Any]] = {"fit": (result, Result), "numbers": (Numbers.of(result), Numbers)}
    contents["modelled"] = modelled, tuple[Response, ...] | None
    write_artefact(path, FIT, stamp, contents | dict(figures), {"modelled": "configuration.name"})


def write_map_table(path: Path, workspace: "WorkspaceMap") -> None:
    """Write map.csv: a row for each posture with all quantities, SI, their standard deviations and intervals."""
    heads = ["posture", *(f"joint {name}" for name in workspace.joints), "x", "y", "z", "limiting spring"]
    heads += [f"{q.name}{end}" for q in workspace.quantities for end in ("", " std", " low", " high")]
    n, step = len(workspace), 1000
    pieces = (workspace.subset(np.arange(first, min(n, first + step))) for first in range(0, n, step))

    def rows(piece: "WorkspaceMap") -> Iterator[tuple[Any, ...]]:
        numbers = [column for q in piece.quantities for column in (q.value, q.std, *q.interval)]
        columns = [piece.asked + 1, *piece.angles.T, *piece.position.T, piece.limiting_springs, *numbers]
        return zip(*(np.asarray(column).tolist() for column in columns), strict=True)

    write_rows(path, chain([heads], chain.from_iterable(map(rows, pieces))))


def write_comparison(path: Path, comparison: "Comparison", stamp: Stamp) -> None:
    """Write compare.json with the stamp of the fitted frequency responses."""
    head = {"schema": SCHEMA, "responses": stamp.inputs, "code": stamp.code, "made by": stamp.software}
    ranking = {"models": comparison.rows, "search": comparison.trials}
    content = {**head, "verdict": comparison.verdict, "configurations": comparison.configurations, **ranking}
    write_json(path, content, or_text)


def read_comparison(path: Path, stamp: Stamp) -> "Comparison | None":
    """Read the comparison in compare.json; None without one, or for other frequency responses."""
    try:
        content = json.loads(path.read_bytes())
        if (content["schema"], content["responses"]) != (SCHEMA, stamp.inputs):
            return None
        names = {"configurations": "configurations", "verdict": "verdict", "rows": "models", "trials": "search"}
        of_file = {name: content[key] for name, key in names.items()}
        comparison: Comparison = from_json(of_file, resolve_name("elastid.validation.comparison:Comparison"))
    except (OSError, ValueError, TypeError, KeyError, AttributeError):  # missing or damaged
        return None
    return comparison
