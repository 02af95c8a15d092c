"""Export to python-control: the state space of every configuration in one .npz without pickles, and how to load it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from elastid.base.escape import docstring
from elastid.base.files import replacing
from elastid.export.numbers import known_numbers
from elastid.fit.fitted_robot import FittedRobot
from elastid.response import FrequencyResponse
from elastid.store.files import write_text

_LABEL = '''def label(name):
    """A name as python-control takes it, which refuses dots."""
    return name.replace(".", "_")'''

_LOADER = '''"""Loads {npz}: the fitted model of {name}, one state space for each configuration, and what was measured.

    systems, delays = load()
    control.bode_plot([systems[{first}], measured()[{first}]])

Inputs are motor torques in N*m, outputs {quantity} in {unit}, all on the link side. The delay of the torque in seconds
is not part of a system: multiply its response by exp(-2j pi f delay), or load it with systems, _ = load(pade=2), the
order of an approximation by Pade. What the fit knows of each number: parameters().
"""

from pathlib import Path

import control
import numpy as np

DATA = Path(__file__).with_name("{npz}")


{label}


def load(path=DATA, pade=None):
    """StateSpace and delay by configuration."""
    with np.load(path, allow_pickle=False) as file:
        names = [str(name) for name in file["configurations"]]
        inputs, outputs = ([str(channel) for channel in file[side]] for side in ("inputs", "outputs"))
        delays = {{name: float(file[f"{{name}}/delay"]) for name in names}}
        systems = {{name: control.ss(*(file[f"{{name}}/{{matrix}}"] for matrix in "ABCD")) for name in names}}
    if pade is not None:
        late = {{name: control.tf2ss(*control.pade(delay, pade)) for name, delay in delays.items() if delay > 0}}
        systems |= {{name: systems[name] * control.append(*[one] * len(inputs)) for name, one in late.items()}}
    labels = {{"inputs": [label(u) for u in inputs], "outputs": [label(y) for y in outputs]}}
    return {{name: control.ss(systems[name], name=label(name), **labels) for name in names}}, delays


def parameters(path=DATA):
    """(value, std, low, high, by_noise, by_file, unit) by name, the interval of 95 %; NaN for numbers that were held.

    by_noise, by_file: the parts of std; NaN where the robot's file is exact.
    """
    with np.load(path, allow_pickle=False) as file:
        known = zip(file["parameters"].tolist(), file["known"].tolist(), file["units"].tolist(), strict=True)
        return {{name: (*numbers, unit) for name, numbers, unit in known}}


def measured(path=DATA):
    """FrequencyResponseData by configuration; its standard deviations are in the arrays <configuration>/std."""
    with np.load(path, allow_pickle=False) as file:
        return {{
            name: control.frd(
                np.moveaxis(file[f"{{name}}/G"], 0, 2),
                2 * np.pi * file[f"{{name}}/freq_hz"],
                name=label(name),
            )
            for name in [str(name) for name in file["configurations"]]
        }}
'''


_RESPONSES_LOADER = '''"""Loads {npz}: the measured responses of {name}, one frd for each configuration.

    responses = load()
    control.bode_plot(responses[{first}])

Outputs per inputs in {unit}; the frequencies of an frd are in rad/s.
"""

from pathlib import Path

import control
import numpy as np


{label}


def load(path=Path(__file__).with_name("{npz}")):
    """FrequencyResponseData by configuration."""
    with np.load(path, allow_pickle=False) as file:
        names = [str(name) for name in file["configurations"]]
        return {{
            name: control.frd(
                np.moveaxis(file[f"{{name}}/G"], 0, 2),
                2 * np.pi * file[f"{{name}}/freq_hz"],
                inputs=[label(str(u)) for u in file[f"{{name}}/inputs"]],
                outputs=[label(str(y)) for y in file[f"{{name}}/outputs"]],
                name=label(name),
            )
            for name in names
        }}
'''


def write_responses_control(folder: Path, name: str, responses: Sequence[FrequencyResponse]) -> tuple[Path, ...]:
    """responses.npz and load_responses.py; arrays <configuration>/freq_hz, G (F, n_y, n_u), std, inputs, outputs."""
    arrays: dict[str, np.ndarray] = {"configurations": np.array([G.configuration.name for G in responses])}
    for G in responses:
        place = G.configuration.name
        arrays |= _measured(G) | {f"{place}/inputs": np.array(G.inputs), f"{place}/outputs": np.array(G.outputs)}
    return _written(
        folder / "responses.npz", arrays, folder / "load_responses.py", _RESPONSES_LOADER, name, responses[0]
    )


def _measured(G: FrequencyResponse) -> dict[str, np.ndarray]:
    place = G.configuration.name
    std = {} if G.uncertainty is None else {f"{place}/std": np.sqrt(G.uncertainty.variance)}
    return {f"{place}/freq_hz": G.freq_hz, f"{place}/G": G.G} | std


def _written(
    data: Path, arrays: dict[str, np.ndarray], loader: Path, text: str, name: str, first: FrequencyResponse
) -> tuple[Path, Path]:
    with replacing(data) as temporary, temporary.open("wb") as file:
        np.savez(file, **arrays)  # type: ignore[arg-type]  # mypy takes a value for allow_pickle
    example = docstring(repr(first.configuration.name))
    known = {"npz": data.name, "label": _LABEL, "name": docstring(name), "first": example}
    write_text(loader, text.format(**known, quantity=first.quantity, unit=first.unit))
    return data, loader


def write_control(folder: Path, model: FittedRobot) -> tuple[Path, ...]:
    """model.npz and load_model.py; arrays <configuration>/A, B, C, D, angles (rad), delay (s), freq_hz, G, std.

    parameters, units (p,) and known (p, 6) of each, SI: value, std, the ends of the 95 % interval, and the parts of std
    by noise and by the tolerances of the robot's file.
    """
    systems = model.state_spaces
    first, numbers = systems[0], known_numbers(model)
    arrays = {"configurations": np.array([system.configuration.name for system in systems])}
    arrays |= {name: np.array(getattr(first, name)) for name in ("inputs", "outputs", "quantity")}
    arrays |= {"parameters": np.array([n.name for n in numbers]), "units": np.array([n.unit for n in numbers])}
    arrays |= {"known": np.array([(n.value, n.std, n.low, n.high, n.by_noise, n.by_file) for n in numbers])}
    for system in systems:
        name = system.configuration.name
        arrays |= {f"{name}/{matrix}": getattr(system, matrix) for matrix in "ABCD"}
        arrays |= {f"{name}/delay": np.array(system.delay), f"{name}/angles": system.configuration.angles}
    for G in model.measured:
        arrays |= _measured(G)
    return _written(folder / "model.npz", arrays, folder / "load_model.py", _LOADER, model.name, model.measured[0])
