"""`elastid explain`: a key, a code, or a parameter with its nominal value in a study and its estimate in a run."""

from pathlib import Path

from elastid.store.friction_study import read_friction_result
from elastid.store.results import read_fit, read_gears
from elastid.study import load
from elastid.study.reference import explain, explain_parameter


def explained(asked: str, study: Path | None = None, folder: Path | None = None) -> str:
    """The explanation.  study: path of a study, for the nominal value.  folder: of a run, for the estimate."""
    fit, gears, friction = (Path(folder or "") / f"{stage}.h5" for stage in ("fit", "gears", "friction"))
    result = read_fit(fit) if folder is not None and not friction.is_file() else None
    robot = result.robot if result is not None else None if study is None else load(study).study.robot
    rows = [explain_parameter(asked, robot)]
    if result is not None and asked in result.values:
        at = dict(zip(result, result.verdicts, strict=False)).get(asked, "nuisance parameter")
        estimate = f"{result[asked]}; status: {at}" if asked in result else f"fixed at {result.values[asked]:g}"
        rows.append(f"In this run: {estimate}.")
    if result is not None and gears.is_file():
        found = read_gears(gears)
        rows += [f"Stage gears: {row.words}." for row in found.numbers if row.name == asked] if found else []
    if folder is not None and friction.is_file():
        for row in read_friction_result(friction).numbers:
            if row.name == asked:
                rows.append(f"In this run: {row.value:.6g} {row.unit}, 95 % {row.low:.6g} to {row.high:.6g}.")
    rows = [row for row in rows if row]
    return "\n  ".join([asked, *rows]) if rows else explain(asked)
