"""`elastid predict STUDY --with RUN`: parameters of one study validated on the logs of another.

Of a friction study: rigid-body dynamics and friction; of elasticity: FRFs, torques and motions of the fitted robot.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from elastid.app.identified_robot import with_identified_friction
from elastid.app.run import Run, run_stage
from elastid.app.stages.validate import ValidationBasis, validate_model
from elastid.app.summaries import prediction_summary, validation_summary
from elastid.base.errors import DataError, StudyError
from elastid.base.execution import Execution
from elastid.fit.fitted_robot import FittedRobot
from elastid.report.figures.fit import octaves_figure
from elastid.store.files import save_checksums
from elastid.store.friction_study import read_friction_records, read_friction_result
from elastid.store.kinds import SCHEMA, write_json
from elastid.store.measured import read_friction, read_responses
from elastid.store.results import read_fit, read_gears
from elastid.study.source import read_source
from elastid.validation.friction_simulation import predict_logs
from elastid.validation.log_comparison import LogComparison
from elastid.validation.spec import ValidationSpec

# Keys of a log that do not apply to other logs with the same channels.
_KEYS_OF_ONE_LOG = ("samples", "also", "speed", "temperature", "load")


def on_logs(study: Path, logs: Sequence[Path], options: Mapping[str, Any]) -> dict[str, Any]:
    """Return command-line options with which a study reads these logs instead of its own, in another run folder.

    Log i gets the other keys (configuration, realisation ...) of file i; further logs get the keys of the last file.
    """
    if not logs:
        return dict(options)
    data = read_source(study, str(study)).data
    experiment = data.get("experiment") if isinstance(data, Mapping) else None
    recorded = experiment.get("recorded") if isinstance(experiment, Mapping) else None
    if not isinstance(recorded, Mapping) or not recorded:
        text = "--log needs the section experiment.recorded, which is missing. Add it with channels and rate_hz"
        raise StudyError("options/invalid", text, study)
    files = recorded.get("files") or [{}]
    entries = [
        {key: value for key, value in files[min(i, len(files) - 1)].items() if key not in _KEYS_OF_ONE_LOG}
        | {"path": str(log.absolute())}
        for i, log in enumerate(logs)
    ]
    overrides = [f"experiment.recorded.files={json.dumps(entries)}"]
    if (data.get("validation") or {}).get("configurations") and "friction" in data:
        overrides.append("validation.configurations=[]")
    folder = options["folder"] or Path("runs") / f"{data.get('name', 'study')}_{logs[0].stem}"
    return {**options, "overrides": (*options["overrides"], *overrides), "folder": folder}


def predict(run: Run, source: Path) -> None:
    """Validate the parameters of `source` on the logs of a study: prediction.json and prediction.png.

    source: a friction.h5 or fit.h5, or its folder.  Outdated stages that read the logs are run again.
    StudyError for a study of the other kind, DataError if nothing can be predicted.
    """
    is_friction = run.study.friction is not None
    path = _result_path(run, source, "friction.h5" if is_friction else "fit.h5")
    with run.open_folder():
        for name in ("design", "measure", *(() if is_friction else ("estimate",))):
            if name in run.stages and not run.is_current(name):
                run_stage(run, name)
        prediction, content, sentences = (_predict_friction if is_friction else _predict_elasticity)(run, path)
        write_json(summary := run.folder / "prediction.json", content | {"with": str(path)})
        if prediction.balances:
            octaves_figure(prediction.balances).savefig(run.folder / "prediction.png")
        save_checksums(run.folder, [summary.name])
        for sentence in (*sentences, str(summary)):
            run.console.say(f"predict: {sentence}")


def _result_path(run: Run, source: Path, name: str) -> Path:
    """Return the path of the result file; StudyError if it is missing or in the run folder of the study."""
    path = source / name if source.is_dir() else source
    if not path.is_file():
        kind = "friction" if run.study.friction is not None else "elasticity"
        text = f"{path.name} is missing. The study identifies {kind}: give the run folder of another study of {kind}"
        raise StudyError("files/missing", text, f"--with {source}")
    if path.resolve().parent == run.folder.resolve() and not run.is_current(name.removesuffix(".h5")):
        text = "this is the run folder of STUDY, whose logs would be replaced. Give another folder with --run"
        raise StudyError("options/invalid", text, f"--with {source}")
    run.study.as_robot()
    return path


def _predict_friction(run: Run, path: Path) -> tuple[LogComparison, dict[str, Any], Sequence[str]]:
    result, measured = read_friction_result(path), read_friction_records(run.path("measure"))
    recorded = run.study.experiment.recorded
    controller = None if recorded is None else recorded.controller
    identified = with_identified_friction(run.study.as_robot(), result)
    prediction = predict_logs(identified, result.joints, measured, controller, Execution(run.jobs))
    for joint, reason in prediction.missing.items():
        run.console.warn(f"joint {joint}: no prediction, {reason}")
    if not prediction.balances:
        alone = ", which contain no torques. For position references: `elastid predict RUN --log LOG`"
        why = " (see the warnings above)" if prediction.missing else alone
        raise DataError("predict/mismatch", f"no joint can be predicted on these logs{why}", f"--with {path}")
    content = {"schema": SCHEMA, "study": run.study.name, **prediction_summary(prediction)}
    return prediction, content, prediction.sentences


def _predict_elasticity(run: Run, path: Path) -> tuple[LogComparison, dict[str, Any], Sequence[str]]:
    study, responses, result = run.study, read_responses(run.path("estimate")), read_fit(path)
    robot = study.as_robot()
    missing = sorted(set(robot.parameters()) - set(result.parameters.names))
    if missing:
        text = f"the fit of another robot has no {', '.join(missing[:3])}. Use a fit of this robot"
        raise DataError("predict/mismatch", text, f"--with {path}")
    friction, gears = read_friction(path.with_name("frf.h5")), read_gears(path.with_name("gears.h5"))
    model = FittedRobot.of(result, robot, responses, study.model)
    records = run.path("measure") if "measure" in run.stages else None
    basis = ValidationBasis(replace(study, validation=ValidationSpec()), model, friction, gears)
    validation, log_comparison = validate_model(basis, responses.names, records, run.console, Execution(run.jobs))
    content = validation_summary(study.name, validation, log_comparison)
    return log_comparison, content, [*filter(None, (validation.verdict, *log_comparison.sentences))]
