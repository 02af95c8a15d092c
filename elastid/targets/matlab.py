"""Export to MATLAB: a MAT-file with state-space models and responses of all configurations, and a loading script."""

import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from scipy.io import savemat

from elastid.base.arrays import FloatArray
from elastid.base.errors import StudyError
from elastid.base.escape import one_line
from elastid.base.files import from_template, write_atomically
from elastid.fit.fitted_robot import FittedRobot
from elastid.fit.posture import PredictionPorts, default_frame
from elastid.response import Response
from elastid.robot import FRAME_AXES
from elastid.store.files import write_text
from elastid.targets.numbers import exported_numbers
from elastid.targets.target import Target

Fields: TypeAlias = dict[str, Any]  # of a MATLAB struct
# A MAT-file of version 5 begins with 116 bytes of text, into which SciPy writes the time.
HEADING = b"MATLAB 5.0 MAT-file, written by elastid".ljust(116)


def write_matlab(folder: Path, model: FittedRobot) -> tuple[Path, ...]:
    """Write model.mat (version 5) with struct arrays `model`, `measured`, `fitted`, `parameters`, `tool`; load_model.m.

    measured and fitted have the fields of an idfrd: ResponseData (n_y, n_u, F), Frequency, FrequencyUnit,
    CovarianceData (fitted: of the parameters). tool has A, B, C, D (.., .., Q) from forces and torques at the frame to
    its motion with locked motors, in Q postures. The script runs in MATLAB and Octave; toolboxes are optional.
    """
    fitted = [
        _response(plant.response(G.freq_hz, sampled=True).G, G, plant.response_std(G.freq_hz) ** 2)
        for plant, G in zip(model.models, model.measured, strict=True)
    ]
    numbers = [{"name": number.name, **number.row, "unit": number.unit} for number in exported_numbers(model)]
    measured, systems = list(map(_measured, model.measured)), [_system(plant.state_space()) for plant in model.models]
    content = {"model": systems, "measured": measured, "fitted": fitted, "parameters": numbers, "tool": [_tool(model)]}
    data, script = folder / "model.mat", folder / "load_model.m"
    return _write(data, content, script, model.name, model.measured[0])


def write_responses_matlab(folder: Path, name: str, responses: Sequence[Response]) -> tuple[Path, ...]:
    """Write responses.mat (version 5) with the struct array `measured`, as in model.mat, and load_responses.m."""
    data, script = folder / "responses.mat", folder / "load_responses.m"
    return _write(data, {"measured": list(map(_measured, responses))}, script, name, responses[0])


def _write(data: Path, content: dict[str, list[Fields]], script: Path, name: str, first: Response) -> tuple[Path, Path]:
    structs = {}
    for key, rows in content.items():
        structs[key] = np.empty((len(rows), 1), dtype=[(name, object) for name in rows[0]])
        structs[key][:, 0] = [tuple(row.values()) for row in rows]
    write_mat(data, structs)
    texts = {"mat": data.name, "name": one_line(name), "quantity": first.quantity, "unit": first.unit}
    write_text(script, from_template(f"targets/templates/{script.name}", **texts))
    return data, script


def write_mat(path: Path, content: Mapping[str, Any]) -> None:
    """Write a MAT-file of version 5 without the time, so that equal content gives equal bytes."""
    buffer = io.BytesIO()
    savemat(buffer, content, do_compression=True)
    write_atomically(path, HEADING + buffer.getvalue()[len(HEADING) :])


def _measured(G: Response) -> Fields:
    return _response(G.G, G, None if G.uncertainty is None else G.uncertainty.variance)


def _system(system: Any) -> Fields:
    return {
        "configuration": system.configuration.name, "angles": system.configuration.angles,
        **{name: getattr(system, name) for name in "ABCD"}, "InputDelay": system.delay,
        "InputName": np.array(system.inputs, dtype=object), "OutputName": np.array(system.outputs, dtype=object),
        "quantity": system.quantity,
    }  # fmt: skip


def _tool(model: FittedRobot) -> Fields:
    """Return state-space models at a frame with locked motors in all postures; only the names for a rigid robot."""
    configurations = [linear.configuration for linear in model.linear]
    names = {"configurations": np.array([posture.name for posture in configurations], dtype=object)}
    frame = default_frame(model.robot)
    ports = tuple(f"{kind} {frame} {axis}" for kind in ("force", "torque") for axis in "xyz")
    tool = PredictionPorts(ports, tuple(f"frame {frame} {axis}" for axis in FRAME_AXES), axes="world")
    try:
        systems = [model.result.family(tool, posture.name).at(posture).state_space() for posture in configurations]
    except StudyError:
        return names
    stacks = {name: np.stack([getattr(system, name) for system in systems], axis=2) for name in "ABCD"}
    first = systems[0]
    return names | stacks | {
        "frame": frame,
        "InputName": np.array(first.inputs, dtype=object),
        "OutputName": np.array(first.outputs, dtype=object),
    }  # fmt: skip


def _response(G: Any, measured: Response, variance: FloatArray | None) -> Fields:
    """Return the fields of an idfrd; CovarianceData (n_y, n_u, F, 2, 2) has half of the variance per real component."""
    half = None if variance is None else np.moveaxis(variance, 0, 2) / 2
    return {
        "configuration": measured.configuration.name, "ResponseData": np.moveaxis(G, 0, 2),
        "Frequency": measured.freq_hz, "FrequencyUnit": "Hz", "InputName": np.array(measured.inputs, dtype=object),
        "OutputName": np.array(measured.outputs, dtype=object), "Ts": 0.0,
        "CovarianceData": np.zeros((0, 0)) if half is None else half[..., None, None] * np.eye(2),
    }  # fmt: skip


TARGETS = (
    Target("matlab", ("model",), "state-space models for MATLAB, with intervals and measured FRFs", write_matlab),
    Target("matlab", ("name", "responses"), "measured FRFs for MATLAB", write_responses_matlab),
)
