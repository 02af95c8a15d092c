"""Export to python-control: state-space models of all configurations in an .npz file, and a script that loads it."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from elastid.base.escape import docstring
from elastid.base.files import from_template, replacing
from elastid.fit.fitted_robot import FittedRobot
from elastid.modal.modes import Modes
from elastid.response import Response
from elastid.store.files import write_text
from elastid.targets.numbers import exported_numbers
from elastid.targets.target import Target


def write_responses_control(
    folder: Path, name: str, responses: Sequence[Response], modes: Sequence[Modes] = ()
) -> tuple[Path, ...]:
    """Write responses.npz and load_responses.py; arrays <configuration>/freq_hz, G (F, n_y, n_u), std, inputs, outputs.

    With modes, further arrays: A, B, C, D, num (n_y, n_u, m), den (m,) and error of the modal model; numbers (n, 2):
    frequency in Hz and damping ratio of each mode; covariance (2 n, 2 n) of these.
    """
    arrays = {"configurations": np.array([G.configuration.name for G in responses])}
    for G in responses:
        place = G.configuration.name
        arrays |= _measured(G) | {f"{place}/inputs": np.array(G.inputs), f"{place}/outputs": np.array(G.outputs)}
    for mode in (row for row in modes if row.n_modes):
        system, place = mode.state_space(), mode.configuration
        arrays |= {f"{place}/{matrix}": getattr(system, matrix) for matrix in "ABCD"}
        arrays |= dict(zip((f"{place}/num", f"{place}/den"), mode.transfer_polynomials(), strict=True))
        arrays[f"{place}/numbers"] = np.stack([mode.freq_hz, mode.zeta], axis=1)
        arrays |= {f"{place}/covariance": mode.covariance, f"{place}/error": np.array(mode.state_space_error)}
    return _write(folder / "responses.npz", arrays, folder / "load_responses.py", name, responses[0])


def _measured(G: Response) -> dict[str, np.ndarray]:
    configuration = G.configuration.name
    std = {} if G.uncertainty is None else {f"{configuration}/std": np.sqrt(G.uncertainty.variance)}
    return {f"{configuration}/freq_hz": G.freq_hz, f"{configuration}/G": G.G} | std


def _write(data: Path, arrays: dict[str, np.ndarray], loader: Path, name: str, first: Response) -> tuple[Path, Path]:
    with replacing(data) as temporary, temporary.open("wb") as file:
        np.savez(file, **arrays)  # type: ignore[arg-type]  # mypy takes a value for allow_pickle
    texts = {"npz": data.name, "name": docstring(name), "first": docstring(repr(first.configuration.name))}
    write_text(
        loader, from_template(f"targets/templates/{loader.name}.txt", **texts, quantity=first.quantity, unit=first.unit)
    )
    return data, loader


def write_control(folder: Path, model: FittedRobot) -> tuple[Path, ...]:
    """Write model.npz and load_model.py; arrays <configuration>/A, B, C, D, angles (rad), delay (s), freq_hz, G, std.

    parameters, units (p,): names and SI units.  known (p, 7): value, std, ends of the 95 % interval, and the three
    contributions to std.  free (m,), covariance (m, m): names and covariance of the free parameters, SI.
    """
    systems = [plant.state_space() for plant in model.models]
    first_system, numbers = systems[0], exported_numbers(model)
    free, C = model.result.parameters.free, model.result.covariance
    slopes = np.where([p.log for p in free], model.result.parameters.natural(model.result.x), 1.0)
    arrays = {
        "configurations": np.array([system.configuration.name for system in systems]),
        **{name: np.array(getattr(first_system, name)) for name in ("inputs", "outputs", "quantity")},
        "parameters": np.array([n.name for n in numbers]), "units": np.array([n.unit for n in numbers]),
        "known": np.array([[*n.row.values()] for n in numbers]),
        "free": np.array([p.name for p in free]), "covariance": slopes[:, None] * C * slopes,
    }  # fmt: skip
    for system in systems:
        name = system.configuration.name
        arrays |= {f"{name}/{matrix}": getattr(system, matrix) for matrix in "ABCD"}
        arrays |= {f"{name}/delay": np.array(system.delay), f"{name}/angles": system.configuration.angles}
    for G in model.measured:
        arrays |= _measured(G)
    return _write(folder / "model.npz", arrays, folder / "load_model.py", model.name, model.measured[0])


TARGETS = (
    Target(
        "control", ("model",), "state-space models for python-control, with intervals and measured FRFs", write_control
    ),
    Target(
        "control",
        ("name", "responses", "modes"),
        "measured FRFs and modal models for python-control",
        write_responses_control,
    ),
)
