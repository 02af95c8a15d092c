"""`elastid explain`: text on a key, a code, a cause, an export target, or a parameter in a study or a run."""

import re
from pathlib import Path

from elastid.app.target_table import explain_targets, tags
from elastid.base.display import capitalise
from elastid.fit.diagnosis.hypotheses import explain_causes
from elastid.nonlinear.basis_functions import SHEET
from elastid.store.friction_study import read_friction_result
from elastid.store.results import read_fit, read_gears
from elastid.study import load
from elastid.study.reference import explain, explain_parameter


def explain_name(name: str, study: Path | None = None, folder: Path | None = None) -> str:
    """Explain a name, with its nominal value in a study and its estimate in the folder of a run."""
    if name == "export" or name in [f"export.{tag}" for tag in tags()]:
        return explain_targets(name.removeprefix("export").removeprefix("."))
    if name.partition(".")[0] == "causes":
        return explain_causes(name.partition(".")[2])
    fit, gears, friction = (Path(folder or "") / f"{stage}.h5" for stage in ("fit", "gears", "friction"))
    result = read_fit(fit) if folder is not None and not friction.is_file() else None
    robot = result.robot if result is not None else None if study is None else load(study).study.robot
    # The name of a transmission error such as e2_1 contains its order.
    texts = [e.meaning for e in SHEET if re.fullmatch(rf"{e.prefix}([\d.]+_)?(?<=[_m])\w+", name)]
    rows = [explain_parameter(name, robot) or "".join(f"{capitalise(meaning)}. Link side." for meaning in texts)]
    if result is not None and name in result.values:
        verdict = dict(zip(result, result.verdicts, strict=False)).get(name, "nuisance parameter")
        fixed = f"fixed at {result.values[name]:g}"
        rows.append(f"In this run: {f'{result[name]} ({verdict})' if name in result else fixed}.")
        rows.append(f"{capitalise(remark)}." if (remark := result.base_remarks.get(name)) else "")
    if result is not None and (gear_result := read_gears(gears)) is not None:
        rows += [f"Stage gears: {row.sentence}." for row in gear_result.numbers if row.name == name]
    if folder is not None and friction.is_file():
        numbers = [row for row in read_friction_result(friction).numbers if row.name == name]
        rows += [f"In this run: {n.value:.6g} {n.unit}, 95 % {n.low:.6g} to {n.high:.6g}." for n in numbers]
    rows = [*filter(None, rows)]
    return "\n  ".join([name, *rows]) if rows else explain(name)
