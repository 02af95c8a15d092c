"""Results of a study in files: fit.h5, gears.h5, validation.h5, compare.json, map.h5, tune.h5 and loops.h5."""

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
from elastid.store.kinds import SCHEMA, from_json, or_text, write_json
from elastid.store.reading import read_part, reader
from elastid.store.writing import write_artefact, writer
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
# FRF errors by configuration, comparison with logs, and modes of the measured responses.
write_validation = writer(
    VALIDATION,
    validation=(Validation, None),
    simulation=(LogComparison, NO_COMPARISON),
    measured_modes=(tuple[MeasuredModes, ...], ()),
)
read_simulation = reader(VALIDATION, "simulation", LogComparison)
read_measured_modes = reader(VALIDATION, "measured_modes", tuple[MeasuredModes, ...])
read_map: "Callable[[Path | str], WorkspaceMap]" = reader(MAP, "map", "elastid.use.map:WorkspaceMap")
# Responses of the fitted model; None in a file of `elastid.save`.
read_modelled = reader(FIT, "modelled", tuple[Response, ...], is_optional=True)
# By name, since these types import the simulation.
read_tune: "Callable[[Path | str], TunedMove]" = reader("tune", "tune", "elastid.use.tune:TunedMove")
read_loops: "Callable[[Path | str], Loops]" = reader("loops", "loops", "elastid.use.loops:Loops")


def read_gears(path: Path | str | None) -> GearResult | None:
    """Read the gear effects in gears.h5; None for no path or a missing file."""
    return None if path is None or not Path(path).is_file() else read_part(path, GEARS, "gears", GearResult)


@frozen_value
class Numbers:
    """Table of the identified parameters in fit.h5, in SI, for other readers of HDF5."""

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
        """Return the table of the parameters of interest."""
        focus = result.parameters.of_interest
        stds = (result.std, *(result.std_contributions.values() or (dict.fromkeys(result.std, math.nan),) * 3))
        rows = [(result.values[p.name], *(std[p.name] for std in stds), *result.interval(p.name)) for p in focus]
        return cls(tuple(p.name for p in focus), tuple(p.unit for p in focus), *np.array(rows).reshape(-1, 7).T)


def write_fit(
    path: Path | str, result: Result, stamp: Stamp = NO_STAMP, modelled: tuple[Response, ...] | None = None,
    figures: Mapping[str, tuple[Any, Any]] = MappingProxyType({}),
) -> None:  # fmt: skip
    """Write fit.h5: the result, the table `Numbers`, responses of the fitted model, and values of figures.

    modelled: at the lines of each measured response.  figures: value and type by name.  TypeError for another result.
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
    blocks = (workspace.subset(np.arange(first, min(n, first + step))) for first in range(0, n, step))

    def rows(block: "WorkspaceMap") -> Iterator[tuple[Any, ...]]:
        numbers = [column for q in block.quantities for column in (q.value, q.std, *q.interval)]
        columns = [block.asked + 1, *block.angles.T, *block.position.T, block.limiting_springs, *numbers]
        return zip(*(np.asarray(column).tolist() for column in columns), strict=True)

    write_rows(path, chain([heads], chain.from_iterable(map(rows, blocks))))


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
        keys = {"configurations": "configurations", "verdict": "verdict", "rows": "models", "trials": "search"}
        values = {name: content[key] for name, key in keys.items()}
        comparison: Comparison = from_json(values, resolve_name("elastid.validation.comparison:Comparison"))
    except (OSError, ValueError, TypeError, KeyError, AttributeError):  # a missing or damaged file
        return None
    return comparison
