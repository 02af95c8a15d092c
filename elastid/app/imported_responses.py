"""The frequency responses of a study that starts from them: files of other programs and frf.h5 of another run."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from elastid.base.errors import DataError, StudyError
from elastid.base.note import Note
from elastid.experiment.plan.plan import checked_configurations
from elastid.experiment.specs.responses import ResponseFileSpec
from elastid.frf.checks.exchanged_channels import channel_notes
from elastid.record import Configuration
from elastid.recorded.naming import naming
from elastid.recorded.responses.reading import link_side_response, read_table
from elastid.response import FrequencyResponse, in_quantity
from elastid.store import kind_of, read_responses
from elastid.study import Study

# Angles that differ by more, in rad (positions in m), are another configuration.
_SAME_ANGLE = 1e-3


def imported_responses(study: Study, base: Path) -> Iterator[FrequencyResponse]:
    """One response for each file of the study, in their order, in the estimator's quantity and band.

    Raises StudyError where channels or configuration and file do not fit, DataError where a file cannot be used.
    """
    spec, estimator = study.experiment.responses, study.estimator
    assert spec is not None  # the kind of the experiment is `responses`
    configurations = {c.name: c for c in checked_configurations(study.experiment, study.places)}
    for file in spec.files:
        path, configuration = base / file.path, configurations[file.configuration]
        if kind_of(path) == "frf":
            response = in_quantity(_of_another_run(path, file, configuration, study), estimator.quantity)
            if spec.is_held:
                text = "hold is not taken out of it: the study that estimated it says in experiment.recorded.hold"
                response = replace(response, notes=(*response.notes, Note("hold-not-taken-out", text, str(path))))
        else:
            if not spec.channels:
                raise StudyError(
                    f"{path}: its inputs and outputs are unknown; give them under experiment.responses.channels"
                )
            with naming(path, "its values are no frequency response; look at them with `elastid inspect`"):
                table = read_table(path, spec, file.response)
                response = link_side_response(table, spec, configuration, study.places, estimator.quantity)
        if estimator.band_hz is not None:
            low, high = estimator.band_hz
            inside = (response.freq_hz >= low) & (response.freq_hz <= high)
            if not inside.any():
                raise DataError(f"{path}: none of its lines lies in band_hz, {low:g} to {high:g} Hz")
            response = response.lines(inside)
        yield replace(response, notes=(*response.notes, *channel_notes(response)))


def _of_another_run(
    path: Path, file: ResponseFileSpec, configuration: Configuration, study: Study
) -> FrequencyResponse:
    found = {response.configuration.name: response for response in read_responses(path)}
    name = file.response or configuration.name
    if name not in found:
        raise StudyError(f"{path}: no response of configuration {name} in it; there are {', '.join(found) or 'none'}")
    response = found[name]
    angles = response.configuration.angles
    if study.robot is None:  # places are names, whatever they were measured on
        return replace(response, configuration=configuration)
    if angles.shape != configuration.angles.shape or np.any(np.abs(angles - configuration.angles) > _SAME_ANGLE):
        units = ", ".join(dict.fromkeys(joint.unit for joint in study.robot.driven))
        raise StudyError(
            f"{path}: {name} was measured at {angles.tolist()} ({units}), the study's {configuration.name} is at "
            f"{configuration.angles.tolist()}; correct experiment.configurations"
        )
    for place in (*response.inputs, *response.outputs):
        study.robot.check_location(place)
    return replace(response, configuration=configuration)
