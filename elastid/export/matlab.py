"""Export to MATLAB: a .mat with every configuration's matrices and responses, and a script that makes ss and idfrd."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import savemat

from elastid.fit.fitted_model import FittedModel
from elastid.linear.response.transfer import frequency_response
from elastid.response import FrequencyResponse
from elastid.store import replacing, text_file

# A MAT-file of version 5 begins with 116 bytes of free text, in which SciPy writes the time.
_HEADING = b"MATLAB 5.0 MAT-file, written by elastid".ljust(116)

_SCRIPT = """% Loads {mat}: the fitted model of {name}, motor torque (N*m) to {quantity} ({unit}), link side.
% models{{i}} is an ss, measured{{i}} an idfrd (System Identification Toolbox), of e.model(i).configuration.
e = load(fullfile(fileparts(mfilename('fullpath')), '{mat}'));
for i = 1:numel(e.model)
    m = e.model(i);
    models{{i}} = ss(m.A, m.B, m.C, m.D, 'InputDelay', repmat(m.InputDelay, 1, size(m.B, 2)), ...
        'InputName', m.InputName, 'OutputName', m.OutputName, 'Name', m.configuration); %#ok<SAGROW>
    f = e.measured(i);
    measured{{i}} = idfrd(f.ResponseData, f.Frequency(:), 0, 'FrequencyUnit', f.FrequencyUnit, ...
        'InputName', f.InputName, 'OutputName', f.OutputName); %#ok<SAGROW>
end
"""


_RESPONSES_SCRIPT = """% Loads {mat}: the measured responses of {name}, {quantity}, {unit}.
% measured{{i}} is an idfrd (System Identification Toolbox) of e.measured(i).configuration, measured at its lines.
e = load(fullfile(fileparts(mfilename('fullpath')), '{mat}'));
for i = 1:numel(e.measured)
    f = e.measured(i);
    measured{{i}} = idfrd(f.ResponseData, f.Frequency(:), 0, 'FrequencyUnit', f.FrequencyUnit, ...
        'InputName', f.InputName, 'OutputName', f.OutputName); %#ok<SAGROW>
end
"""


def write_matlab(folder: Path, model: FittedModel) -> tuple[Path, ...]:
    """model.mat (version 5) with struct arrays `model`, `measured`, `fitted` and `parameters`, and load_model.m.

    measured and fitted have the fields of an idfrd: ResponseData (n_y, n_u, F), Frequency, FrequencyUnit.
    """
    values, std = model.result.values, model.result.std
    content = {
        "model": _structs([_system(system) for system in model.state_spaces]),
        "measured": _structs([_response(G.freq_hz, G.G, G) for G in model.measured]),
        "fitted": _structs(
            [
                _response(G.freq_hz, frequency_response(linear, model.theta, G.freq_hz), G)
                for linear, G in zip(model.linear, model.measured, strict=True)
            ]
        ),
        "parameters": _structs(
            [
                {"name": p.name, "value": values[p.name], "std": std.get(p.name, 0.0), "unit": p.unit}
                for p in model.parameters
            ]
        ),
    }
    data, script = folder / "model.mat", folder / "load_model.m"
    _save(data, content)
    first = model.measured[0]
    with text_file(script) as file:
        file.write(_SCRIPT.format(mat=data.name, name=model.name, quantity=first.quantity, unit=first.unit))
    return data, script


def write_responses_matlab(folder: Path, name: str, responses: Sequence[FrequencyResponse]) -> tuple[Path, ...]:
    """responses.mat (version 5) with the struct array `measured`, as in model.mat, and load_responses.m."""
    data, script = folder / "responses.mat", folder / "load_responses.m"
    _save(data, {"measured": _structs([_with_covariance(G) for G in responses])})
    first = responses[0]
    with text_file(script) as file:
        file.write(_RESPONSES_SCRIPT.format(mat=data.name, name=name, quantity=first.quantity, unit=first.unit))
    return data, script


def _save(path: Path, content: dict[str, Any]) -> None:
    written = io.BytesIO()
    savemat(written, content, do_compression=True)
    with replacing(path) as temporary:
        temporary.write_bytes(_HEADING + written.getvalue()[len(_HEADING) :])


def _with_covariance(G: FrequencyResponse) -> dict[str, Any]:
    """The fields of an idfrd; CovarianceData (n_y, n_u, F, 2, 2): each real component carries half of the variance."""
    fields = _response(G.freq_hz, G.G, G)
    if G.uncertainty is None:
        return fields | {"CovarianceData": np.zeros((0, 0))}
    half = np.moveaxis(G.uncertainty.variance, 0, 2) / 2
    return fields | {"CovarianceData": half[..., None, None] * np.eye(2)}


def _system(system: Any) -> dict[str, Any]:
    return {
        "configuration": system.configuration.name,
        "angles": system.configuration.angles,
        **{name: getattr(system, name) for name in "ABCD"},
        "InputDelay": system.delay,
        "InputName": np.array(system.inputs, dtype=object),
        "OutputName": np.array(system.outputs, dtype=object),
        "quantity": system.quantity,
    }


def _response(freq_hz: Any, G: Any, of: Any) -> dict[str, Any]:
    return {
        "configuration": of.configuration.name,
        "ResponseData": np.moveaxis(G, 0, 2),
        "Frequency": freq_hz,
        "FrequencyUnit": "Hz",
        "InputName": np.array(of.inputs, dtype=object),
        "OutputName": np.array(of.outputs, dtype=object),
        "Ts": 0.0,
    }


def _structs(rows: list[dict[str, Any]]) -> Any:
    """A MATLAB struct array: a structured array with one field a key."""
    array = np.empty((len(rows), 1), dtype=[(key, object) for key in rows[0]])
    for i, row in enumerate(rows):
        array[i, 0] = tuple(row.values())
    return array
