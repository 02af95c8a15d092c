"""What the result of a stage depends on beside sections of the study: files, settings of later stages, the text.

Apart from the stages, so that the stamps of a study are known without any of them being loaded.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from elastid.app.provenance import file_hash, file_hashes
from elastid.study import LoadedStudy
from elastid.study.checks.design import responses_file


def of_design(loaded: LoadedStudy, inputs: Mapping[str, str]) -> list[Any]:
    """Settings of the later fit, on which choice and forecast depend, and the earlier results that the study names."""
    study, fit = loaded.study, asdict(loaded.study.fit)
    settings: list[Any] = [fit[name] for name in ("parameters", "criterion", "weights", "band_hz")]
    settings += [study.estimator.quantity, study.estimator.friction, study.validation.left_out]
    if study.design is not None:
        files = [responses_file(loaded.base, path) for path in (*study.design.measured, study.design.noise.frf) if path]
        files += [file.with_name("fit.h5") for file in files if file.with_name("fit.h5").is_file()]
        settings += [[file.name, file_hash(file)] for file in files]
    return settings


def of_plan(loaded: LoadedStudy, inputs: Mapping[str, str]) -> str | None:
    """The hash of the design's inputs where it chose configurations or spectra for the fit.

    Another plan follows from the sections that `measure` reads itself; its forecast does not concern the rig.
    """
    study = loaded.study
    chosen = study.design is not None or (study.excitation is not None and study.excitation.flat == "information")
    return inputs["design"] if chosen else None


def of_logs(loaded: LoadedStudy, inputs: Mapping[str, str]) -> list[Any]:
    """The content of every log."""
    files = loaded.study.experiment.as_recorded().files
    return file_hashes(loaded.base, (path for file in files for path in (file.path, *file.also)))


def of_responses(loaded: LoadedStudy, inputs: Mapping[str, str]) -> list[Any]:
    """The content of every file with responses."""
    spec = loaded.study.experiment.responses
    return file_hashes(loaded.base, (file.path for file in spec.files) if spec is not None else ())


def of_page(loaded: LoadedStudy, inputs: Mapping[str, str]) -> str:
    """The text of the study, which the page shows."""
    return loaded.text
