"""predict: the numbers that one study has identified, judged on the logs of another: prediction.json and a figure.

Of a study of friction these are rigid body and friction; of a study of elasticity the fitted robot, whose responses,
torques and motion are compared with those of the logs.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from elastid.app.identified_robot import with_identified_friction
from elastid.app.run import Run, carry_out, logged_in
from elastid.app.stages.validate import Validated, in_time
from elastid.app.summaries import prediction_summary, validation_summary
from elastid.base.errors import StudyError
from elastid.base.execution import Execution
from elastid.fit.fitted_robot import FittedRobot
from elastid.report.figures.fit import octaves_figure
from elastid.store.files import keep_checksums, write_text
from elastid.store.friction_study import read_friction_records, read_friction_result
from elastid.store.measured import read_friction, read_responses
from elastid.store.results import read_fit, read_gears
from elastid.store.values import json_value
from elastid.study.source import read_source
from elastid.validation.agreement import validate
from elastid.validation.friction_twin import predict_logs
from elastid.validation.spec import ValidationSpec
from elastid.validation.twin import TwinFindings

# Keys of a file of a study that are of that file alone, and not of another log with the same channels.
_OF_ONE_LOG = ("samples", "also", "speed", "temperature", "load")


def on_logs(study: Path, logs: Sequence[Path], options: Mapping[str, Any]) -> dict[str, Any]:
    """Options of the command line under which a study has these logs in place of its own, and another run folder.

    A log has the other keys (configuration, realisation ...) of the file that it stands in for, the last of the first.
    """
    if not logs:
        return dict(options)
    data = read_source(study, str(study)).data or {}
    recorded = (data.get("experiment") or {}).get("recorded") or {}
    if not recorded:
        raise StudyError(
            "predict/mismatch", "--log takes the channels of experiment.recorded, which the study has not", study
        )
    files = recorded.get("files") or [{}]
    entries = [
        {key: value for key, value in files[min(i, len(files) - 1)].items() if key not in _OF_ONE_LOG}
        | {"path": str(log.absolute())}
        for i, log in enumerate(logs)
    ]
    overrides = [f"experiment.recorded.files={json.dumps(entries)}"]
    if (data.get("validation") or {}).get("left_out") and "friction" in data:
        overrides.append("validation.left_out=[]")
    folder = options["folder"] or Path("runs") / f"{data.get('name', 'study')}_{logs[0].stem}"
    return {**options, "overrides": (*options["overrides"], *overrides), "folder": folder}


def predict(run: Run, source: Path) -> None:
    """prediction.json and prediction.png: the logs of a study judged by the numbers of `source`.

    source: a friction.h5 or fit.h5, or the folder that holds it.  Stages that read the logs are run where they are out
    of date.  StudyError for a study of the other kind, and where nothing can be predicted.
    """
    of_friction = run.study.friction is not None
    path = _result_of(run, source, "friction.h5" if of_friction else "fit.h5")
    with logged_in(run.folder, run.jobs, run.console):
        for name in ("design", "measure", *(() if of_friction else ("estimate",))):
            if name in run.stages and not run.is_current(name):
                carry_out(run, name)
        judged, content, words = (_friction if of_friction else _elasticity)(run, path)
        write_text(run.folder / "prediction.json", json.dumps(json_value(content), indent=1, allow_nan=False) + "\n")
        if judged.balances:
            octaves_figure(judged.balances).savefig(run.folder / "prediction.png")
        keep_checksums(run.folder, ["prediction.json"])
        for each in (*words, str(run.folder / "prediction.json")):
            run.console.say(f"predict: {each}")


def _result_of(run: Run, source: Path, name: str) -> Path:
    path = source / name if source.is_dir() else source
    if not path.is_file():
        kind = "friction" if run.study.friction is not None else "elasticity"
        raise StudyError(
            "files/missing",
            f"{path.name} is not there; the study identifies {kind}: name the run folder of another study of {kind}",
            f"--with {source}",
        )
    if path.resolve().parent == run.folder.resolve() and not run.is_current(name.removesuffix(".h5")):
        raise StudyError(
            "options/invalid",
            "its own run folder, where other logs would replace its own; give --run",
            f"--with {source}",
        )
    run.study.as_robot()
    return path


def _friction(run: Run, path: Path) -> tuple[TwinFindings, dict[str, Any], Sequence[str]]:
    result, measured = read_friction_result(path), read_friction_records(run.path("measure"))
    recorded = run.study.experiment.recorded
    robot, controller = run.study.as_robot(), None if recorded is None else recorded.controller
    identified = with_identified_friction(robot, result)
    prediction = predict_logs(identified, result.joints, measured, controller, Execution(run.jobs))
    for joint, reason in prediction.missing.items():
        run.console.warn(f"joint {joint} is not predicted: {reason}")
    if not prediction.balances:
        raise StudyError(
            "predict/mismatch",
            "none of its joints can be predicted on these logs; the reasons are above",
            f"--with {path}",
        )
    return prediction, prediction_summary(run.study.name, str(path), prediction), prediction.words


def _elasticity(run: Run, path: Path) -> tuple[TwinFindings, dict[str, Any], Sequence[str]]:
    study, responses, result = run.study, read_responses(run.path("estimate")), read_fit(path)
    robot = study.as_robot()
    lacking = sorted(set(robot.parameters()) - set(result.parameters.names))
    if lacking:
        raise StudyError(
            "predict/mismatch", f"it is of another robot, without {', '.join(lacking[:3])}", f"--with {path}"
        )
    taken_out = path.with_name("frf.h5")
    friction = read_friction(taken_out) if taken_out.is_file() else None
    laid_open = path.with_name("gears.h5")
    gears = read_gears(laid_open) if laid_open.is_file() else None
    fitted = FittedRobot.of(result, robot, responses, study.model)
    records = run.path("measure") if "measure" in run.stages else None
    own = Validated(replace(study, validation=ValidationSpec()), fitted, friction, gears)
    twin = in_time(own, records, run.console, Execution(run.jobs))
    shifts = {G.configuration.name: fitted.at(G.configuration.name).response_shifts(G.freq_hz) for G in responses}
    judged = validate(responses, fitted.responses, [*shifts], shifts=shifts)
    content = {**validation_summary(study.name, judged, twin), "with": str(path)}
    return twin, content, [words for words in (judged.verdict, *twin.words) if words]
