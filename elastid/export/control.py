"""Export to python-control: the state space of every configuration in one .npz without pickles, and how to load it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from elastid.fit.fitted_model import FittedModel
from elastid.store import replacing, text_file

_LOADER = '''"""Loads {npz}: the fitted model of {name}, one state space for each configuration.

    systems, delays = load()
    control.bode_plot(systems["{first}"])

Inputs are motor torques in N*m, outputs {quantity} in {unit}, all on the link side. The delay of the torque in seconds
is not part of a system: multiply its response by exp(-2j pi f delay), or add control.pade(delay, 2).
"""

from pathlib import Path

import control
import numpy as np


def load(path=Path(__file__).with_name("{npz}")):
    """StateSpace and delay by configuration."""
    with np.load(path, allow_pickle=False) as file:
        names = [str(name) for name in file["configurations"]]
        labels = {{"inputs": [str(u) for u in file["inputs"]], "outputs": [str(y) for y in file["outputs"]]}}
        systems = {{
            name: control.ss(*(file[f"{{name}}/{{matrix}}"] for matrix in "ABCD"), **labels) for name in names
        }}
        return systems, {{name: float(file[f"{{name}}/delay"]) for name in names}}
'''


def write_control(folder: Path, model: FittedModel) -> tuple[Path, ...]:
    """model.npz and load_model.py; arrays <configuration>/A, B, C, D, angles (rad), delay (s)."""
    systems = model.state_spaces
    first = systems[0]
    arrays: dict[str, np.ndarray] = {
        "configurations": np.array([system.configuration.name for system in systems]),
        "inputs": np.array(first.inputs),
        "outputs": np.array(first.outputs),
        "quantity": np.array(first.quantity),
    }
    for system in systems:
        name = system.configuration.name
        arrays |= {f"{name}/{matrix}": getattr(system, matrix) for matrix in "ABCD"}
        arrays |= {f"{name}/delay": np.array(system.delay), f"{name}/angles": system.configuration.angles}
    data, loader = folder / "model.npz", folder / "load_model.py"
    with replacing(data) as temporary, temporary.open("wb") as file:
        np.savez(file, **arrays)  # type: ignore[arg-type]  # mypy takes a value for allow_pickle
    with text_file(loader) as script:
        script.write(
            _LOADER.format(
                npz=data.name,
                name=model.name,
                first=first.configuration.name,
                quantity=first.quantity,
                unit=model.measured[0].unit,
            )
        )
    return data, loader
